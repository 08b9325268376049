"""Code written for Minigrid's worlds runs with only the id changed; and the wrappers its users miss."""

import copy
import pickle

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest
from minigrid.core.grid import Grid
from minigrid.core.world_object import Box, Door, Goal, Key, Wall
from minigrid.wrappers import ReseedWrapper

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.object_views import ObjectView
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


def things(cells):
    return [None if cell is None else (cell.encode(), cell.can_overlap(), cell.see_behind()) for cell in cells]


def what_is_observed_as_a_grid(env):
    env.reset(seed=8)
    seen = []
    for action in (1, 2, 2, 0, 3, 2):
        env.step(action)
        for size in (None, 3, 9):
            grid, mask = env.unwrapped.gen_obs_grid(size)
            seen.append((things(grid.grid), mask.tolist(), grid.encode(mask).tolist()))
    return seen


def parts_and_turns(env):
    env.reset(seed=9)
    grid = env.unwrapped.grid
    part = grid.slice(-2, 3, 6, 9)
    turned = part.rotate_left()
    rest = grid == grid.copy(), part == turned, (part.width, part.height), (turned.width, turned.height)
    return rest, things(grid.grid), things(part.grid), things(turned.grid)


def where_it_looks(env):
    env.reset(seed=10)
    world, seen = env.unwrapped, []
    for _ in range(4):
        env.step(world.actions.right)
        exts, coords = world.get_view_exts(5), world.get_view_coords(1, 2)
        seen.append((*map(int, (*exts, *coords, *world.right_vec)), world.hash(8) == world.hash(8)))
    return seen, [action.name for action in world.actions], world.see_through_walls


def kinds_by_class(env):
    env.reset(seed=11)
    cells = env.unwrapped.grid.grid
    return [[isinstance(cell, kind) for kind in (Wall, Door, Key, Box, Goal)] for cell in cells]


def pictures(env):
    env.reset(seed=12)
    world = env.unwrapped
    frames = world.get_frame(tile_size=6), world.get_pov_render(6), world.get_full_render(False, 6)
    return [frame.tolist() for frame in frames]


SNIPPETS = (
    what_is_observed_as_a_grid,
    parts_and_turns,
    where_it_looks,
    kinds_by_class,
    pictures,
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


def test_what_is_written_into_a_world_is_there():
    """As on Minigrid's: the same edits by hand, then the same observations."""
    seen = []
    for name in ("minihuman/MiniGrid-DoorKey-8x8-v0", "MiniGrid-DoorKey-8x8-v0"):
        env = gymnasium.make(name)
        env.reset(seed=0)
        world = env.unwrapped
        (at,) = find_the_key(env)
        world.grid.set(*at, None)
        world.put_obj(Key("red"), 1, 1)
        world.put_obj(Box("blue", Key("green")), 2, 1)
        world.agent_pos, world.agent_dir = (1, 2), 3
        steps = [env.step(action)[0]["image"].tolist() for action in (3, 2, 1, 5, 4, 0)]
        seen.append((steps, world.carrying is None, world.grid.encode().tolist()))
    assert seen[0] == seen[1]


def test_a_thing_that_is_put_elsewhere_is_the_same_thing():
    env = gymnasium.make("minihuman/MiniGrid-DoorKey-8x8-v0")
    (at,) = find_the_key(env)
    world = env.unwrapped
    key = world.grid.get(*at)
    world.put_obj(key, 1, 1)
    assert world.grid.get(*at) is None
    assert world.grid.get(1, 1).code == key.code
    assert key in world.grid
    world.carrying = key
    assert world.grid.get(1, 1) is None
    assert world.carrying.type == "key"
    world.carrying = None
    assert key not in world.grid


def test_what_cannot_be_written_is_refused():
    env = gymnasium.make("minihuman/MiniGrid-DoorKey-8x8-v0")
    env.reset(seed=0)
    world = env.unwrapped
    with pytest.raises(WorldError, match=r"agent_pos is \(8, 1\); use a cell from \(0, 0\) to \(7, 7\)"):
        world.agent_pos = 8, 1
    with pytest.raises(WorldError, match="agent_dir is 4"):
        world.agent_dir = 4
    with pytest.raises(WorldError, match=r"a part of another; set cells of env\.unwrapped\.grid"):
        world.grid.slice(0, 0, 3, 3).set(1, 1, None)
    with pytest.raises(WorldError, match="not a grid of equal rooms"):
        world.room_from_pos(1, 1)
    for _ in range(64 - 2):  # beside its own door and key
        world.put_obj(Key("red"), 1, 1)
    with pytest.raises(WorldError, match="64 things were made in this episode"):
        world.put_obj(Key("red"), 1, 1)


def test_a_view_of_a_thing_is_of_minigrids_class_and_of_ours():
    env = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0")
    env.reset(seed=0)
    cell = env.unwrapped.grid.get(3, 3)
    assert isinstance(cell, Goal)
    assert isinstance(cell, ObjectView)
    assert cell != Goal()  # as two things of Minigrid's that look alike
    assert {cell: 1}[env.unwrapped.grid.get(3, 3)] == 1
    assert pickle.loads(pickle.dumps(cell)) == copy.deepcopy(cell) == cell
    theirs = gymnasium.make("MiniGrid-Empty-5x5-v0")
    theirs.reset(seed=0)
    assert env.unwrapped.grid == theirs.unwrapped.grid
    assert Grid.decode(env.unwrapped.gen_obs()["image"])[0] == theirs.unwrapped.gen_obs_grid()[0]


@pytest.mark.parametrize("name", ["MiniGrid-ObstructedMaze-Full-v1", "BabyAI-GoTo-v0", "MiniGrid-KeyCorridorS4R3-v0"])
def test_a_cells_room_is_minigrids(name):
    ours, theirs = gymnasium.make(f"minihuman/{name}"), gymnasium.make(name)
    for seed in range(3):
        ours.reset(seed=seed)
        theirs.reset(seed=seed)
        for x in range(ours.unwrapped.width - 1):
            for y in range(ours.unwrapped.height - 1):
                room, its = ours.unwrapped.room_from_pos(x, y), theirs.unwrapped.room_from_pos(x, y)
                assert (room.top, room.size) == (its.top, its.size)
                doors = [getattr(door, "color", None) for door in its.doors]
                assert [getattr(door, "color", None) for door in room.doors] == doors


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
    with pytest.raises(WorldError, match="FixedSeeds uses 3"):
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
