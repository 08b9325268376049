"""Gymnasium's table, a line a test: what a library may do with our worlds, and get what Gymnasium says.

What every world keeps is in ``test_every_world.py``.
"""

import copy
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pygame
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import FrameStackObservation, RecordEpisodeStatistics
from Xlib.display import Display

import minihuman  # noqa: F401  # registers the worlds
from minihuman.errors import WorldError
from tests.worlds.catalogue_worlds import same_observation

GRID = "minihuman/MiniGrid-GoToObject-6x6-N2-v0"  # a mission with choices
ROOMS = "minihuman/MiniWorld-OneRoomS6Fast-v0"
INSIDE = (GRID, {"view": "first_person"})
SOME = ((GRID, {}), (ROOMS, {}), INSIDE, ("minihuman/MiniGrid-GoToObj-Transfer-v0", {}))
BATCHES = (GRID, "minihuman/MiniGrid-Dynamic-Obstacles-5x5-v0", ROOMS)  # what has a batch of its own

some = pytest.mark.parametrize(("world", "options"), SOME, ids=["grid", "rooms", "inside", "own layout"])
batches = pytest.mark.parametrize("world", BATCHES)
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*out of date"),  # v0 of worlds that have a v1
    pytest.mark.filterwarnings("ignore:.*not in the possible render_modes"),  # Gymnasium warns of what we refuse
]


# Making worlds.


@pytest.mark.program
def test_make_by_module_prefix_needs_no_import():
    script = "import gymnasium; print(gymnasium.make('minihuman:minihuman/MiniGrid-Empty-5x5-v0').reset(seed=0)[1])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "{}", done.stderr


# Rendering.


@pytest.mark.program
@pytest.mark.parametrize(("world", "size_px"), [(GRID, (192, 192)), (ROOMS, (800, 600))])
def test_render_mode_human_opens_a_window(world, size_px, display, monkeypatch):
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    pygame.display.quit()  # whatever was tried before in this process was on another screen
    env = gymnasium.make(world, render_mode="human")
    env.reset(seed=0)
    env.step(0)
    screen = Display(display)
    windows = [child.get_geometry() for child in screen.screen().root.query_tree().children]
    sizes = {(window.width, window.height) for window in windows}
    screen.close()
    env.close()
    assert size_px in sizes


@pytest.mark.parametrize("mode", ["depth", "humane"])
def test_an_unknown_render_mode_is_refused_or_a_picture_with_gymnasiums_warning_as_in_minigrid(mode):
    with pytest.raises(WorldError, match="render_mode is"):
        gymnasium.make(ROOMS, render_mode=mode)
    for options in ({}, {"view": "first_person"}):
        with pytest.warns(UserWarning, match=f"render_mode='{mode}' that is not in the possible render_modes"):
            env = gymnasium.make(GRID, render_mode=mode, **options)
        env.reset(seed=0)
        assert env.render().ndim == 3


def test_a_grid_seen_from_inside_has_no_text():
    with pytest.raises(WorldError, match="'ansi'"):
        gymnasium.make(GRID, render_mode="ansi", view="first_person")


# Many at once.


def rollout(vector, seed=3, steps=40):
    """Observations, rewards and ends of a vector under the same actions."""
    said = [vector.reset(seed=seed)[0]]
    actions = np.random.default_rng(seed)
    for _ in range(steps):
        step = vector.step(actions.integers(vector.single_action_space.n, size=vector.num_envs))
        said += step[:4]
    return said


def short(world, mode, kind, **options):
    kwargs = {"autoreset_mode": mode} if kind == "vector_entry_point" else {"vector_kwargs": {"autoreset_mode": mode}}
    return gymnasium.make_vec(world, num_envs=3, vectorization_mode=kind, max_steps=7, **kwargs, **options)


@batches
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_native_vector_is_the_sync_vector(world, mode):
    native, sync = short(world, mode, "vector_entry_point"), short(world, mode, "sync")
    assert all(same_observation(a, b) for a, b in zip(rollout(native), rollout(sync), strict=True))
    native.close()


@batches
def test_a_native_vector_without_autoreset_is_reset_by_mask(world):
    native = short(world, AutoresetMode.DISABLED, "vector_entry_point")
    native.reset(seed=0)
    while True:
        *_, terminated, truncated, _ = native.step(np.zeros(3, np.int64))
        if (over := terminated | truncated).any():
            break
    with pytest.raises(WorldError, match=r"reset"):
        native.step(np.zeros(3, np.int64))
    native.reset(options={"reset_mask": over})
    native.step(np.zeros(3, np.int64))
    native.close()


@pytest.mark.program
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@some
def test_an_async_vector_is_the_sync_vector_in_every_value(world, options, mode):
    both = short(world, mode, "async", **options), short(world, mode, "sync", **options)
    a, b = (rollout(vector) for vector in both)
    assert all(same_observation(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a[0], dict):
        assert set(a[0]["mission"]) != {"aaaaaaa"}  # what Gymnasium 1.4's own texts come out as
    for vector in both:
        vector.close()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@some
def test_a_sync_vector_is_its_worlds(world, options, mode):
    vector = short(world, mode, "sync", **options)
    observations = vector.reset(seed=5)[0]
    alone = gymnasium.make(world, **options)
    for i in range(3):
        expected = alone.reset(seed=5 + i)[0]
        one = {key: observations[key][i] for key in observations} if isinstance(observations, dict) else observations[i]
        assert same_observation(one, expected)


# Seeds.


@batches
@pytest.mark.parametrize("kind", ["vector_entry_point", "sync"])
def test_seeds_are_a_number_a_tuple_a_list_or_an_array(world, kind):
    vector = gymnasium.make_vec(world, num_envs=3, vectorization_mode=kind)
    first = vector.reset(seed=11)[0]
    for seed in ((11, 12, 13), [11, 12, 13]) + ((np.array([11, 12, 13]),) if kind == "vector_entry_point" else ()):
        assert same_observation(vector.reset(seed=seed)[0], first)
    vector.close()


@batches
@pytest.mark.parametrize("seed", [(1, 2), 1.5, "a"])
def test_seeds_that_are_none_are_refused(world, seed):
    with pytest.raises(WorldError, match=r"seed"):
        gymnasium.make_vec(world, num_envs=3, vectorization_mode="vector_entry_point").reset(seed=seed)


@batches
def test_np_random_of_a_native_vector_is_its_worlds(world):
    native = gymnasium.make_vec(world, num_envs=3, vectorization_mode="vector_entry_point")
    sync = gymnasium.make_vec(world, num_envs=3, vectorization_mode="sync")
    for vector in (native, sync):
        vector.reset(seed=(4, 9, 2))
    assert native.np_random_seed == sync.np_random_seed == (4, 9, 2)
    states = [[generator.bit_generator.state for generator in vector.np_random] for vector in (native, sync)]
    assert states[0] == states[1]
    native.close()


# Wrappers of Gymnasium's.


@some
def test_frame_stack_observation(world, options):
    env = FrameStackObservation(gymnasium.make(world, **options), 3)
    observation, _ = env.reset(seed=2)
    assert observation in env.observation_space
    assert env.step(0)[0] in env.observation_space


@some
def test_record_episode_statistics(world, options):
    env = RecordEpisodeStatistics(gymnasium.make(world, max_steps=3, **options))
    env.reset(seed=0)
    steps, over = 0, False
    while not over:
        _, _, terminated, truncated, info = env.step(0)
        steps, over = steps + 1, terminated or truncated
    assert info["episode"]["l"] == steps


# Copies.


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda vector: pickle.loads(pickle.dumps(vector))])
@batches
def test_pickle_and_deepcopy_of_a_batch_in_mid_episode(world, copied):
    vector = short(world, AutoresetMode.NEXT_STEP, "vector_entry_point")
    vector.reset(seed=6)
    vector.step(np.zeros(3, np.int64))
    other = copied(vector)
    for step in range(20):  # through several ends: what is laid out anew is the same too
        actions = np.full(3, step % 3)
        assert all(
            same_observation(a, b) for a, b in zip(vector.step(actions)[:4], other.step(actions)[:4], strict=True)
        )
    vector.close()
    other.close()


# What is refused.


@pytest.mark.parametrize("action", [1.5, 0.5, np.array([1, 1]), "left", None, -1, 99])
@some
def test_an_action_that_is_no_whole_number_in_range_is_refused(world, options, action):
    env = gymnasium.make(world, **options)
    env.reset(seed=0)
    before = env.unwrapped.state_hash()
    with pytest.raises(WorldError, match="action"):
        env.step(action)
    assert env.unwrapped.state_hash() == before


@pytest.mark.parametrize("max_steps", [7.5, 7.0, 0, -3, 10**12, "7", True])
@some
def test_max_steps_that_are_no_whole_number_in_range_are_refused(world, options, max_steps):
    with pytest.raises(WorldError, match="max_steps is"):
        gymnasium.make(world, max_steps=max_steps, **options)
