"""Where Minigrid errs by accident and we do not: both behaviours, as the table in docs/grid-worlds.md says them."""

import inspect
import math

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest
from minigrid.core.grid import Grid
from minigrid.core.mission import MissionSpace
from minigrid.core.world_object import Ball, Wall
from minigrid.envs import MemoryEnv
from minigrid.minigrid_env import MiniGridEnv

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import BALL, BOX, DOOR, EMPTY
from minihuman.worlds.grid.core.rewards import cell_in_front
from minihuman.worlds.grid.env import GridEnv, GridWorld
from minihuman.worlds.grid.object_kinds import wall
from minihuman.worlds.grid.planner import plan


class TheirOpen(MiniGridEnv):
    def __init__(self):
        super().__init__(MissionSpace(lambda: ""), grid_size=4, max_steps=9)

    def _gen_grid(self, width, height):
        self.grid = Grid(width, height)
        self.agent_pos, self.agent_dir = (0, 0), 2


class OurOpen(GridWorld):
    def __init__(self):
        super().__init__(width=4, height=4, max_steps=9)

    def layout(self, grid):
        grid.put_agent(0, 0, 2)


def test_facing_out_of_the_grid():
    theirs, ours = TheirOpen(), OurOpen()
    theirs.reset(seed=0)
    with pytest.raises(AssertionError):
        theirs.step(2)
    ours.reset(seed=0)
    observation = ours.step(2)[0]
    assert ours.state.position == (0, 0)
    assert observation["image"][3, 5, 0] == 2  # a wall ahead


def test_an_action_that_dynamic_obstacles_do_not_have():
    name = "MiniGrid-Dynamic-Obstacles-5x5-v0"
    theirs, ours = gymnasium.make(name, disable_env_checker=True), gymnasium.make(f"minihuman/{name}")
    theirs.reset(seed=0)
    assert theirs.step(5)[0]["direction"] == 3  # "toggle" turned it left
    ours.reset(seed=0)
    with pytest.raises(WorldError, match="0 to 2"):
        ours.step(5)


def test_a_step_after_the_end():
    name = "MiniGrid-Empty-5x5-v0"
    theirs, ours = gymnasium.make(name), gymnasium.make(f"minihuman/{name}")
    for env in (theirs, ours):
        env.reset(seed=0)
        for action in (2, 2, 1, 2, 2):
            *_, terminated, _, _ = env.step(action)
        assert terminated
    theirs.step(0)
    theirs.step(0)
    theirs.step(2)
    theirs.step(0)
    theirs.step(0)
    assert theirs.step(2)[1] > 0  # the same goal pays twice
    with pytest.raises(WorldError, match="after each episode"):
        ours.step(0)


def test_grey_and_green_in_text():
    class Walls(GridWorld):
        def __init__(self):
            super().__init__(width=3, height=3, max_steps=9)

        def layout(self, grid):
            grid.put(wall("green"), 0, 0)
            grid.put(wall("grey"), 1, 0)
            grid.put_agent(1, 1)

    theirs, ours = gymnasium.make("MiniGrid-Empty-5x5-v0"), Walls()
    theirs.reset(seed=0)
    printed = theirs.unwrapped.pprint_grid()
    assert printed[:2] == "WG"  # a grey wall
    assert printed.splitlines()[3][6:8] == "GG"  # the green goal
    ours.reset(seed=0)
    assert ours.text().splitlines()[0] == "WgWW  "


def test_the_default_size_of_memory():
    theirs = MemoryEnv()
    with pytest.raises(AssertionError):
        theirs.reset(seed=0)
    with pytest.raises(WorldError, match="size is 8; it must be an odd number"):
        GridEnv("memory")


def test_no_free_cell_left_to_place_something():
    theirs = TheirOpen()
    theirs.reset(seed=0)
    for x in range(4):
        for y in range(4):
            theirs.grid.set(x, y, Wall())
    assert inspect.signature(theirs.place_obj).parameters["max_tries"].default == math.inf  # it would never return
    with pytest.raises(RecursionError):
        theirs.place_obj(Ball(), max_tries=1000)
    with pytest.raises(
        WorldError, match="numObjs is 4; it must be a whole number from 1 to 3"
    ):  # and the agent takes the fourth
        GridEnv("fetch", size=4, numObjs=4)


def both(name, seed=0, **options):
    theirs, ours = gymnasium.make(name, **options), gymnasium.make(f"minihuman/{name}", **options)
    theirs.reset(seed=seed)
    ours.reset(seed=seed)
    return theirs, ours


@pytest.mark.filterwarnings("ignore:.*out of date")
@pytest.mark.parametrize(("version", "rooms"), [(0, 6), (1, 4)])
def test_multi_room_n4_s5_has_six_rooms_until_version_1(version, rooms):
    theirs, ours = both(f"MiniGrid-MultiRoom-N4-S5-v{version}")
    assert len(theirs.unwrapped.rooms) == rooms
    assert (ours.unwrapped.state.kinds == DOOR).sum() == rooms - 1


@pytest.mark.filterwarnings("ignore:.*out of date")
@pytest.mark.parametrize(("version", "lost"), [(0, True), (1, False)])
def test_a_ball_may_be_put_on_the_box_with_the_key_until_version_1(version, lost):
    name = f"MiniGrid-ObstructedMaze-2Dlhb-v{version}"
    theirs, ours = gymnasium.make(name), gymnasium.make(f"minihuman/{name}")
    counted = []
    for seed in range(100):
        theirs.reset(seed=seed)
        ours.reset(seed=seed)
        boxes = (ours.unwrapped.state.kinds == BOX).sum()
        assert boxes == (theirs.unwrapped.grid.encode()[..., 0] == BOX).sum()
        counted.append(boxes)
    assert (min(counted) < 2) == lost


@pytest.mark.parametrize("leaves", [True, False], ids=["one that leaves", "one that comes"])
def test_only_a_ball_that_was_ahead_before_it_moved_ends_the_episode(leaves):
    theirs, ours = both("MiniGrid-Dynamic-Obstacles-5x5-v0", max_steps=10**6)
    chance = np.random.default_rng(0)
    for _ in range(10_000):
        x, y = cell_in_front(ours.unwrapped.state.row)
        before = ours.unwrapped.state.kinds[x, y]
        action = 2 if before == (BALL if leaves else EMPTY) else int(chance.integers(2))
        _, its_reward, its_end, *_ = theirs.step(action)
        _, reward, end, *_ = ours.step(action)
        assert (reward, end) == (its_reward, its_end)
        after = ours.unwrapped.state.kinds[x, y]
        if action == 2 and (before == BALL) != (after == BALL):
            assert (reward, end) == ((-1, True) if leaves else (0, False))
            return
        if end:
            theirs.reset()
            ours.reset()
    pytest.fail("no ball left or came")


def test_picking_up_does_not_end_go_to_object():
    theirs, ours = both("MiniGrid-GoToObject-6x6-N2-v0")
    *way, _ = plan(ours.unwrapped.state)  # the last action is "done", beside the object
    for action in way:
        theirs.step(action)
        ours.step(action)
    for _ in range(4):  # whichever way the object is
        for action in (3, 0):
            assert theirs.step(action)[1:4] == ours.step(action)[1:4] == (0, False, False)
    assert ours.unwrapped.state.carrying != EMPTY
