"""Warm up before a session: play a step of every world of a protocol, so that nothing compiles later.

Code from the cache loads in a second or two. Without a cache, compiling takes most of the time and keeps one core busy:
a second process then compiles too, from the last piece on, and this one finds that code in the cache. What is needed
later, such as path planning, it can compile in the background.
"""

import gc
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

from minihuman.experiment.plan.dry_run import check_worlds, try_world
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.worlds.adapters.world import World
from minihuman.worlds.hashing import hash64
from minihuman.worlds.kernels import at_first_compile

_DONE = ".done"  # after a piece's name
_LOOK_EVERY_S = 0.02


def warm_up(protocol: Protocol, source: str = "protocol", process: "CompileProcess | None" = None) -> None:
    """Rehearse a protocol, and compile whatever its worlds need; ``source`` names the file in errors.

    Args:
        protocol: the study, or so much of it as is needed now.
        source: names the file in errors.
        process: a second process that outlives this call; None: start one for this call.

    Raises:
        ProtocolError: at the first block whose world cannot be played or fails at a step.
    """
    if process is None:
        with share_compilation(protocol.blocks) as process:
            return warm_up(protocol, source, process)
    with paused_collection():
        check_worlds(protocol, source, before=process.compile_with)


@contextmanager
def share_compilation(*stages: Sequence[BlockSpec], plans: bool = False) -> Iterator["CompileProcess"]:
    """Let a second process compile too, from the first compilation on.

    Args:
        stages: the blocks whose worlds are needed first, those needed next, and so on.
        plans: compile the path search of these worlds last.
    """
    with CompileProcess(stages, plans=plans) as process, at_first_compile(process.start):
        yield process


class CompileProcess:
    """A second process that compiles what some blocks need, for the code it leaves in the cache.

    What fails there fails here, where it is reported. Each piece of the work is a file in a folder that both processes
    know, made by the one that begins it, and one more when it is done.
    """

    def __init__(self, stages: Sequence[Sequence[BlockSpec]], *, plans: bool = False) -> None:
        self._stages, self._plans = stages, plans
        self._folder = TemporaryDirectory(prefix="minihuman-")
        self._seen: set[str] = set()  # those that this process began or waited for
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "CompileProcess":
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
                [sys.executable, "-P", "-c", f"from {__name__} import compile_in_background; compile_in_background()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONSAFEPATH": "1"},
            )
            assert self._process.stdin is not None
            self._process.stdin.write(msgspec.json.encode((self._folder.name, self._stages, self._plans)))
            self._process.stdin.close()

    def compile_with(self, block: BlockSpec) -> None:
        """Compile the pieces of a block's world that are not begun, and wait for those of the other process.

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

    def compile_plan(self, block: BlockSpec) -> None:
        """Compile the path search of a block's world, or wait for the other process to.

        Without a second process nothing was compiled so far: the search is cached too, or is compiled on use.
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


def compile_in_background() -> None:
    """What the second process does, with a folder, blocks and whether they are planned on its standard input."""
    folder, stages, plans = msgspec.json.decode(sys.stdin.buffer.read(), type=tuple[str, list[list[BlockSpec]], bool])
    with paused_collection():
        for blocks in stages:
            for block in reversed(blocks):
                for name, piece in reversed(_pieces(block).items()):
                    if _begin(folder, name):
                        (piece or partial(try_world, block))()
                        Path(folder, name + _DONE).touch()
        for block in (block for blocks in stages for block in blocks if plans):
            if _begin(folder, _plan_name(block)):
                _plan(block)
                Path(folder, _plan_name(block) + _DONE).touch()


def _plan(block: BlockSpec) -> None:
    """Plan a path once; the search is compiled even where it finds none."""
    # an error of a lab's own world is raised again where the path is needed
    with suppress(Exception), closing(World(block.world, block.options)) as world:
        world.reset(0)
        world.path_length_bounds()


def _plan_name(block: BlockSpec) -> str:
    return f"{_name(block)}-plan"


def _pieces(block: BlockSpec) -> dict[str, Callable[[], None] | None]:
    """What there is to compile of a block's world, by names that all processes agree on; None stands for all of it."""
    world = World(block.world, block.options)
    world.close()
    return {f"{_name(block)}-{nth}": piece for nth, piece in enumerate(world.compile_pieces or (None,))}


def _name(block: BlockSpec) -> str:
    return f"{hash64(msgspec.json.encode((block.world, block.options))):x}"


def _begin(folder: str, name: str) -> bool:
    """Begin a piece, unless it has been begun."""
    try:
        Path(folder, name).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


@contextmanager
def paused_collection() -> Iterator[None]:
    """Meanwhile do not look for cycles at all: of compiling it is a tenth."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
