import pickle
import time

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.first_person.batch import FirstPersonBatch
from minihuman.worlds.first_person.layouts.one_room import OneRoom
from minihuman.worlds.first_person.render import drawing
from minihuman.worlds.first_person.render.drawing import RenderTarget
from minihuman.worlds.first_person.state import FlatState

SIZE = {"obs_width": 16, "obs_height": 12}


def batch(name="OneRoomS6Fast", num_envs=3, **options):
    return gymnasium.make_vec(
        f"minihuman/MiniWorld-{name}-v0",
        num_envs=num_envs,
        vectorization_mode="vector_entry_point",
        **SIZE,
        **options,
    )


def singles(name, num_envs, mode, **options):
    make = lambda: gymnasium.make(f"minihuman/MiniWorld-{name}-v0", **SIZE, **options)  # noqa: E731
    return gymnasium.vector.SyncVectorEnv([make] * num_envs, autoreset_mode=mode)


OPTIONS = {"CollectHealth": {"contact_shadows": True}, "FourRooms": {"trig": 1}, "PutNext": {"domain_rand": True}}


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize(
    ("name", "options"),
    [
        *((name, {}) for name in ("OneRoomS6Fast", "CollectHealth", "Sign", "PickupObjects", "PutNext", "TMaze")),
        *OPTIONS.items(),
    ],
)
def test_a_batch_is_its_worlds_one_by_one(name, options, mode):
    ours = batch(name, autoreset_mode=mode, max_steps=25, **options)
    theirs = singles(name, 3, gymnasium.vector.AutoresetMode(mode), max_steps=25, **options)
    seen, _ = ours.reset(seed=4)
    expected, _ = theirs.reset(seed=4)
    assert _same(seen, expected)
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(70):
        # what lies before it is picked up where that is an action, and carried
        actions = rng.choice([0, 1, 2, 2, ours.single_action_space.n - 1, min(4, ours.single_action_space.n - 1)], 3)
        stepped, expected_step = ours.step(actions), theirs.step(actions)
        assert _same(stepped[0], expected_step[0])
        for mine, their in zip(stepped[1:4], expected_step[1:4], strict=True):
            assert np.array_equal(mine, their)
        assert _hashes(ours.worlds) == _hashes(env.unwrapped for env in theirs.envs)
        ends += int(stepped[2].sum() + stepped[3].sum())
        assert stepped[4].keys() == expected_step[4].keys()
        if name == "CollectHealth":
            assert np.array_equal(stepped[4]["health"], expected_step[4]["health"])
        if "final_obs" in expected_step[4]:
            for mine, their in zip(stepped[4]["final_obs"], expected_step[4]["final_obs"], strict=True):
                assert (mine is None) == (their is None)
                assert mine is None or _same(mine, their)
    assert ends > 0
    ours.close()


def _meddle(nth, worlds, saved):
    """What may be done to a batch's worlds between two of its steps."""
    world = worlds[nth % 3]
    if nth % 7 == 0:
        saved[nth % 3] = world.save()
    elif nth % 7 == 1:
        world.agent.dir += 0.25
    elif nth % 7 == 2:
        world.advance(2)
    elif nth % 7 == 3 and nth % 3 in saved:
        world.restore(saved[nth % 3])
    elif nth % 7 == 4:
        world.entities[0].pos = (1.0, 0.0, 1.0)
        world.state_hash()
    elif nth % 7 == 5:
        world.reset(seed=nth)
    elif world.agent.carrying is None:
        gone = next(each for each in world.entities if each is not world.agent)
        world.entities.remove(gone)


@pytest.mark.parametrize("name", ["PickupObjects", "CollectHealth"])
def test_what_is_done_to_a_world_of_a_batch_between_steps_counts(name):
    ours, theirs = batch(name, autoreset_mode="SameStep"), singles(name, 3, gymnasium.vector.AutoresetMode.SAME_STEP)
    ours.reset(seed=2), theirs.reset(seed=2)
    others, saved, their_saved = [env.unwrapped for env in theirs.envs], {}, {}
    rng = np.random.default_rng(1)
    for nth in range(60):
        if nth % 2:
            _meddle(nth // 2, ours.worlds, saved)
            _meddle(nth // 2, others, their_saved)
        actions = rng.choice([0, 1, 2, 2, 4], 3)
        assert _same(ours.step(actions)[0], theirs.step(actions)[0])
        assert _hashes(ours.worlds) == _hashes(others)
    ours.close()


@pytest.mark.parametrize("name", ["PickupObjects", "FourRooms"])
def test_kernels_alone_step_a_batch_while_nothing_else_happens(name, monkeypatch):
    worlds = batch(name, num_envs=5)
    worlds.reset(seed=0)
    with monkeypatch.context() as patch:
        for cls in (FlatState, RenderTarget):
            patch.setattr(cls, "step" if cls is FlatState else "aim", None)
        for step in range(8):
            seen = worlds.step(np.full(5, step % 3))[0]
    assert all(np.array_equal(each, world.observe()) for each, world in zip(seen, worlds.worlds, strict=True))
    worlds.close()


def test_a_copy_of_a_batch_goes_on_as_the_batch():
    worlds = batch("OneRoomS6Fast")
    worlds.reset(seed=3)
    worlds.step(np.full(3, 2))
    other = pickle.loads(pickle.dumps(worlds))
    for step in range(5):
        assert _same(other.step(np.full(3, step % 3))[0], worlds.step(np.full(3, step % 3))[0])
    worlds.close()
    other.close()


@pytest.mark.parametrize("kind", ["int32", "uint64"])
def test_actions_may_be_any_whole_numbers(kind):
    worlds, others = batch("OneRoomS6Fast"), batch("OneRoomS6Fast")
    worlds.reset(seed=3), others.reset(seed=3)
    for step in range(70):
        assert _same(worlds.step(np.full(3, step % 3, kind))[0], others.step(np.full(3, step % 3))[0])
    worlds.close()
    others.close()


def test_one_thread_and_two_draw_the_same():
    frames = []
    for threads in (1, 2):
        worlds = batch("FourRooms", num_envs=4, threads=threads)
        worlds.reset(seed=0)
        frames.append([worlds.step(np.full(4, step % 3))[0] for step in range(4)])
        worlds.close()
    assert np.array_equal(frames[0], frames[1])


@pytest.mark.parametrize("spans", [drawing.MOST_SPANS, 1])  # 1: no row has room for its spans, so each is drawn again
def test_a_batch_sees_what_its_worlds_see_one_by_one(spans, monkeypatch):
    monkeypatch.setattr(drawing, "MOST_SPANS", spans)
    worlds = batch("PickupObjects", num_envs=11, threads=3)
    seen, _ = worlds.reset(seed=3)
    for step in range(6):
        assert all(np.array_equal(each, world.observe()) for each, world in zip(seen, worlds.worlds, strict=True))
        assert len({each.tobytes() for each in seen}) == 11
        seen = worlds.step(np.full(11, step % 3))[0]
    worlds.close()


class Failing(OneRoom):
    """Takes long to judge a step, and cannot judge the third."""

    def reward_and_done(self, action):
        time.sleep(0.002)
        if self.step_count == 3:
            raise ZeroDivisionError("a lab's own mistake")
        return super().reward_and_done(action)


def test_a_world_that_fails_says_so_and_the_batch_goes_on():
    worlds = FirstPersonBatch(lambda: Failing(**SIZE), num_envs=9, threads=2)
    expected, _ = worlds.reset(seed=1)
    worlds.step(np.zeros(9, int))
    worlds.step(np.zeros(9, int))
    with pytest.raises(ZeroDivisionError, match="a lab's own mistake"):
        worlds.step(np.zeros(9, int))
    assert np.array_equal(worlds.reset(seed=1)[0], expected)
    worlds.close()


def test_a_mask_resets_some_worlds_only():
    worlds = batch("FourRooms", autoreset_mode="Disabled")
    worlds.reset(seed=0)
    worlds.step(np.array([2, 2, 2]))
    kept = worlds.worlds[0].state_hash()
    worlds.reset(seed=9, options={"reset_mask": np.array([False, True, True])})
    assert worlds.worlds[0].state_hash() == kept
    assert worlds.worlds[1].step_count == 0
    worlds.close()


def test_misuse_is_named_and_changes_nothing():
    worlds = batch("FourRooms")
    with pytest.raises(WorldError, match="has not been reset"):
        worlds.step(np.zeros(3, int))
    worlds.reset(seed=0)
    before = [world.state_hash() for world in worlds.worlds]
    for actions, said in (([0, 0], "3 whole numbers"), ([0, 0, 7], "action is 7"), ([0.0, 0.0, 0.0], "whole numbers")):
        with pytest.raises(WorldError, match=said):
            worlds.step(actions)
    assert [world.state_hash() for world in worlds.worlds] == before
    with pytest.raises(WorldError, match="2 seeds for 3 worlds"):
        worlds.reset(seed=[1, 2])
    with pytest.raises(WorldError, match="reset_mask"):
        worlds.reset(options={"reset_mask": np.ones(2, bool)})
    with pytest.raises(WorldError, match="num_envs is 0"):
        batch(num_envs=0)
    worlds.close()


def _hashes(worlds):
    return [(world.state_hash(), world.scene_hash(), world.pose(), world.step_count) for world in worlds]


def _same(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(np.array_equal(a[key], b[key]) for key in a)
    return np.array_equal(a, b)
