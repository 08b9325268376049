"""Wrappers of a lab's own hold for people: what is seen, what is kept, what begins anew."""

import numpy as np
import pytest
from msgspec.structs import replace

from minihuman.display.windows.window import VirtualClock
from minihuman.errors import WorldError
from minihuman.experiment.machine.session import SessionMachine
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from minihuman.worlds.hashing import hash64
from tests.log.samples import STARTED_NS, session_plan

RIGHT, FORWARD = 1, 2


def made(name: str) -> World:
    world = World(f"tests.worlds.wrapped:tests/{name}-v0")
    world.reset(0)
    return world


def test_who_is_blindfolded_by_a_wrapper_sees_nothing():
    world = made("Blindfold")
    assert world.frame().any()
    for _ in range(3):
        world.step(RIGHT)
    assert not world.frame().any()


def test_what_a_wrapper_keeps_begins_anew_with_each_episode():
    world = made("Bonus")

    def episode():
        world.reset(0)
        return [(world.step(action).reward, world.state_hash()) for action in (RIGHT, RIGHT, FORWARD)]

    first = episode()
    assert first[0][0] > first[1][0]  # the bonus falls, so there is something to leak
    assert episode() == first


def test_what_a_wrapper_keeps_is_saved_and_hashed():
    world, other = made("Bonus"), made("Bonus")
    saved = world.save()
    before = world.state_hash()
    for _ in range(4):
        world.step(RIGHT)
    assert world.scene_hash() != other.scene_hash()  # the same cell and direction, another bonus next
    world.restore(saved)
    assert world.state_hash() == before
    assert world.step(RIGHT) == other.step(RIGHT)


def test_a_wrapper_that_keeps_what_nobody_can_compare_is_refused():
    world = made("Secret")
    world.step(RIGHT)
    with pytest.raises(WorldError, match=r"Secretive\.last is a object"):
        world.state_hash()


def test_a_world_without_such_wrappers_hashes_as_it_is():
    world = World("minihuman/MiniGrid-Empty-5x5-v0")
    world.reset(0)
    assert world.state_hash() == world.unwrapped.state_hash()


def test_objects_have_no_hash():
    with pytest.raises(TypeError, match="no canonical form"):
        hash64(np.array(["a", None], dtype=object))


def test_a_world_that_does_not_close_leaves_a_finished_log(tmp_path, caplog):
    planned = session_plan(episodes=1)
    episodes = tuple(replace(each, world="tests.worlds.wrapped:tests/Failing-v0") for each in planned.episodes)
    planned = replace(planned, episodes=episodes)
    clock, session = VirtualClock(), SessionMachine(planned, World, {}, picture_px=None)
    window = SimulatedWindow(make_participant("random", np.random.default_rng(0)), session, clock)
    log = run_session(session, window, McapRecorder(tmp_path, planned, started_ns=STARTED_NS), clock)
    assert log is not None
    assert read_log(log).clean
    assert "the world did not close: RuntimeError: the lights stay on" in caplog.text
