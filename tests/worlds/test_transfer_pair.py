"""The GoToObj pair against its published facts, and against the same rules written on upstream's classes."""

import math

import gymnasium
import numpy as np
import pytest

from minihuman.errors import WorldError
from minihuman.worlds.go_to_obj import WALLS, draw_arrangement
from tests.counts import count

GRID = "minihuman/MiniGrid-GoToObj-Transfer-v0"
FIRST_PERSON = "minihuman/MiniWorld-GoToObj-Transfer-v0"
LEFT, RIGHT, FORWARD, TOGGLE = 0, 1, 2, 5

# from the middle, facing right: the fewest actions that face the object at each wall
GRID_WAYS = {
    "left": [LEFT, LEFT, *[FORWARD] * 3],
    "bottom": [RIGHT, *[FORWARD] * 3],
    "right": [FORWARD] * 3,
    "top": [LEFT, *[FORWARD] * 3],
}


def make(world_id, **options):
    return gymnasium.make(world_id, disable_env_checker=True, **options).unwrapped


def wall_of_target(seed, **options):
    return WALLS[draw_arrangement(np.random.default_rng(seed), **options).target]


@pytest.mark.parametrize(("world_id", "most"), [(GRID, 484), (FIRST_PERSON, 100)])
def test_going_to_the_target_ends_the_episode_with_the_published_reward(world_id, most):
    world = make(world_id)
    share = 0.9 if world_id == GRID else 0.2
    for seed in range(8):
        world.reset(seed=seed)
        way = GRID_WAYS[wall_of_target(seed)]
        *before, last = [world.step(action) for action in way]
        assert [step[1:3] for step in before] == [(0, False)] * len(before)
        assert last[1] == pytest.approx(1 - share * len(way) / most, abs=1e-12)
        assert last[2:4] == (True, False)


@pytest.mark.parametrize(("world_id", "most"), [(GRID, 484), (FIRST_PERSON, 100)])
def test_an_episode_ends_at_the_published_length(world_id, most):
    world = make(world_id)
    world.reset(seed=1)
    ends = [world.step(LEFT)[2:4] for _ in range(most)]
    assert ends == [(False, False)] * (most - 1) + [(False, True)]


def test_toggle_ends_a_grid_episode_with_nothing_unless_told_otherwise():
    world = make(GRID)
    world.reset(seed=1)
    assert world.step(TOGGLE)[1:4] == (0, True, False)
    world = make(GRID, toggle_ends=False)
    world.reset(seed=1)
    assert world.step(TOGGLE)[1:4] == (0, False, False)


def test_the_same_seed_is_the_same_task_in_both_worlds():
    grid, first_person = make(GRID), make(FIRST_PERSON)
    for seed in range(10):
        grid.reset(seed=seed)
        first_person.reset(seed=seed)
        assert grid.mission == first_person.mission
        places = [
            {
                thing.name: (round((thing.x - middle) / scale), round((thing.z - middle) / scale))
                for thing in world.map().things
            }
            for world, middle, scale in ((grid, 5, 4), (first_person, 4.5, 3.6))
        ]
        assert places[0] == places[1]


def test_missions_are_unambiguous_by_construction():
    rng = np.random.default_rng(1)
    assert all(draw_arrangement(rng).matches == 1 for _ in range(2000))


@pytest.mark.nightly(sample=True)
def test_the_published_ambiguity_is_an_option():
    rng = np.random.default_rng(1)
    tries = count(5_000, 100_000)
    share = np.mean([draw_arrangement(rng, ambiguous=True).matches > 1 for _ in range(tries)])
    expected = 1 - (17 / 18) ** 3
    assert share == pytest.approx(expected, abs=4 * math.sqrt(expected * (1 - expected) / tries))
    world = make(GRID, ambiguous=True)
    missions = {world.reset(seed=seed)[0]["mission"] for seed in range(200)}
    assert len(missions) == 18


def test_all_missions_are_about_equally_likely():
    rng = np.random.default_rng(2)
    missions = [draw_arrangement(rng).mission for _ in range(3600)]
    counts = [missions.count(mission) for mission in set(missions)]
    assert len(counts) == 18
    assert min(counts) > 140
    assert max(counts) < 260


def test_the_3d_world_can_take_the_published_agents_seven_actions():
    from minihuman.worlds.first_person.rules import ACTIONS

    assert make(FIRST_PERSON).action_names == ("turn_left", "turn_right", "move_forward")
    world = make(FIRST_PERSON, actions=ACTIONS[:7])
    world.reset(seed=1)
    before = world.pose()
    world.step(ACTIONS.index("move_back"))
    assert world.pose().x == pytest.approx(before.x - 0.9)


def test_a_room_without_space_is_refused():
    with pytest.raises(WorldError, match="size is 10; it must be an odd number from 5 to"):
        make(GRID, size=10)
    with pytest.raises(WorldError, match="size is 3; it must be a number, 5 to"):
        make(FIRST_PERSON, size=3)


@pytest.mark.nightly(sample=True)
def test_the_grid_plays_like_the_same_world_on_minigrid():
    from benchmarks.upstream_grid import UpstreamGrid

    ours = make(GRID)
    rng = np.random.default_rng(3)
    for seed in range(count(6, 200)):
        seen, _ = ours.reset(seed=seed)
        drawn = draw_arrangement(np.random.default_rng(seed))
        theirs = UpstreamGrid(drawn)
        expected, _ = theirs.reset(seed=seed)
        ended = False
        while not ended:
            assert seen["mission"] == expected["mission"]
            np.testing.assert_array_equal(seen["image"], expected["image"])
            action = int(rng.choice(7, p=[0.2, 0.2, 0.46, 0.05, 0.05, 0.02, 0.02]))
            seen, *ours_say, _ = ours.step(action)
            expected, *they_say, _ = theirs.step(action)
            assert ours_say == pytest.approx(they_say)
            ended = any(ours_say[1:])
