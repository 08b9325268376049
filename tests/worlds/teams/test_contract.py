"""Every team world: PettingZoo's own checks, save and restore, hashes, refusals."""

import warnings

import numpy as np
import pytest

import minihuman
from minihuman.errors import WorldError
from minihuman.worlds.catalogue import TEAM_WORLDS

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of PettingZoo's own, as it imports its examples
    from pettingzoo.test import parallel_api_test, parallel_seed_test

IDS = [entry.id for entry in TEAM_WORLDS]
FOUR_ROOMS = "minihuman/Team-FourRooms-v0"


def random_actions(world, steps, seed=0):
    """So many joint actions, each a list."""
    return np.random.default_rng(seed).integers(0, len(world.action_names), (steps, world.bodies)).tolist()


@pytest.mark.parametrize("world_id", IDS)
def test_pettingzoo_finds_nothing_wrong(world_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(minihuman.parallel_env(world_id), num_cycles=150)
        parallel_seed_test(lambda: minihuman.parallel_env(world_id), num_cycles=50)


@pytest.mark.parametrize("world_id", IDS)
def test_the_same_seed_and_actions_give_the_same_episode(world_id):
    first, second = minihuman.make_team(world_id), minihuman.make_team(world_id)
    first.reset(7)
    second.reset(7)
    for actions in random_actions(first, 40):
        steps = first.step(actions), second.step(actions)
        assert steps[0] == steps[1]
        assert first.state_hash() == second.state_hash()
        for body in range(first.bodies):
            assert first.pose(body) == second.pose(body)
            assert np.array_equal(first.observation(body), second.observation(body))
            assert first.observation_space.contains(first.observation(body))
        if steps[0].terminated or steps[0].truncated:
            break
    assert np.array_equal(first.frame(1, 300, 200), second.frame(1, 300, 200))


@pytest.mark.parametrize("world_id", IDS)
def test_a_saved_state_is_gone_back_to_any_number_of_times(world_id):
    world = minihuman.make_team(world_id)
    world.reset(3)
    actions = random_actions(world, 12)
    for each in actions[:5]:
        world.step(each)
    saved, hashed = world.save(), world.state_hash()

    def play():
        return [world.step(each) for each in actions[5:]], world.state_hash(), world.observation(1).tobytes()

    once = play()
    world.restore(saved)
    assert world.state_hash() == hashed
    assert play() == once
    world.restore(saved)
    assert play() == once


@pytest.mark.parametrize("world_id", IDS)
def test_a_picture_fits_and_a_map_has_walls(world_id):
    world = minihuman.make_team(world_id)
    world.reset(0)
    frame = world.frame(0, 200, 160)
    height, width, depth = frame.shape
    assert (frame.dtype, depth) == (np.uint8, 3)
    assert height <= 160
    assert width <= 200
    assert world.map().walls
    assert world.mission


def test_what_is_no_joint_action_is_refused_and_changes_nothing():
    world = minihuman.make_team(FOUR_ROOMS)
    with pytest.raises(WorldError, match="not in an episode"):
        world.step([0, 0])
    world.reset(0)
    before = world.state_hash()
    for wrong, why in (([0], "1 actions were given, but the world has 2 bodies"), ([0, 7], "action 7 of body 1")):
        with pytest.raises(WorldError, match=why):
            world.step(wrong)
    assert world.state_hash() == before


def test_a_world_of_one_body_is_no_team():
    with pytest.raises(WorldError, match="is not a team world"):
        minihuman.make_team("minihuman/MiniGrid-FourRooms-v0")
    with pytest.raises(WorldError, match="Team-Nothing"):
        minihuman.make_team("minihuman/Team-Nothing-v0")
    with pytest.raises(WorldError, match="options"):
        minihuman.make_team(FOUR_ROOMS, colour="red")
