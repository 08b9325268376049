"""The fewest possible steps, against every sequence of actions there is."""

from collections import deque

import msgspec
import pytest

from minihuman.dataset.measures import layout_path_bounds, world_options_json
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import UNKNOWN_BOUNDS
from tests.builders import plan


def shortest_path_bounds(plan):
    return layout_path_bounds(plan.world, world_options_json(plan), plan.seed)


def fewest_by_trying_everything(world_id, seed):
    """Breadth first over left, right and forward on the real world."""
    world = World(world_id)
    world.reset(seed)
    waiting = deque([(0, world.save())])
    seen = {world.pose()}
    while waiting:
        steps, saved = waiting.popleft()
        for action in range(3):
            world.restore(saved)
            if world.step(action).reward > 0:
                return steps + 1
            if world.pose() not in seen:
                seen.add(world.pose())
                waiting.append((steps + 1, world.save()))
    return None


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_in_the_grid_it_is_exact_turns_included(seed):
    world = "minihuman/MiniGrid-FourRooms-v0"
    found = shortest_path_bounds(msgspec.structs.replace(plan(), world=world, seed=seed))
    assert found.at_least == found.feasible == fewest_by_trying_everything(world, seed)


def test_in_first_person_a_way_is_known_and_none_can_be_shorter_than_said():
    for seed in (0, 1):
        found = shortest_path_bounds(msgspec.structs.replace(plan(kind="room"), seed=seed))
        assert 0 < found.at_least <= found.feasible <= 250


def test_where_no_planner_knows_the_goal_nothing_is_claimed():
    assert shortest_path_bounds(msgspec.structs.replace(plan(), world="CartPole-v1")) == UNKNOWN_BOUNDS
