import math

import gymnasium
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.first_person.pathfinding.planner import least_steps, plan
from tests.counts import count

pytestmark = pytest.mark.nightly(sample=True)

WORLDS = ("FourRooms", "Hallway", "TMaze", "YMaze", "OneRoom", "OneRoomS6Fast", "MazeS3", "MazeS3Fast", "Maze")
SEEDS = range(count(3, 60))


def begun(name, seed, **options):
    env = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", obs_width=1, obs_height=1, max_steps=9999, **options)
    env.reset(seed=seed)
    return env.unwrapped


def steps_to_the_end(env, actions):
    """How many of the actions it took."""
    for number, action in enumerate(actions, 1):
        if env.step(action)[2]:
            return number
    raise AssertionError(f"not there after {len(actions)} steps")


@pytest.mark.parametrize("name", [*WORLDS, "Sidewalk", "WallGap"])
def test_a_plan_leads_to_the_goal_and_no_sooner_than_it_can(name):
    for seed in SEEDS:
        env = begun(name, seed)
        actions, least = plan(env, env.box), least_steps(env, env.box)
        assert actions is not None
        assert 1 <= least <= len(actions)
        assert steps_to_the_end(env, actions) == len(actions)


@pytest.mark.parametrize("name", ["FourRooms", "MazeS3", "OneRoomS6Fast"])
def test_the_least_steps_never_overtake_what_is_left_of_a_way(name):
    for seed in SEEDS:
        env = begun(name, seed)
        actions = plan(env, env.box)
        for taken, action in enumerate(actions):
            assert least_steps(env, env.box) <= len(actions) - taken
            env.step(action)


def test_on_an_open_floor_the_least_is_nearly_the_plan():
    env = begun("OneRoom", 1)
    env.agent.pos, env.agent.dir = (1.0, 0.0, 5.0), 0.0
    env.box.pos = (8.0, 0.0, 5.0)
    actions = plan(env, env.box)
    reach = env.box.radius + env.agent.radius + 1.1 * 0.17
    assert least_steps(env, env.box) == math.ceil((7.0 - reach) / math.hypot(0.17, 0.05))
    assert len(actions) == math.floor((7.0 - reach) / 0.15) + 1


def test_where_steps_vary_planning_again_and_again_gets_there():
    env = begun("FourRooms", 5, domain_rand=True)
    least, taken, terminated = least_steps(env, env.box), 0, False
    while not terminated:
        for action in plan(env, env.box)[:5]:
            terminated = env.step(action)[2]
            taken += 1
            if terminated:
                break
    assert least <= taken < 500


def test_a_plan_keeps_out_of_the_street():
    env = begun("Sidewalk", 3)
    for action in plan(env, env.box):
        env.step(action)
        assert not env.street.contains(env.agent.pos[0], env.agent.pos[2])


def test_what_is_in_hand_is_brought_beside_the_goal():
    for seed in SEEDS:
        env = begun("PutNext", seed)
        actions = env.shortest_path()
        assert env.shortest_path() == actions  # the world is as it was
        assert steps_to_the_end(env, actions) == len(actions)
        assert env.agent.carrying is None
        assert env.near(env.red_box, env.yellow_box)


def test_the_wrong_thing_in_hand_is_put_down_first():
    env = begun("PutNext", 1)
    env.agent.carrying = next(box for box in env.entities if "blue" in box.name)
    actions = env.shortest_path()
    assert env.action_names[actions[0]] == "drop"
    assert steps_to_the_end(env, actions) == len(actions)


def test_a_red_box_in_a_corner_is_carried_out_backwards():
    env = begun("PutNext", 1)
    env.red_box.pos = (env.red_box.radius + 0.01, 0.0, env.red_box.radius + 0.01)
    actions = env.shortest_path()
    names = [env.action_names[action] for action in actions]
    assert "move_back" in names[names.index("pickup") :]
    assert steps_to_the_end(env, actions) == len(actions)


def test_without_turns_there_is_no_plan():
    env = begun("PutNext", 0)
    env.action_names = ("move_forward",)
    with pytest.raises(WorldError, match="both turns"):
        plan(env, env.yellow_box)


def test_a_goal_behind_closed_walls_has_no_plan():
    env = begun("OneRoom", 0)
    env.box.pos = (30.0, 0.0, 30.0)
    assert plan(env, env.box) is None
