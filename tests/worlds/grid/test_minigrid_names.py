"""Code written for Minigrid's worlds runs with only the id changed; and the wrappers its users miss."""

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest
from minigrid.wrappers import ReseedWrapper

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.wrappers import FixedSeeds, NoDeath, PictureObservation

pytestmark = pytest.mark.filterwarnings("ignore:.*out of date")


def where_am_i(env):
    env.reset(seed=3)
    env.step(2)
    world = env.unwrapped
    return tuple(map(int, world.agent_pos)), int(world.agent_dir), world.step_count, world.max_steps


def what_is_there(env):
    env.reset(seed=3)
    world, found = env.unwrapped, []
    for i in range(world.grid.width):
        for j in range(world.grid.height):
            cell = world.grid.get(i, j)
            if cell is not None and cell.type != "wall":
                found.append((cell.type, cell.color, i, j))
    return found


def find_the_key(env):
    env.reset(seed=5)
    grid = env.unwrapped.grid
    cells = [(i, j) for i in range(grid.width) for j in range(grid.height)]
    return [place for place in cells if grid.get(*place) is not None and grid.get(*place).type == "key"]


def doors(env):
    env.reset(seed=1)
    grid = env.unwrapped.grid
    found = [grid.get(i, j) for i in range(grid.width) for j in range(grid.height)]
    return [(door.is_open, door.is_locked, door.encode()) for door in found if door is not None and door.type == "door"]


def what_is_ahead(env):
    env.reset(seed=2)
    world = env.unwrapped
    ahead = world.grid.get(*world.front_pos)
    return tuple(map(int, world.front_pos)), tuple(map(int, world.dir_vec)), None if ahead is None else ahead.type


def what_is_carried(env):
    env.reset(seed=0)
    held = []
    for action in np.random.default_rng(0).integers(0, 7, 200).tolist():
        _, _, terminated, truncated, _ = env.step(action)
        hand = env.unwrapped.carrying
        held.append(None if hand is None else (hand.type, hand.color))
        if terminated or truncated:
            env.reset()
    return held


def cells_in_view(env):
    env.reset(seed=4)
    world = env.unwrapped
    places = [(i, j) for i in range(world.width) for j in range(world.height)]
    return [(place, world.relative_coords(*place)) for place in places if world.in_view(*place)]


def encoded(env):
    env.reset(seed=6)
    return env.unwrapped.grid.encode().tolist()


def is_it_seen(env):
    env.reset(seed=7)
    world = env.unwrapped
    things = [(i, j) for i in range(world.width) for j in range(world.height) if world.grid.get(i, j) is not None]
    return [place for place in things if world.agent_sees(*place)]


def shapes_of_frames(env):
    env.reset(seed=0)
    return [env.unwrapped.get_frame(tile_size=8).shape, env.unwrapped.get_frame(tile_size=8, agent_pov=True).shape]


SNIPPETS = (
    where_am_i,
    what_is_there,
    find_the_key,
    doors,
    what_is_ahead,
    what_is_carried,
    cells_in_view,
    encoded,
    is_it_seen,
    shapes_of_frames,
)


@pytest.mark.parametrize("snippet", SNIPPETS)
@pytest.mark.parametrize("name", ["MiniGrid-DoorKey-8x8-v0", "BabyAI-UnlockPickup-v0"])
def test_a_snippet_runs_with_only_the_id_changed(snippet, name):
    assert snippet(gymnasium.make(f"minihuman/{name}")) == snippet(gymnasium.make(name))


def test_views_change_nothing():
    env = gymnasium.make("minihuman/BabyAI-BossLevel-v0").unwrapped
    env.reset(seed=0)
    before = env.state_hash()
    for snippet in ("agent_pos", "carrying", "grid", "front_pos", "steps_remaining"):
        getattr(env, snippet)
    assert env.state_hash() == before
    assert ("blue", "box") in env.grid or "door" in env.grid


def test_render_takes_highlight_and_the_agents_point_of_view():
    name = "minihuman/MiniGrid-FourRooms-v0"
    pictures = []
    for options in ({}, {"highlight": False}, {"agent_pov": True}):
        env = gymnasium.make(name, render_mode="rgb_array", tile_size=8, **options)
        env.reset(seed=0)
        pictures.append(env.render())
    assert pictures[0].shape == pictures[1].shape == (152, 152, 3)
    assert (pictures[0] != pictures[1]).any()
    assert pictures[2].shape == (56, 56, 3)


def test_seeds_give_the_same_layouts_over_and_over():
    ours = FixedSeeds(gymnasium.make("minihuman/MiniGrid-FourRooms-v0"), (3, 5))
    theirs = ReseedWrapper(gymnasium.make("MiniGrid-FourRooms-v0"), seeds=(3, 5))
    for _ in range(4):
        np.testing.assert_array_equal(ours.reset()[0]["image"], theirs.reset()[0]["image"])
    with pytest.raises(WorldError, match="Seeds resets with 3"):
        ours.reset(seed=4)
    with pytest.raises(WorldError, match="one or more whole numbers"):
        FixedSeeds(gymnasium.make("minihuman/MiniGrid-FourRooms-v0"), ())


@pytest.mark.parametrize("wrap", [lambda env: env, lambda env: PictureObservation(env, tile_px=4)])
def test_without_death_lava_costs_and_bars_the_way(wrap):
    env = NoDeath(wrap(gymnasium.make("minihuman/MiniGrid-LavaGapS5-v0")), cost=-0.5)
    chance, fell = np.random.default_rng(0), 0
    env.reset(seed=0)
    for _ in range(300):
        place = env.unwrapped.state.position
        observation, reward, terminated, truncated, _ = env.step(int(chance.integers(3)))
        assert observation in env.observation_space
        if reward == -0.5:
            fell += 1
            assert not terminated
            assert env.unwrapped.state.position == place
        if terminated:
            assert reward > 0
        if terminated or truncated:
            env.reset()
    assert fell > 3
