"""Warming up: every world of a protocol is played a step before the window opens, so that nothing compiles later.

Code from the cache is loaded in a second or two. Where there is none yet, compiling takes most of the time and keeps
one core busy: a second process then compiles for the other worlds, and this one finds their code in the cache.
"""

import gc
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial

import msgspec

from minihuman.errors import ProtocolError
from minihuman.study.protocol import Block, Protocol
from minihuman.study.rehearse import rehearse
from minihuman.worlds.adapt import World
from minihuman.worlds.compiling import at_first_compile


def warm_up(protocol: Protocol, source: str = "protocol") -> None:
    """Rehearse a protocol, and play a step of every block's world; ``source`` names the file in errors.

    Raises:
        ProtocolError: at the first block whose world cannot be played as it says, or fails at a step.
    """
    blocks = protocol.blocks
    with _no_collection(), Companion() as companion:
        with at_first_compile(partial(companion.start, _others(blocks, 0))):
            rehearse(protocol, source)
        for number, block in enumerate(blocks):
            try:
                with at_first_compile(partial(companion.start, _others(blocks, number))):
                    play_a_step(block)
            except Exception as error:  # whatever somebody's world may raise
                reason = f"{type(error).__name__}: {error}"
                raise ProtocolError(f"{source}: $.blocks[{number}].world: {block.world} fails ({reason})") from error
            companion.wait()


def play_a_step(block: Block) -> None:
    """Do everything once that an episode of a block does with its world."""
    world = World(block.world, block.options)
    try:
        world.reset(seed=0)
        world.map(), world.pose(), world.state_hash()
        world.step(world.action_names.index(block.actions[0]))
        world.frame(block.view, palette=block.palette)
    finally:
        world.close()


class Companion:
    """A second process that plays blocks a step, for the code it leaves in the cache; what fails there fails here."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "Companion":
        return self

    def __exit__(self, *exception: object) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def start(self, blocks: Sequence[Block]) -> None:
        """Set it to work, unless it is at work already, there is nothing to do, or there is no core for it."""
        if self._process is not None or not blocks or (os.cpu_count() or 1) == 1:
            return
        with suppress(OSError):  # no second process, no help
            self._process = subprocess.Popen(
                [sys.executable, "-c", f"from {__name__} import companion; companion()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            )
            assert self._process.stdin is not None
            self._process.stdin.write(msgspec.json.encode(blocks))
            self._process.stdin.close()

    def wait(self) -> None:
        """Wait until it is done, if it is at work."""
        if self._process is not None:
            self._process.wait()
            self._process = None


def companion() -> None:
    """What the second process does: play the blocks on its standard input."""
    with _no_collection():
        for block in msgspec.json.decode(sys.stdin.buffer.read(), type=list[Block]):
            play_a_step(block)


def _others(blocks: Sequence[Block], number: int) -> list[Block]:
    """The blocks after this one in other worlds, each once, from the last: this process comes from the first."""
    worlds = {msgspec.json.encode((block.world, block.options)): block for block in blocks[number:]}
    here = msgspec.json.encode((blocks[number].world, blocks[number].options))
    return [block for world, block in reversed(worlds.items()) if world != here]


@contextmanager
def _no_collection() -> Iterator[None]:
    """Without the collection of cycles: the compiler makes millions of small objects, and scanning them is a tenth."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
