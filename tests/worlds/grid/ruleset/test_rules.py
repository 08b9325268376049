"""Worlds of rules: XLand-MiniGrid's transitions and tasks, our batches, copies, texts, files and plans."""

import os
import pickle
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.ruleset import dynamics as numbers
from minihuman.worlds.grid.ruleset.encodings import encode_tasks
from minihuman.worlds.grid.ruleset.env import RulesetWorld
from minihuman.worlds.grid.ruleset.generator import PRESETS, generate_tasks
from minihuman.worlds.grid.ruleset.instructions import describe_task
from minihuman.worlds.grid.ruleset.tasks import (
    RuleGoal,
    RuleTask,
    TileRule,
    build_task_set,
    find_task_set,
    packaged_sets,
    parse_task,
    read_task_set,
)
from tests.worlds.grid.ruleset import xminigrid_oracle

RED_BALL, BLUE_KEY, GREEN_STAR = (numbers.BALL | 1 << 4, numbers.KEY | 3 << 4, numbers.STAR | 2 << 4)
RECIPE = RuleTask(
    RuleGoal(numbers.GOAL_HOLD, GREEN_STAR),
    (TileRule(numbers.TILE_NEAR, RED_BALL, BLUE_KEY, GREEN_STAR),),
    (RED_BALL, BLUE_KEY),
)


def test_recorded_transitions_of_xminigrid_are_ours_too():
    recorded = xminigrid_oracle.read_recorded()
    assert recorded.terminated.sum() > 20
    assert set(xminigrid_oracle.find_differences(recorded).values()) == {0}


@pytest.mark.nightly
def test_a_hundred_thousand_transitions_of_five_hundred_tasks_are_xminigrids():
    pytest.importorskip("xminigrid")
    transitions = xminigrid_oracle.record(500, 40, seed=2)
    assert transitions.actions.size == 100_000
    assert set(xminigrid_oracle.find_differences(transitions).values()) == {0}


@pytest.mark.parametrize("preset", PRESETS)
def test_generated_tasks_are_those_of_xminigrids_script(preset):
    ours = list(generate_tasks(PRESETS[preset], 60))
    assert ours == xminigrid_oracle.read_recorded_tasks()[preset]


def test_packaged_sets_are_what_the_generator_makes_of_their_origin():
    assert packaged_sets() == ("high", "medium", "small", "trivial")
    for name in packaged_sets():
        tasks = find_task_set(name)
        made = build_task_set(generate_tasks(PRESETS[name], len(tasks), tasks.origin["seed"]))
        assert np.array_equal(made.records, tasks.records)


def test_a_world_passes_gymnasiums_checks_and_shows_its_task_as_xminigrid_encodes_it():
    world = gymnasium.make("minihuman/Rules-v0", task_set="medium", observe_task=True).unwrapped
    check_env(world)
    observation, _ = world.reset(seed=4)
    assert observation["goal_encoding"].tolist() == xminigrid_oracle.encode_goal(world.task.goal)
    shown = observation["rule_encoding"][: len(world.task.rules)].tolist()
    assert shown == [xminigrid_oracle.encode_rule(rule) for rule in world.task.rules]
    assert observation["mission"] == describe_task(world.task)


def test_every_kind_of_goal_and_rule_is_encoded_as_in_xminigrid():
    for kind in range(15):
        world = RulesetWorld(task=RuleTask(RuleGoal(kind, *goal_numbers(kind)), RECIPE.rules, RECIPE.things))
        world.reset(seed=0)
        goals, _ = encode_tasks(world.row[None], 1)
        assert goals[0].tolist() == xminigrid_oracle.encode_goal(world.task.goal)
        goal = {"goal": goals[0].tolist(), "rules": [], "init_tiles": []}
        assert parse_task(goal).goal == world.task.goal


def goal_numbers(kind):
    if kind == numbers.NO_GOAL:
        return ()
    if kind == numbers.GOAL_AGENT_AT:
        return 3, 4
    if kind == numbers.GOAL_TILE_AT:
        return RED_BALL, 3, 4
    goal = RuleGoal(kind, RED_BALL, BLUE_KEY)
    return goal.tiles


@pytest.mark.parametrize("autoreset_mode", ["NextStep", "SameStep"])
def test_a_batch_does_what_its_worlds_do_alone(autoreset_mode):
    options = {"task_set": "medium", "rooms": 4, "height": 13, "width": 13, "observe_task": True, "max_steps": 25}
    batch = gymnasium.make_vec("minihuman/Rules-v0", 6, "vector_entry_point", autoreset_mode=autoreset_mode, **options)
    worlds = [gymnasium.make("minihuman/Rules-v0", **options) for _ in range(6)]
    together, _ = batch.reset(seed=5)
    alone = [world.reset(seed=5 + i)[0] for i, world in enumerate(worlds)]
    rng = np.random.default_rng(0)
    over = [False] * 6
    for _ in range(80):
        actions = rng.integers(0, 6, 6)
        together, rewards, terminated, truncated, info = batch.step(actions)
        for i, world in enumerate(worlds):
            if over[i]:
                alone[i] = world.reset()[0]
                over[i] = False
                continue
            alone[i], reward, ended, cut, _ = world.step(int(actions[i]))
            assert (reward, ended, cut) == (rewards[i], terminated[i], truncated[i])
            over[i] = ended or cut
            if over[i] and autoreset_mode == "SameStep":
                assert np.array_equal(info["final_obs"][i]["image"], alone[i]["image"])
                alone[i] = world.reset()[0]
                over[i] = False
        for i, observation in enumerate(alone):
            assert all(np.array_equal(together[name][i], part) for name, part in observation.items())


def test_a_batch_is_saved_restored_and_refuses_what_it_cannot_do():
    batch = gymnasium.make_vec("minihuman/Rules-v0", 4, "vector_entry_point")
    with pytest.raises(WorldError, match="world 0 is not in an episode"):
        batch.step(np.zeros(4, int))
    batch.reset(seed=1)
    saved = pickle.loads(pickle.dumps(batch.save()))
    hashes = batch.call("state_hash")
    first = batch.step(np.array([0, 1, 2, 3]))[0]
    with pytest.raises(WorldError, match="action 9 does not exist in world 2"):
        batch.step(np.array([0, 0, 9, 0]))
    batch.restore(saved)
    assert batch.call("state_hash") == hashes
    again = batch.step(np.array([0, 1, 2, 3]))[0]
    assert np.array_equal(first["image"], again["image"])
    assert first["mission"] == again["mission"]


def test_a_world_goes_back_to_a_copy_with_its_task_and_its_random_stream():
    world = RulesetWorld(task_set="small")
    world.reset(seed=1)
    saved = pickle.loads(pickle.dumps(world.save()))
    state, mission = world.state_hash(), world.mission
    rewards = [world.advance(action) for action in (0, 3, 1, 0, 4)]
    world.reset()
    next_task = world.state_hash()
    world.restore(saved)
    assert (world.state_hash(), world.mission) == (state, mission)
    assert [world.advance(action) for action in (0, 3, 1, 0, 4)] == rewards
    world.reset()
    assert world.state_hash() == next_task


def test_difficulty_chooses_tasks_and_a_rare_one_is_named():
    world = RulesetWorld(task_set="medium", difficulty=[2, 3])
    drawn = set()
    for seed in range(30):
        world.reset(seed=seed)
        drawn.add(world.task.difficulty)
    assert drawn == {2, 3}
    with pytest.raises(WorldError, match="no task has a difficulty from 77 to 77; those of this set have 0, 1, 2"):
        RulesetWorld(task_set="medium", difficulty=77)


def test_a_recipe_of_ones_own_is_a_task_and_the_planner_finds_how_it_is_made():
    encoded = {"goal": [1, 12, 2], "rules": [[3, 3, 1, 7, 3, 12, 2]], "init_tiles": [[3, 1], [7, 3]]}
    assert parse_task(encoded) == RECIPE
    world = RulesetWorld(task=encoded)
    assert world.mission == (
        "Goal: Pick up a green star. Rule: If you put a red ball next to a blue key, the two turn into a green star."
    )
    for seed in range(5):
        world.reset(seed=seed)
        *before, last = [world.advance(action) for action in world.shortest_path()]
        assert not any(reward for reward, _, _ in before)
        assert last[0] > 0
        assert last[1]


@pytest.mark.parametrize("task_set", ["trivial", "small"])
def test_plans_of_drawn_tasks_reach_the_goal(task_set):
    world = RulesetWorld(task_set=task_set)
    for seed in range(6):
        world.reset(seed=seed)
        plan = world.shortest_path()
        assert plan
        assert [world.advance(action) for action in plan][-1][1]


def test_no_plan_is_found_where_what_is_needed_is_missing():
    world = RulesetWorld(task=RECIPE._replace(things=(RED_BALL,)))
    world.reset(seed=0)
    assert world.shortest_path() == ()
    assert world.task.difficulty == 255


def test_a_file_of_tasks_is_read_back_and_a_damaged_one_is_named(tmp_path: Path):
    path = tmp_path / "mine.npz"
    tasks = list(generate_tasks(PRESETS["high"], 50, seed=3))
    build_task_set(tasks, {"seed": 3}).save(path)
    assert sorted(read_task_set(path)[number] for number in range(50)) == sorted(tasks)
    world = RulesetWorld(task_set=os.fspath(path), height=13, width=13)
    world.reset(seed=0)
    assert world.task in tasks
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(WorldError, match=r"mine\.npz is no set of tasks"):
        read_task_set(path)
    with pytest.raises(WorldError, match="task_set is 'nothing'; use one of high, medium, small, trivial, or the path"):
        RulesetWorld(task_set="nothing")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"task": {"goal": [1]}}, "give a table with goal, rules and init_tiles"),
        ({"task": {"goal": [1, 2, 6], "rules": [], "init_tiles": []}}, "a task has the tile 98, a wall"),
        ({"task": {"goal": [6, 20, 3], "rules": [], "init_tiles": []}}, "row 20 and column 3 of a grid of 9 x 9"),
        ({"task": 5000}, "task is 5000; it must be a whole number from 0 to 999"),
        ({"rooms": 4, "height": 9, "width": 11}, "4 rooms need a square grid, not 9 x 11"),
        ({"rooms": 9, "height": 11, "width": 11}, "nine rooms need 7, 10, 13, 16"),
        ({"rooms": 3}, "rooms is 3; use one of 1, 2, 4, 6, 9"),
    ],
)
def test_options_that_mean_nothing_are_refused_with_what_to_give(options, message):
    with pytest.raises(WorldError, match=message):
        RulesetWorld(**options)


def test_a_grid_without_room_for_a_task_says_so():
    world = RulesetWorld(task=RECIPE._replace(things=(RED_BALL,) * 9), height=5, width=5)
    with pytest.raises(WorldError, match="has no floor for the things of task 0; make the grid larger"):
        world.reset(seed=0)


@pytest.mark.parametrize(("rooms", "size"), [(1, 9), (2, 9), (4, 9), (6, 13), (6, 17), (6, 19), (9, 16)])
def test_all_rooms_can_be_walked_to(rooms, size):
    goal = RuleGoal(numbers.GOAL_AGENT_AT, 0, 0)
    world = RulesetWorld(task=RuleTask(goal, (), ()), rooms=rooms, height=size, width=size)
    world.reset(seed=2)
    passable = (world.tiles & 15 == numbers.FLOOR) | (world.tiles & 15 == numbers.DOOR_CLOSED)
    reached = np.zeros_like(passable)
    reached[world.row[numbers.Y], world.row[numbers.X]] = True
    for _ in range(size * size):
        spread = reached.copy()
        spread[1:] |= reached[:-1]
        spread[:-1] |= reached[1:]
        spread[:, 1:] |= reached[:, :-1]
        spread[:, :-1] |= reached[:, 1:]
        reached = spread & passable
    assert (reached == passable).all()
    assert (world.tiles & 15 == numbers.DOOR_CLOSED).sum() == {1: 0, 2: 1, 4: 4, 6: 6, 9: 12}[rooms]
