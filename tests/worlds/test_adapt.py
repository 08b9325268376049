import math

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.classic_control import CartPoleEnv

from minihuman.errors import WorldError
from minihuman.worlds.adapters.world import World

CORRIDOR = "tests.worlds.corridor:tests/Corridor-v0"
DOOR_KEY = "minigrid:MiniGrid-DoorKey-8x8-v0"


@pytest.mark.parametrize("world_id", [CORRIDOR, DOOR_KEY, "minigrid:MiniGrid-FourRooms-v0", "CartPole-v1"])
def test_the_same_seed_and_actions_give_the_same_hashes(world_id):
    def played():
        world = World(world_id)
        seen = [world.reset(5), world.state_hash()]
        for action in (0, 1, 1, 0):
            seen += [world.step(action), world.state_hash()]
        return seen

    assert played() == played()


@pytest.mark.parametrize(
    "world_id", [CORRIDOR, DOOR_KEY, "CartPole-v1", "tests.worlds.corridor:tests/LimitedCorridor-v0"]
)
def test_a_saved_state_is_gone_back_to_exactly_and_more_than_once(world_id):
    world = World(world_id)
    world.reset(3)
    world.step(0)
    saved, before = world.save(), world.state_hash()
    after = (world.step(1), world.state_hash())
    for _ in range(2):
        world.restore(saved)
        assert world.state_hash() == before
        assert (world.step(1), world.state_hash()) == after


def test_a_minigrid_world_of_a_third_party_has_names_mission_pose_and_map():
    world = World(DOOR_KEY)
    assert world.reset(0).mission == "use the key to open the door and then get to the goal"
    assert world.action_names[:4] == ("left", "right", "forward", "pickup")
    env = world.unwrapped
    pose = world.pose()
    assert (pose.x, pose.z) == tuple(env.agent_pos)
    direction = np.array([math.cos(pose.yaw_rad), -math.sin(pose.yaw_rad)])
    assert np.allclose(direction, env.dir_vec)
    floor_plan = world.map()
    assert floor_plan.unit == "cell"
    assert floor_plan.bounds == (-0.5, -0.5, 7.5, 7.5)
    assert {thing.name for thing in floor_plan.things} == {"yellow door", "yellow key", "green goal"}
    assert (0.5, 0.5, 0.5, 6.5) in floor_plan.walls
    assert world.frame("full", (400, 300)).shape == (296, 296, 3)
    assert world.frame("partial", (400, 300)).shape == (294, 294, 3)


def things(world: World) -> list[tuple[str, float, float]]:
    return sorted((thing.name, thing.x, thing.z) for thing in world.map().things)


@pytest.mark.parametrize("name", ["MiniGrid-FourRooms-v0", "MiniGrid-DoorKey-8x8-v0"])
def test_what_is_read_off_a_minigrid_world_is_what_ours_says_of_itself(name):
    theirs, ours = World(f"minigrid:{name}"), World(f"minihuman/{name}")
    assert theirs.reset(7) == ours.reset(7)
    assert theirs.action_names == ours.action_names
    for action in (0, 2, 1, 2):
        assert theirs.step(action) == ours.step(action)
        assert theirs.pose() == ours.pose()
        assert (theirs.map().walls, theirs.map().bounds) == (ours.map().walls, ours.map().bounds)
        assert things(theirs) == things(ours)


def test_drawing_changes_no_state():
    world = World(DOOR_KEY)
    world.reset(0)
    before = world.state_hash()
    world.frame("full")
    world.frame("partial")
    assert world.state_hash() == before


class Unnamed(CartPoleEnv):
    """A world whose actions have no names."""


def test_a_world_without_names_counts_its_actions_and_has_neither_pose_nor_map(monkeypatch):
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    gymnasium.register("Unnamed-v0", Unnamed)
    world = World("Unnamed-v0")
    world.reset(1)
    assert world.action_names == ("0", "1")
    assert world.pose() is None
    assert world.map() is None
    assert world.frame().dtype == np.uint8


def test_an_action_that_does_not_exist_is_refused():
    world = World(CORRIDOR)
    world.reset(0)
    with pytest.raises(WorldError, match="action 5 does not exist; actions are 0 to 4"):
        world.step(5)


@pytest.mark.filterwarnings("ignore:.*render_mode='rgb_array' that is not")  # Gymnasium's, before our own words
@pytest.mark.parametrize(
    ("world_id", "options", "said"),
    [
        ("NoSuchWorld-v0", {}, "NoSuchWorld"),
        ("no_such_package:Maze-v0", {}, "install the package"),
        ("tests.worlds.corridor:tests/PictureLess-v0", {}, "no render mode 'rgb_array'"),
        (CORRIDOR, {"length": 3}, "options {'length': 3} are invalid"),
    ],
)
def test_a_world_that_cannot_be_played_says_why_in_one_line(world_id, options, said):
    with pytest.raises(WorldError) as caught:
        World(world_id, options)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
