from collections import deque

import gymnasium
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.catalogue import GRID_WORLDS
from minihuman.worlds.grid.planner import plan

# worlds whose obstacles move by chance, without a task, or with more movable things than the default limit takes
NOT_PLANNED = ("Dynamic", "Playground", "-1Q-", "-2Q-", "-Full-")
CLASSIC = [entry.id for entry in GRID_WORLDS if "family" in entry.kwargs]
PLANNED = [world for world in CLASSIC if not any(part in world for part in NOT_PLANNED)]


@pytest.mark.parametrize("world", PLANNED)
def test_the_plan_succeeds_with_its_last_action(world):
    env = gymnasium.make(world)
    env.reset(seed=0)
    before = env.unwrapped.state_hash()
    actions = plan(env.unwrapped.state)
    assert env.unwrapped.state_hash() == before
    for action in actions[:-1]:
        _, reward, terminated, _, _ = env.step(action)
        assert (reward, terminated) == (0, False)
    _, reward, terminated, _, _ = env.step(actions[-1])
    assert terminated
    assert reward == 1 - 0.9 * (len(actions) / env.unwrapped.state.max_steps)


def length_by_brute_force(env):
    """Steps to success over every action sequence: no bound, nothing left out, the environment itself."""
    env.reset(seed=0)
    start = env.unwrapped.save()
    seen, queue = set(), deque([(start, 0)])
    while queue:
        saved, steps = queue.popleft()
        for action in range(7):
            env.unwrapped.restore(saved)
            _, reward, terminated, _, _ = env.step(action)
            if terminated and reward > 0:
                return steps + 1
            after = env.unwrapped.save()
            after.row[6] = 0  # the step count is no part of where we are
            key = after.row.tobytes()
            if not terminated and key not in seen:
                seen.add(key)
                queue.append((after, steps + 1))
    return None


@pytest.mark.parametrize(
    "name", ["DoorKey-5x5-v0", "Fetch-5x5-N2-v0", "PutNear-6x6-N2-v0", "GoToDoor-5x5-v0", "KeyCorridorS3R1-v0"]
)
def test_no_shorter_plan_exists(name):
    env = gymnasium.make(f"minihuman/MiniGrid-{name}", max_steps=10**6)
    shortest = length_by_brute_force(env)
    env.reset(seed=0)
    assert len(plan(env.unwrapped.state)) == shortest


@pytest.mark.parametrize("seed", range(10))
def test_every_step_of_a_plan_brings_success_nearer(seed):
    env = gymnasium.make("minihuman/MiniGrid-FourRooms-v0")
    env.reset(seed=seed)
    actions = plan(env.unwrapped.state)
    for left in range(len(actions), 0, -1):
        assert len(plan(env.unwrapped.state)) == left
        env.step(actions[-left])


def test_a_world_without_a_task_has_no_plan():
    env = gymnasium.make("minihuman/MiniGrid-Playground-v0")
    env.reset(seed=0)
    assert plan(env.unwrapped.state) is None


def test_a_goal_behind_walls_has_no_plan():
    env = gymnasium.make("minihuman/MiniGrid-FourRooms-v0", goal_pos=(0, 0))
    env.reset(seed=0)
    assert plan(env.unwrapped.state) is None


def test_a_very_large_world_with_obstacles_is_given_up_before_memory_is_full(monkeypatch):
    env = gymnasium.make("minihuman/MiniGrid-Dynamic-Obstacles-5x5-v0", size=40)
    env.reset(seed=0)
    row = env.unwrapped.state.row
    monkeypatch.setattr("minihuman.worlds.grid.planner.MOST_BYTES", 100 * row.nbytes)
    with pytest.raises(WorldError, match="after searching 100 states"):
        env.unwrapped.shortest_path()


def test_moving_obstacles_have_no_sure_plan():
    env = gymnasium.make("minihuman/MiniGrid-Dynamic-Obstacles-5x5-v0")
    env.reset(seed=0)
    with pytest.raises(WorldError, match="move at random"):
        plan(env.unwrapped.state)


def test_giving_up_is_said_and_is_not_no_plan():
    env = gymnasium.make("minihuman/MiniGrid-BlockedUnlockPickup-v0")
    env.reset(seed=0)
    with pytest.raises(WorldError, match="in the first 50 states"):
        plan(env.unwrapped.state, limit=50)
