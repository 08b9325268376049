import gymnasium
import minigrid
import numpy as np
import pytest

from minihuman.errors import WorldError
from minihuman.worlds.grid.core import rewards
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import ball, box, door, goal, key


class KeyAndDoor(GridWorld):
    """DoorKey as a user would write it."""

    def __init__(self, size=8, **options):
        mission = "use the key to open the door and then get to the goal"
        super().__init__(width=size, height=size, max_steps=10 * size**2, mission=mission, **options)

    def layout(self, grid):
        grid.wall_rect()
        grid.put(goal(), grid.width - 2, grid.height - 2)
        split = grid.integer(2, grid.width - 2)
        grid.down(split, 0)
        grid.place_agent(size=(split, grid.height))
        grid.put(door("yellow", locked=True), split, grid.integer(1, grid.width - 2))
        grid.place(key("yellow"), size=(split, grid.height))


def test_a_world_written_in_fifteen_lines_is_the_one_minigrid_has():
    ours, theirs = KeyAndDoor(), gymnasium.make("MiniGrid-DoorKey-8x8-v0")
    chance = np.random.default_rng(3)
    for seed in range(10):
        ours.reset(seed=seed)
        theirs.reset(seed=seed)
        for action in chance.integers(0, 7, 60).tolist():
            ours_step, theirs_step = ours.step(action), theirs.step(action)
            np.testing.assert_array_equal(ours_step[0]["image"], theirs_step[0]["image"])
            assert ours_step[1:4] == theirs_step[1:4]
            if ours_step[2]:
                break
    assert minigrid


class OpenTheBox(GridWorld):
    """Success is to find the key in the box."""

    def __init__(self):
        super().__init__(width=5, height=5, max_steps=20, mission="find the key")

    def layout(self, grid):
        grid.wall_rect()
        grid.put(box("red", contains=key("blue")), 2, 1)
        grid.put_agent(1, 1)
        grid.task(rewards.PICK, 2)


def test_what_a_box_contains_is_an_object_with_its_own_identity():
    world = OpenTheBox()
    world.reset(seed=0)
    assert world.step(3)[1:3] == (0.0, False)  # the box itself is not it
    world.reset(seed=0)
    world.step(5)
    assert world.step(3)[1:3] == (1 - 0.9 * (2 / 20), True)


class Tired(OpenTheBox):
    def reward_and_done(self, action, reward, terminated):
        return reward - 0.1, terminated or self.state.step == 3


def test_a_world_may_judge_its_steps_itself():
    world = Tired()
    world.reset(seed=0)
    assert [world.step(0)[1:3] for _ in range(3)] == [(-0.1, False), (-0.1, False), (-0.1, True)]
    with pytest.raises(WorldError, match="call reset"):
        world.step(0)


class AllGoals(GridWorld):
    """A goal is one of several things to be collected: the episode goes on."""

    def __init__(self):
        super().__init__(width=8, height=3, max_steps=5, mission="collect the goals")

    def layout(self, grid):
        grid.wall_rect()
        grid.put(goal(), 2, 1)
        grid.put(goal(), 4, 1)
        grid.put_agent(1, 1)

    def reward_and_done(self, action, reward, terminated):
        return (1.0 if terminated else 0.0), False


def test_a_world_that_says_of_a_goal_that_it_is_no_end_goes_on():
    world = AllGoals()
    world.reset(seed=0)
    assert [world.step(2)[1:4] for _ in range(5)] == [
        (1.0, False, False),
        (0.0, False, False),
        (1.0, False, False),
        (0.0, False, False),
        (0.0, False, True),
    ]
    with pytest.raises(WorldError, match="call reset"):
        world.step(2)


class Among(GridWorld):
    """Balls that move by themselves, as in Dynamic-Obstacles."""

    def __init__(self):
        super().__init__(width=8, height=8, max_steps=20, mission="reach the goal")

    def layout(self, grid):
        grid.wall_rect()
        grid.put(goal(), 6, 6)
        grid.put_agent(1, 1)
        for _ in range(3):
            grid.place(ball("blue"), top=(3, 3))
        grid.task(rewards.DODGE, 3)


def places_of_balls(world):
    found = []
    for _ in range(6):
        world.step(rewards.LEFT)
        found.append(world.text())
    return found


def test_obstacles_of_an_own_world_move_by_its_random_stream():
    world, other = Among(), Among()
    world.reset(seed=0)
    saved, stream = world.save(), world.np_random.bit_generator.state
    moved = places_of_balls(world)
    assert len(set(moved)) > 1
    assert world.np_random.bit_generator.state != stream
    world.restore(saved)
    assert places_of_balls(world) == moved
    other.restore(saved)  # one that was never laid out itself
    assert places_of_balls(other) == moved
    world.reset(seed=1)
    assert places_of_balls(world) != moved
