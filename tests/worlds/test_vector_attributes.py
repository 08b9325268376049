"""Batches answer to `get_attr`, `call` and `set_attr` as Gymnasium's SyncVectorEnv does, save, restore, and draw."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.core.state import STEP

N = 3
GRID, LEVEL, ROOM = (
    "minihuman/MiniGrid-DoorKey-5x5-v0",
    "minihuman/BabyAI-GoToLocal-v0",
    "minihuman/MiniWorld-Hallway-v0",
)


def make_both(world_id, **options):
    """Our batch, and Gymnasium's of the same worlds."""
    return [
        gymnasium.make_vec(world_id, num_envs=N, vectorization_mode=mode, **options)
        for mode in ("vector_entry_point", "sync")
    ]


def step_both(batches, actions):
    return [batch.step(np.array(actions)) for batch in batches]


def same(ours, expected):
    """Whether attributes are equal, arrays by their numbers."""
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(ours, expected, strict=True))


@pytest.mark.parametrize(
    ("world_id", "names"),
    [
        (GRID, ("agent_pos", "agent_dir", "step_count", "max_steps", "front_pos", "mission", "action_names", "width")),
        (LEVEL, ("mission", "max_steps", "agent_pos", "see_through_walls", "steps_remaining")),
        (ROOM, ("step_count", "max_steps", "max_episode_steps", "min_x", "sky_color", "wall_segs")),
    ],
)
def test_get_attr_and_call_of_an_attribute_give_one_per_world(world_id, names):
    batches = make_both(world_id)
    for batch in batches:
        batch.reset(seed=[5, 6, 7])
    step_both(batches, [0, 2, 1])
    ours, expected = batches
    for name in names:
        assert isinstance(ours.get_attr(name), tuple)
        assert same(ours.get_attr(name), expected.get_attr(name)), name
        assert same(ours.call(name), expected.call(name)), name


@pytest.mark.parametrize("world_id", [GRID, ROOM])
def test_call_calls_a_method_of_each_world(world_id):
    batches = make_both(world_id, render_mode="rgb_array")
    for batch in batches:
        batch.reset(seed=1)
    step_both(batches, [1, 1, 2])
    ours, expected = batches
    for name in ("render", "state_hash", "pose"):
        assert same(ours.call(name), expected.call(name)), name
    pictures = [batch.call("picture", view="full", size_px=(64, 48)) for batch in batches]
    assert same(*pictures)
    assert len(ours.call("shortest_path")) == N


def test_a_call_that_changes_worlds_changes_the_batch():
    batches = make_both(GRID)
    for batch in batches:
        batch.reset(seed=3)
        batch.call("place_agent")
    ours, expected = batches
    assert same(ours.get_attr("agent_pos"), expected.get_attr("agent_pos"))
    observed = step_both(batches, [2, 2, 2])
    assert (observed[0][0]["image"] == observed[1][0]["image"]).all()


@pytest.mark.parametrize(
    ("world_id", "name", "values"),
    [
        (GRID, "step_count", [7, 8, 9]),
        (GRID, "step_count", 5),
        (GRID, "max_steps", 40_000),
        (GRID, "agent_pos", [(1, 1), (1, 2), (1, 3)]),
        (GRID, "agent_dir", 3),
        (GRID, "see_through_walls", True),
        (GRID, "mission", ["one", "two", "three"]),
        (ROOM, "step_count", [3, 4, 5]),
        (ROOM, "max_episode_steps", 2),
        (ROOM, "light_ambient", (np.zeros(3), np.ones(3), np.zeros(3))),
    ],
)
def test_set_attr_sets_one_value_for_all_or_one_for_each(world_id, name, values):
    batches = make_both(world_id)
    for batch in batches:
        batch.reset(seed=2)
        batch.set_attr(name, values)
    ours, expected = batches
    assert same(ours.get_attr(name), expected.get_attr(name))
    for actions in ([0, 1, 2], [2, 2, 2], [1, 0, 1]):
        answers = step_both(batches, actions)
        for mine, other in zip(answers[0][1:4], answers[1][1:4], strict=True):
            assert (mine == other).all()
        images = [observed["image"] if world_id == GRID else observed for observed, *_ in answers]
        assert (images[0] == images[1]).all()


def test_what_is_set_counts_in_later_episodes_too():
    batch = gymnasium.make_vec(GRID, num_envs=N)
    batch.reset(seed=0)
    batch.set_attr("max_steps", [2, 3, 250])
    batch.set_attr("see_through_walls", [True, False, True])
    ends = np.array([batch.step(np.zeros(N, int))[3] for _ in range(7)])
    assert ends.sum(axis=0).tolist() == [2, 2, 0]  # each reset takes a step
    batch.reset(seed=1)
    assert batch.get_attr("max_steps") == (2, 3, 250)
    assert batch.get_attr("see_through_walls") == (True, False, True)


@pytest.mark.parametrize("world_id", [GRID, ROOM])
def test_names_that_no_batch_has_are_refused_with_those_it_has(world_id):
    batch = gymnasium.make_vec(world_id, num_envs=N)
    batch.reset(seed=0)
    for refused in (
        lambda: batch.get_attr("gravity"),
        lambda: batch.call("step", 1),
        lambda: batch.call("reset"),
        lambda: batch.set_attr("gravity", 9.8),
    ):
        with pytest.raises(AttributeError, match=r"use one of .*step_count.*vectorization_mode='sync'"):
            refused()
    with pytest.raises(ValueError, match="2 values of step_count for 3 worlds; give one per world"):
        batch.set_attr("step_count", [1, 2])


def test_a_value_that_one_world_refuses_changes_none():
    batch = gymnasium.make_vec(GRID, num_envs=N)
    batch.reset(seed=0)
    before = batch.call("state_hash")
    with pytest.raises(WorldError, match="agent_dir is 9"):
        batch.set_attr("agent_dir", [1, 2, 9])
    assert batch.call("state_hash") == before


def test_what_a_world_sets_on_itself_can_be_read():
    batch = gymnasium.make_vec("minihuman/MiniWorld-CollectHealth-v0", num_envs=N)
    batch.reset(seed=0)
    assert batch.get_attr("health") == tuple(world.health for world in batch.envs)


@pytest.mark.parametrize("world_id", [GRID, LEVEL, ROOM, "minihuman/MiniGrid-Dynamic-Obstacles-5x5-v0"])
def test_a_batch_goes_back_to_a_saved_state(world_id):
    batch = gymnasium.make_vec(world_id, num_envs=N)
    batch.reset(seed=4)
    rng = np.random.default_rng(0)
    actions = rng.integers(0, 3, (40, N))
    for step in actions[:10]:
        batch.step(step)
    saved = batch.save()
    hashes = batch.call("state_hash")
    first = [batch.step(step) for step in actions]
    for copy in (saved, pickle.loads(pickle.dumps(saved))):
        batch.restore(copy)
        assert batch.call("state_hash") == hashes
        for step, expected in zip(actions, first, strict=True):
            observed = batch.step(step)
            assert same(observed[1:4], expected[1:4])
            images = [
                answer[0]["image"] if isinstance(answer[0], dict) else answer[0] for answer in (observed, expected)
            ]
            assert (images[0] == images[1]).all()
    with pytest.raises(WorldError, match="not saved by a batch of 3 such worlds"):
        batch.restore(gymnasium.make_vec(GRID, num_envs=2).save())


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_mission_is_kept_by_the_automatic_reset(mode):
    batch = gymnasium.make_vec(LEVEL, num_envs=N, autoreset_mode=mode)
    options = {"mission": "go to the red ball"}
    batch.reset(seed=0, options=options)
    batch.set_attr("max_steps", 2)
    for _ in range(6):
        observed = batch.step(np.zeros(N, int))[0]
    assert set(observed["mission"]) == {options["mission"]}
    batch.reset(seed=1, options={"reset_mask": np.array([True, False, False])})
    assert batch.get_attr("mission")[1:] == (options["mission"],) * 2


def test_a_batch_sees_in_first_person_or_in_pixels():
    batch, single = make_both(GRID, view="first_person", obs_width=16, obs_height=12)
    seen = [each.reset(seed=9)[0]["image"] for each in (batch, single)]
    assert seen[0].shape == batch.observation_space["image"].shape == (N, 12, 16, 3)
    assert (seen[0] == seen[1]).all()
    observed = step_both([batch, single], [2, 1, 0])
    assert (observed[0][0]["image"] == observed[1][0]["image"]).all()
    pixels = gymnasium.make_vec(GRID, num_envs=N, pixels="partial", tile_px=4)
    image = pixels.reset(seed=9)[0]["image"]
    assert image.shape == (N, 28, 28, 3)
    assert pixels.unwrapped.single_observation_space["image"].shape == (7, 7, 3)
    assert (image == np.stack(pixels.call("frame", view="partial", tile_px=4))).all()
    assert pixels.call("step_count") == (0,) * N
    with pytest.raises(WorldError, match="does not draw what was last seen"):
        gymnasium.make_vec(GRID, num_envs=N, pixels="full", autoreset_mode="SameStep")


def test_a_row_that_no_longer_fits_is_widened():
    batch = gymnasium.make_vec(GRID, num_envs=N)
    batch.reset(seed=0)
    batch.set_attr("max_steps", 1_000_000)
    batch.set_attr("step_count", 999_998)
    assert [state.row[STEP] for state in batch.states] == [999_998] * N
    assert batch.step(np.zeros(N, int))[3].tolist() == [False] * N
    assert batch.step(np.zeros(N, int))[3].tolist() == [True] * N
