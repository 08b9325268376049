"""Where Minigrid errs by accident and we do not: both behaviours, as the table in docs/grid-worlds.md says them."""

import gymnasium
import minigrid  # noqa: F401
import pytest
from minigrid.core.grid import Grid
from minigrid.core.mission import MissionSpace
from minigrid.envs import MemoryEnv
from minigrid.minigrid_env import MiniGridEnv

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.env import GridEnv
from minihuman.worlds.grid.items import wall
from minihuman.worlds.grid.world import GridWorld


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
    with pytest.raises(WorldError, match="after an end"):
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
    with pytest.raises(WorldError, match="the size is odd"):
        GridEnv("memory")
