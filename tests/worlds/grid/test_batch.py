import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.batch import MIN_SHARE
from minihuman.worlds.grid.core.cells import EMPTY

WORLDS = ("FourRooms-v0", "DoorKey-5x5-v0", "Dynamic-Obstacles-6x6-v0", "Fetch-5x5-N2-v0", "KeyCorridorS3R1-v0")
N = 5


def make_both(name, mode):
    one = f"minihuman/MiniGrid-{name}"
    alone = SyncVectorEnv([lambda: gymnasium.make(one, max_steps=40)] * N, autoreset_mode=mode)
    batch = gymnasium.make_vec(
        one, num_envs=N, vectorization_mode="vector_entry_point", autoreset_mode=mode, max_steps=40
    )
    return batch, alone


def assert_same(ours, theirs):
    np.testing.assert_array_equal(ours["image"], theirs["image"])
    np.testing.assert_array_equal(ours["direction"], theirs["direction"])
    assert ours["mission"] == theirs["mission"]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("name", WORLDS)
def test_each_world_of_a_batch_is_the_world_it_is_alone(name, mode):
    batch, alone = make_both(name, mode)
    assert_same(batch.reset(seed=7)[0], alone.reset(seed=7)[0])
    batch.action_space.seed(1)
    for _ in range(150):
        actions = batch.action_space.sample()
        ours, theirs = batch.step(actions), alone.step(actions)
        assert_same(ours[0], theirs[0])
        for part in (1, 2, 3):
            np.testing.assert_array_equal(ours[part], theirs[part])
        assert set(ours[4]) == set(theirs[4])
        for i, final in enumerate(theirs[4].get("final_obs", ())):
            assert (final is None) == (ours[4]["final_obs"][i] is None)
            if final is not None:
                assert_same(ours[4]["final_obs"][i], final)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("BabyAI-BossLevel-v0", {}),
        ("BabyAI-PutNextLocal-v0", {}),
        ("BabyAI-PutNextLocal-v0", {"own_steps": True}),
        ("BabyAI-PutNextS7N4Carrying-v0", {}),
        ("BabyAI-KeyInBox-v0", {}),
        ("BabyAI-GoTo-v0", {"num_dists": 60, "max_steps": 99}),  # more objects than a row of int16 numbers
        ("BabyAI-GoTo-v0", {"max_steps": 40_000}),  # more steps
        ("MiniGrid-ObstructedMaze-Full-v1", {}),
    ],
)
def test_a_batch_has_the_states_that_its_worlds_have_alone(name, options):
    batch = gymnasium.make_vec(f"minihuman/{name}", num_envs=N, vectorization_mode="vector_entry_point", **options)
    alone = SyncVectorEnv([lambda: gymnasium.make(f"minihuman/{name}", **options)] * N)
    assert_same(batch.reset(seed=2)[0], alone.reset(seed=2)[0])
    rng = np.random.default_rng(4)
    moved = 0
    for _ in range(700):
        actions = rng.choice(7, N, p=[0.15, 0.15, 0.3, 0.15, 0.1, 0.13, 0.02])
        ours, theirs = batch.step(actions), alone.step(actions)
        assert_same(ours[0], theirs[0])
        np.testing.assert_array_equal(ours[1], theirs[1])
        states = [env.unwrapped.state for env in alone.envs]
        np.testing.assert_array_equal([state.row for state in batch.states], [state.row for state in states])
        moved += sum(state.carrying != EMPTY for state in states)
    assert moved > 100
    assert all(state.row.dtype == np.int32 for state in batch.states)


def test_without_autoreset_ended_worlds_are_reset_by_mask():
    batch, _ = make_both("FourRooms-v0", AutoresetMode.DISABLED)
    batch.reset(seed=0)
    for _ in range(40):
        _, _, _, truncated, _ = batch.step(np.zeros(N, int))
    assert truncated.all()
    with pytest.raises(WorldError, match="world 0 is not in an episode"):
        batch.step(np.zeros(N, int))
    mask = np.array([True, True, True, True, False])
    batch.reset(options={"reset_mask": mask})
    with pytest.raises(WorldError, match="world 4 is not in an episode"):
        batch.step(np.zeros(N, int))


@pytest.mark.parametrize(
    ("actions", "complaint"),
    [(np.zeros(4, int), "5 whole numbers"), (np.zeros(5), "float64"), (np.array([0, 1, 7, 0, 0]), "in world 2")],
)
def test_wrong_actions_are_refused_and_no_world_moves(actions, complaint):
    batch, _ = make_both("FourRooms-v0", AutoresetMode.NEXT_STEP)
    batch.reset(seed=0)
    before = [state.row.copy() for state in batch.states]
    with pytest.raises(WorldError, match=complaint):
        batch.step(actions)
    np.testing.assert_array_equal(before, [state.row for state in batch.states])


def test_a_batch_is_not_stepped_before_its_reset():
    batch, _ = make_both("FourRooms-v0", AutoresetMode.NEXT_STEP)
    with pytest.raises(WorldError, match="call reset"):
        batch.step(np.zeros(N, int))


@pytest.mark.parametrize(
    "options",
    [{}, {"highlight": False}, {"agent_pov": True}, {"palette": "minigrid"}, {"render_mode": "ansi"}],
)
def test_a_batch_renders_each_world_as_it_is_rendered_alone(options):
    options = {"render_mode": "rgb_array", "tile_size": 8} | options
    batch = gymnasium.make_vec("minihuman/MiniGrid-FourRooms-v0", num_envs=2, **options)
    batch.reset(seed=3)
    for seed, rendered in enumerate(batch.render(), 3):
        alone = gymnasium.make("minihuman/MiniGrid-FourRooms-v0", **options)
        alone.reset(seed=seed)
        np.testing.assert_array_equal(rendered, alone.render())


def test_a_mission_is_set_in_a_batch_until_the_next_reset():
    options = {"mission": "go to the red ball"}
    batch = gymnasium.make_vec("minihuman/BabyAI-GoToLocal-v0", num_envs=N)
    alone = gymnasium.make("minihuman/BabyAI-GoToLocal-v0")
    seen, _ = batch.reset(seed=0, options=options)
    assert seen["mission"] == (options["mission"],) * N
    np.testing.assert_array_equal(seen["image"][0], alone.reset(seed=0, options=options)[0]["image"])
    assert len(set(batch.reset(seed=0)[0]["mission"])) > 1
    with pytest.raises(WorldError, match="cannot be set"):
        make_both("FourRooms-v0", AutoresetMode.NEXT_STEP)[0].reset(options=options)


@pytest.mark.nightly(
    by_day=["MiniGrid-FourRooms-v0-AutoresetMode.SAME_STEP", "BabyAI-GoToLocal-v0-AutoresetMode.NEXT_STEP"]
)
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("name", ["MiniGrid-FourRooms-v0", "BabyAI-GoToLocal-v0"])
def test_threads_step_what_one_thread_does(name, mode):
    alone, together = (
        gymnasium.make_vec(
            f"minihuman/{name}",
            num_envs=3 * MIN_SHARE + 1,
            vectorization_mode="vector_entry_point",
            autoreset_mode=mode,
            threads=threads,
            max_steps=9,
        )
        for threads in (1, 3)
    )
    assert_same(alone.reset(seed=3)[0], together.reset(seed=3)[0])
    alone.action_space.seed(1)
    for _ in range(25):
        actions = alone.action_space.sample()
        ours, theirs = together.step(actions), alone.step(actions)
        assert_same(ours[0], theirs[0])
        for part in (1, 2, 3):
            np.testing.assert_array_equal(ours[part], theirs[part])
    wrong = np.full(alone.num_envs, 7)
    wrong[:-1] = 0
    for batch in (alone, together):
        with pytest.raises(WorldError, match=f"action 7 does not exist in world {alone.num_envs - 1}"):
            batch.step(wrong)


def test_no_thread_at_all_is_refused():
    with pytest.raises(WorldError, match="threads is 0; use 1 or more, or None for one per core"):
        gymnasium.make_vec(
            "minihuman/MiniGrid-FourRooms-v0", num_envs=2, vectorization_mode="vector_entry_point", threads=0
        )
