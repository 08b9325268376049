"""Warming up: every world of a protocol is played a step before the window opens, so that nothing compiles later.

Code from the cache is loaded in a second or two. Where there is none yet, compiling takes most of the time and keeps
one core busy: a second process then compiles too, from the last piece on, and this one finds that code in the cache.
What is not needed yet, and what looks for ways, it can compile behind, while somebody plays.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec

from minihuman.collector import never_collected
from minihuman.study.protocol import Block, Protocol
from minihuman.study.rehearse import play_a_step, rehearse
from minihuman.worlds.adapt.world import World
from minihuman.worlds.hashing import hash64
from minihuman.worlds.kernels import at_first_compile

_DONE = ".done"  # after a piece's name
_LOOK_EVERY_S = 0.02


def warm_up(protocol: Protocol, source: str = "protocol", companion: "Companion | None" = None) -> None:
    """Rehearse a protocol, and compile whatever its worlds need; ``source`` names the file in errors.

    Args:
        protocol: the study, or so much of it as is needed now.
        source: names the file in errors.
        companion: a second process that goes on after this; one of its own for None.

    Raises:
        ProtocolError: at the first block whose world cannot be played as it says, or fails at a step.
    """
    if companion is None:
        with shared(protocol.blocks) as companion:
            return warm_up(protocol, source, companion)
    with never_collected():
        rehearse(protocol, source, before=companion.compile_with)


@contextmanager
def shared(*stages: Sequence[Block], plans: bool = False) -> Iterator["Companion"]:
    """Meanwhile, from the first compiling on, a second process compiles too.

    Args:
        stages: the blocks whose worlds are needed first, those needed next, and so on.
        plans: what finding ways in these worlds takes is compiled last.
    """
    with Companion(stages, plans=plans) as companion, at_first_compile(companion.start):
        yield companion


class Companion:
    """A second process that compiles what some blocks need, for the code it leaves in the cache.

    What fails there fails here, where it is reported. Each piece of the work is a file in a folder that both processes
    know, made by the one that begins it, and one more when it is done.
    """

    def __init__(self, stages: Sequence[Sequence[Block]], *, plans: bool = False) -> None:
        self._stages, self._plans = stages, plans
        self._folder = TemporaryDirectory(prefix="minihuman-")
        self._seen: set[str] = set()  # those that this process began or waited for
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "Companion":
        return self

    def __exit__(self, *exception: object) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()

    def start(self) -> None:
        """Set it to work, unless there is no core for it."""
        if (os.cpu_count() or 1) == 1:
            return
        with suppress(OSError):  # no second process, no help
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", f"from {__name__} import companion; companion()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONSAFEPATH": "1"},
            )
            assert self._process.stdin is not None
            self._process.stdin.write(msgspec.json.encode((self._folder.name, self._stages, self._plans)))
            self._process.stdin.close()

    def compile_with(self, block: Block) -> None:
        """Compile the pieces of a block's world that nobody has begun, and wait where the other process has.

        A world that is all one piece is only begun here: it is compiled where it is played.
        """
        pieces = {name: piece for name, piece in _pieces(block).items() if name not in self._seen}
        self._seen.update(pieces)
        elsewhere = []
        for name, piece in pieces.items():
            if not _begin(self._folder.name, name):
                elsewhere.append(name)
            elif piece is not None:
                piece()
        self._wait(elsewhere)

    def compile_plan(self, block: Block) -> None:
        """Compile what finding a way in a block's world takes, or wait where the other process does.

        Where there is none, nothing was compiled so far: then what looks for ways is there too, or is compiled when it
        is asked.
        """
        name = _plan_name(block)
        begun = _begin(self._folder.name, name)
        if begun and self._process is not None:
            _plan(block)
        elif not begun:
            self._wait([name])

    def _wait(self, names: list[str]) -> None:
        """Until the other process has done these pieces, or ended."""
        while self._process is not None and self._process.poll() is None:
            if all(Path(self._folder.name, name + _DONE).exists() for name in names):
                return
            time.sleep(_LOOK_EVERY_S)


def companion() -> None:
    """What the second process does, with a folder, blocks and whether they are planned on its standard input."""
    folder, stages, plans = msgspec.json.decode(sys.stdin.buffer.read(), type=tuple[str, list[list[Block]], bool])
    with never_collected():
        for blocks in stages:
            for block in reversed(blocks):
                for name, piece in reversed(_pieces(block).items()):
                    if _begin(folder, name):
                        (piece or partial(play_a_step, block))()
                        Path(folder, name + _DONE).touch()
        for block in (block for blocks in stages for block in blocks if plans):
            if _begin(folder, _plan_name(block)):
                _plan(block)
                Path(folder, _plan_name(block) + _DONE).touch()


def _plan(block: Block) -> None:
    """Look for a way once; where it is too far to be found, what looks for it is compiled all the same."""
    # whatever somebody's world raises, it raises again where it is asked
    with suppress(Exception), closing(World(block.world, block.options)) as world:
        world.reset(0)
        world.bounds()


def _plan_name(block: Block) -> str:
    return f"{_name(block)}-plan"


def _pieces(block: Block) -> dict[str, Callable[[], None] | None]:
    """What there is to compile of a block's world, by names that all processes agree on; None stands for all of it."""
    world = World(block.world, block.options)
    world.close()
    return {f"{_name(block)}-{nth}": piece for nth, piece in enumerate(world.compile_apart or (None,))}


def _name(block: Block) -> str:
    return f"{hash64(msgspec.json.encode((block.world, block.options))):x}"


def _begin(folder: str, name: str) -> bool:
    """Begin a piece, unless it has been begun."""
    try:
        Path(folder, name).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True
