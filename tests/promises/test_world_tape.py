"""What the tape of a proof says is what the world would say, and what it does not have is computed."""

import numpy as np
import pytest

from minihuman.admin.verify.world_tape import WorldTape
from minihuman.worlds.adapters.world import World

WORLDS = (
    "minihuman/MiniGrid-FourRooms-v0",
    "minihuman/BabyAI-GoToSeqS5R2-v0",
    "minihuman/MiniGrid-Dynamic-Obstacles-6x6-v0",
    "minihuman/MiniWorld-OneRoom-v0",
)


def _walk(world: World, seed: int, n_steps: int = 25) -> list[object]:
    """Return all that a session asks of a world in a random walk, which may end early."""
    rng = np.random.default_rng(seed)
    answers: list[object] = [world.reset(seed), world.state_hash(), world.pose(), world.map()]
    for action in rng.integers(len(world.action_names), size=n_steps):
        result = world.step(int(action))
        answers += [result, world.pose(), world.state_hash(), world.subgoals()]
        if result.terminated or result.truncated:
            break
    return answers


def _count_steps(world: World, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list to which each step of the environment is added."""
    steps: list[int] = []
    env = world._env
    step = env.step
    monkeypatch.setattr(env, "step", lambda action: (steps.append(action), step(action))[1])
    return steps


@pytest.mark.parametrize("world_id", WORLDS)
def test_a_second_replay_says_the_same_without_a_step_of_the_environment(world_id, monkeypatch):
    tape = WorldTape()
    expected = _walk(World(world_id), seed=3)
    assert _walk(tape.make_world(world_id), seed=3) == expected
    again = tape.make_world(world_id)
    steps = _count_steps(again, monkeypatch)
    assert _walk(again, seed=3) == expected
    again.close()
    assert steps == []


@pytest.mark.parametrize("world_id", WORLDS)
def test_another_action_in_mid_episode_is_played_singly(world_id):
    tape = WorldTape()
    _walk(tape.make_world(world_id), seed=3)
    worlds = World(world_id), tape.make_world(world_id)
    for world in worlds:
        world.reset(3)
    actions = [0, 0, 1, 1, 0, 0]
    results = [[world.step(action) for action in actions] for world in worlds]
    assert results[0] == results[1]
    assert worlds[0].state_hash() == worlds[1].state_hash()


def test_pictures_and_copies_are_of_the_moment_that_the_tape_has_reached():
    tape = WorldTape()
    _walk(tape.make_world("minihuman/MiniGrid-FourRooms-v0"), seed=5)
    plain, taped = World("minihuman/MiniGrid-FourRooms-v0"), tape.make_world("minihuman/MiniGrid-FourRooms-v0")
    actions = np.random.default_rng(5).integers(len(plain.action_names), size=25)
    for world in (plain, taped):
        world.reset(5)
        for action in actions[:12]:
            world.step(int(action))
    assert (taped.frame() == plain.frame()).all()
    assert taped.text() == plain.text()
    saved = taped.save()
    for action in actions[12:]:
        assert taped.step(int(action)) == plain.step(int(action))
    taped.restore(saved)
    for action in actions[12:]:
        taped.step(int(action))
    assert taped.state_hash() == plain.state_hash()


def test_options_seeds_and_order_do_not_mix():
    tape = WorldTape()
    first = _walk(tape.make_world("minihuman/MiniGrid-Empty-Random-6x6-v0"), seed=1)
    other = _walk(tape.make_world("minihuman/MiniGrid-Empty-Random-6x6-v0", {"max_steps": 9}), seed=1)
    assert first == _walk(World("minihuman/MiniGrid-Empty-Random-6x6-v0"), seed=1)
    assert other == _walk(World("minihuman/MiniGrid-Empty-Random-6x6-v0", {"max_steps": 9}), seed=1)


def test_what_an_agent_reaches_into_is_off_the_tape():
    tape = WorldTape()
    _walk(tape.make_world("minihuman/MiniGrid-FourRooms-v0"), seed=2)
    plain, taped = World("minihuman/MiniGrid-FourRooms-v0"), tape.make_world("minihuman/MiniGrid-FourRooms-v0")
    for world in (plain, taped):
        world.reset(2)
        world.unwrapped.agent_pos = (2, 2)
    assert taped.step(0) == plain.step(0)
    assert taped.pose() == plain.pose()
