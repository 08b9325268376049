"""Worlds that an author writes with our classes: what they add is kept, and what they get wrong is named."""

import numpy as np
import pytest
from gymnasium import spaces

from minihuman.errors import WorldError
from minihuman.testing.checks import ContractError
from minihuman.testing.world_contract import check_world
from minihuman.worlds.first_person.rooms import Room, finish_floor_plan, outline_of, rectangle
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import ball
from minihuman.worlds.grid.team_grid import TeamGrid
from minihuman.worlds.team import make_team


class Healthy(GridWorld):
    """Adds the agent's health to what it observes."""

    def __init__(self, render_mode=None, *, actions=7, most=5):
        super().__init__(width=6, height=6, max_steps=20, actions=actions, render_mode=render_mode)
        self.observation_space = spaces.Dict({**self.observation_space.spaces, "health": spaces.Discrete(most)})

    def layout(self, grid):
        grid.wall_rect()
        grid.put_agent(1, 1, 0)

    def observation(self):
        return {**super().observation(), "health": 4}


class Looking(Healthy):
    """Earns nothing, and says so itself."""

    def reward_and_done(self, action, reward, terminated):
        return 0.0, False


@pytest.mark.parametrize("world", [Healthy, Looking])
def test_an_observation_of_ones_own_counts_in_reset_and_step(world):
    env = world()
    observed, _ = env.reset(seed=0)
    stepped, *_ = env.step(2)
    assert observed["health"] == stepped["health"] == 4
    assert stepped in env.observation_space


def test_check_world_names_the_line_that_makes_an_observation_outside_its_space():
    with pytest.raises(
        ContractError, match=r"\['health'\] is 4, and its space holds 0 to 2; Healthy.observation \(test_own"
    ):
        check_world(Healthy, {"most": 3}, search_steps=20)


def test_there_are_as_many_action_names_as_actions_and_none_without_a_rule():
    with pytest.raises(WorldError, match="actions is 9, but Healthy has the grid's 7 alone"):
        Healthy(actions=9)
    assert Looking(actions=9).action_names[6:] == ("done", "action_7", "action_8")
    assert Healthy(actions=3).action_names == ("left", "right", "forward")


class Harvest(TeamGrid):
    """Two bodies; counts the steps that each made forward."""

    bodies = 2
    kept = ("eaten",)

    def __init__(self):
        super().__init__(width=7, height=7, max_steps=40, mission="eat")

    def layout(self, grid):
        grid.wall_rect()
        grid.put(ball("red"), 3, 3)
        grid.put_agent(1, 1, 0, body=0)
        grid.put_agent(5, 5, 2, body=1)
        self.eaten = [0, 0]

    def reward_and_done(self, actions, rewards, terminated):
        self.eaten = [eaten + (action == 2) for eaten, action in zip(self.eaten, actions, strict=True)]
        return rewards, max(self.eaten) >= 6


class Forgetful(Harvest):
    """Forgets to say what it keeps."""

    kept = ()


def test_a_teams_own_attributes_are_saved_and_restored():
    world = Harvest()
    world.reset(0)
    world.step([2, 0])
    saved, state = world.save(), world.state_hash()
    world.step([2, 2])
    assert world.state_hash() != state
    world.restore(saved)
    assert (world.eaten, world.state_hash()) == ([1, 0], state)
    world.eaten[0] = 9
    world.restore(saved)
    assert world.eaten == [1, 0]


def test_check_world_names_a_teams_attribute_that_does_not_come_back():
    from minihuman.worlds.adapters.seat import SeatEnv

    check_world(lambda render_mode=None: SeatEnv(Harvest()), search_steps=40)
    with pytest.raises(ContractError, match="eaten changes in an episode and does not come back"):
        check_world(lambda render_mode=None: SeatEnv(Forgetful()), search_steps=40)


@pytest.mark.parametrize("world_id", ["minihuman/Team-FourRooms-v0", "minihuman/Team-FourRooms3D-v0"])
def test_a_team_begins_without_a_seed(world_id):
    world = make_team(world_id)
    world.reset()
    world.reset(7)
    world.reset()
    after = world.state_hash()
    world.reset(7)
    world.reset()
    assert world.state_hash() == after


def test_rooms_that_overlap_are_named():
    with pytest.raises(WorldError, match=r"room 0 \(x 0 to 5, z 0 to 5\) and room 1 \(x 2 to 7, z 2 to 6\) overlap"):
        finish_floor_plan([Room(rectangle(0, 5, 0, 5)), Room(rectangle(2, 7, 2, 6))], None)


def test_rooms_that_touch_or_lie_across_a_corner_do_not_overlap():
    corner = outline_of(((9.0, 9.0), (9.0, 2.0), (2.0, 9.0)))
    plan = finish_floor_plan([Room(rectangle(0, 5, 0, 5)), Room(rectangle(5, 7, -2, 3)), Room(corner)], None)
    assert len(plan.rooms) == 3
    assert np.isfinite(plan.walls).all()
