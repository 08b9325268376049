import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.catalogue import GRID_WORLDS
from minihuman.worlds.grid.core import cells
from minihuman.worlds.grid.core.state import CARRYING, DIRECTION, X, Y
from tests.counts import count

WORLDS = [entry.id for entry in GRID_WORLDS][:: -count(6, 1)]  # the last, made in its own way, is always there
STEPS = count(30, 600)


def inside(name, **options):
    return gymnasium.make(f"minihuman/MiniGrid-{name}", view="first_person", obs_width=16, obs_height=12, **options)


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("world", WORLDS)
def test_seen_from_inside_it_is_the_same_world(world):
    grid = gymnasium.make(world)
    env = gymnasium.make(world, view="first_person", obs_width=16, obs_height=12)
    rng = np.random.default_rng(0)
    over = True
    for step in range(STEPS):
        if over:
            seen_above, _ = grid.reset(seed=step)
            seen_inside, _ = env.reset(seed=step)
            over = False
        else:
            action = int(rng.integers(grid.action_space.n))
            seen_above, *above = grid.step(action)
            seen_inside, *within = env.step(action)
            assert above == within
            over = above[1] or above[2]
        assert {name: seen_inside[name] for name in seen_inside if name != "image"} == {
            name: seen_above[name] for name in seen_above if name != "image"
        }
        assert env.observation_space.contains(seen_inside)
        assert env.unwrapped.state_hash() == grid.unwrapped.state_hash()
        assert env.unwrapped.pose() == grid.unwrapped.pose()
    assert env.unwrapped.map() == grid.unwrapped.map()


def test_gymnasium_finds_nothing_wrong():
    check_env(inside("DoorKey-8x8-v0", render_mode="rgb_array").unwrapped)


def test_opening_a_door_shows_what_is_behind():
    env = inside("MultiRoom-N2-S4-v0").unwrapped
    env.reset(seed=0)
    state = env.grid.state
    ((x, z),) = [
        (x, z) for x, z in np.ndindex(state.cells.shape) if cells.kind_of(int(state.cells[x, z])) == cells.DOOR
    ]
    steps = ((1, 0), (0, 1), (-1, 0), (0, -1))
    facing = [d for d, (right, down) in enumerate(steps) if cells.lets_pass(int(state.cells[x - right, z - down]))]
    state.row[X], state.row[Y], state.row[DIRECTION] = x - steps[facing[0]][0], z - steps[facing[0]][1], facing[0]
    before = env.picture(size_px=(40, 30))
    env.step(env.action_names.index("toggle"))
    assert cells.state_of(int(state.cells[x, z])) == cells.OPEN
    assert not np.array_equal(env.picture(size_px=(40, 30)), before)


def test_what_is_picked_up_is_seen_in_hand():
    env = inside("DoorKey-5x5-v0").unwrapped
    env.reset(seed=0)
    empty = env.picture(size_px=(40, 30))
    saved = env.save()
    state = env.grid.state
    state.row[CARRYING] = next(int(code) for code in state.cells.flat if cells.kind_of(int(code)) == cells.KEY)
    assert not np.array_equal(env.picture(size_px=(40, 30)), empty)
    env.restore(saved)
    assert np.array_equal(env.picture(size_px=(40, 30)), empty)


def test_keys_and_balls_come_in_the_colours_of_the_palette():
    env = inside("KeyCorridorS3R3-v0").unwrapped
    env.reset(seed=0)
    state = env.grid.state
    state.row[CARRYING] = next(int(code) for code in state.cells.flat if cells.kind_of(int(code)) == cells.BALL)
    shown = [env.picture(size_px=(40, 30), palette=palette).reshape(-1, 3) for palette in ("classic", "colour-safe")]
    assert not np.array_equal(*shown)


def test_a_copy_goes_on_by_itself():
    env = inside("DoorKey-8x8-v0").unwrapped
    env.reset(seed=2)
    for other in (pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
        assert other.state_hash() == env.state_hash()
        assert np.array_equal(other.picture(size_px=(16, 12)), env.picture(size_px=(16, 12)))
        other.step(0)
        assert other.state_hash() != env.state_hash()


def test_another_view_is_named():
    with pytest.raises(WorldError, match="view is 'inside'"):
        gymnasium.make("minihuman/MiniGrid-FourRooms-v0", view="inside")


def test_an_instruction_is_done_clause_by_clause_as_in_the_grid():
    grid = gymnasium.make("minihuman/BabyAI-GoToLocal-v0")
    env = gymnasium.make("minihuman/BabyAI-GoToLocal-v0", view="first_person", obs_width=16, obs_height=12)
    for world in (grid, env):
        world.reset(seed=0)
    assert [step for _, step in env.unwrapped.subgoals()] == [0]
    for action in list(grid.unwrapped.shortest_path()):
        grid.step(action)
        env.step(action)
    assert env.unwrapped.subgoals() == grid.unwrapped.subgoals()
    assert env.unwrapped.subgoals()[0][1] > 0
