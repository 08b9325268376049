"""A protocol tried against its worlds before anybody sits down."""

import os
import subprocess
import sys
import time
from itertools import groupby

import pytest
from msgspec.structs import replace

from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.runtime.warm_up import share_compilation, warm_up
from tests.counts import PATIENCE_S

TOML = """
[study]
name = "rehearsal"
version = "1"
seed = 1
[keys]
pool = ["1", "2"]
[[groups]]
name = "all"
blocks = ["only"]
[[blocks]]
name = "only"
world = {world!r}
episodes = 1
max_steps = 2
actions = [{action!r}]
"""


def protocol(world: str, action: str) -> Protocol:
    return decode_protocol(TOML.format(world=world, action=action).encode())


def test_a_world_that_fails_at_its_first_step_is_named_before_anybody_sits_down():
    corridor = "tests.worlds.corridor:tests/Corridor-v0"
    warm_up(protocol(corridor, "forward"), "study.toml")
    with pytest.raises(ProtocolError) as caught:
        warm_up(protocol(corridor, "crash"), "study.toml")
    assert str(caught.value) == (
        f"study.toml: $.blocks[0].world: {corridor} cannot be played (RuntimeError: the corridor has collapsed)"
    )


@pytest.mark.program
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled then")
@pytest.mark.skipif(os.cpu_count() == 1, reason="there is no core for a second process")
def test_where_something_is_compiled_a_second_process_takes_what_is_not_begun_from_the_last_on(tmp_path):
    notes = tmp_path / "notes.txt"
    alone = protocol("tests.worlds.compiled_corridor:tests/CompiledCorridor-v0", "forward")
    names = ("near", "far", "farthest", "near")
    options = [{"notes": str(notes), "name": name, "after": "far" if name == "near" else None} for name in names]
    study = replace(alone, blocks=tuple(replace(alone.blocks[0], options=each) for each in options))

    def elsewhere() -> list[str]:
        notes.write_text("")
        warm_up(study)
        here, lines = str(os.getpid()), [line.split() for line in notes.read_text().splitlines()]
        # each world is laid out several times
        assert [name for name, _ in groupby(name for name, process in lines if process == here)] == list(names)
        return [name for name, _ in groupby(name for name, process in lines if process != here)]

    assert elsewhere() == ["farthest", "far"]
    assert elsewhere() == []  # all is compiled in this process now


@pytest.mark.program
@pytest.mark.skipif(os.cpu_count() == 1, reason="there is no core for a second process")
def test_what_is_needed_later_and_ways_are_compiled_behind_while_the_first_world_is_played(tmp_path):
    notes = tmp_path / "notes.txt"
    notes.touch()
    alone = protocol("tests.worlds.compiled_corridor:tests/CompiledCorridor-v0", "forward")
    now, later = (
        replace(alone.blocks[0], options={"notes": str(notes), "name": name, "after": None})
        for name in ("now", "later")
    )
    with share_compilation([now], [later], plans=True) as process:
        process.start()
        warm_up(replace(alone, blocks=(now,)), process=process)
        deadline = time.monotonic() + PATIENCE_S
        # each world is laid out six times for a step, and once more for a way
        while (lines := notes.read_text().splitlines()) and (
            [line.split()[0] for line in lines if str(os.getpid()) not in line].count("later") < 7
            and time.monotonic() < deadline
        ):
            time.sleep(0.05)
        assert {line.split()[0] for line in lines if str(os.getpid()) in line} == {"now"}
        warm_up(replace(alone, blocks=(later,)), process=process)  # it only plays it, as ever
        process.compile_plan(later)
    assert time.monotonic() < deadline


@pytest.mark.program
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled then")
@pytest.mark.parametrize("world", ["MiniGrid-FourRooms-v0", "MiniWorld-FourRooms-v0"])
def test_what_is_compiled_apart_is_all_but_the_layout(world):
    """In a fresh process: or two of them would not share the work, but both do all of it."""
    script = f"""
import gc
from numba.core.registry import CPUDispatcher
from minihuman.worlds.adapters.world import World

def loaded():
    functions = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]
    return {{(each.py_func.__module__, each.py_func.__name__, types) for each in functions for types in each.overloads}}

world = World("minihuman/{world}")
for piece in world.compile_pieces:
    piece()
before = loaded()
assert before
world.reset(0)
world.step(0), world.map(), world.pose(), world.state_hash(), world.frame("partial"), world.frame("full")
print(*{{module for module, name, types in loaded() - before}})
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    layout = (
        {"minihuman.worlds.grid.layouts.rooms", "minihuman.worlds.grid.core.placement"} if "Grid" in world else set()
    )
    assert set(ran.stdout.split()) <= layout


@pytest.mark.program
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled then")
def test_after_warming_up_an_episode_compiles_nothing(tmp_path):
    """In a fresh process: a freeze in front of a participant would be the worst moment for it."""
    script = f"""
import gc
from numba.core.registry import CPUDispatcher
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.warm_up import warm_up
from minihuman.worlds.adapters.world import World

def loaded():
    return sum(len(each.signatures) for each in gc.get_objects() if isinstance(each, CPUDispatcher))

warm_up(decode_protocol({TOML.format(world="minihuman/MiniGrid-FourRooms-v0", action="forward").encode()!r}))
before = loaded()
world = World("minihuman/MiniGrid-FourRooms-v0")
for seed in range(3):
    world.reset(seed)
    for action in (2, 0, 1, 2, 2):
        world.step(action), world.pose(), world.map(), world.state_hash()
        for size_px in ((640, 480), (448, 448), (1920, 1080)):  # tiles of 68, 64 and 154 pixels
            world.frame(size_px=size_px)
print(before > 0, loaded() - before)
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["True", "0"]
