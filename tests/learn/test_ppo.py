import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv

from minihuman.learn.policy.network import Policy, build_policy, get_policy_settings, make_forward
from minihuman.learn.policy.observation import ObservationEncoder
from minihuman.learn.ppo import LeanPpo, TrainingEnv
from transfer_study.plan import FIRST_PERSON_WORLD, GRID_WORLD


@pytest.mark.parametrize(
    ("eyes", "world_id"), [("grid", GRID_WORLD), ("map", GRID_WORLD), ("atari", FIRST_PERSON_WORLD)]
)
def test_acting_written_out_thinks_what_the_policy_thinks(eyes, world_id):
    eyesight = ObservationEncoder(missions=True, sight="whole" if eyes == "map" else "view")
    world = TrainingEnv(world_id, {}, seed=1, eyesight=eyesight)
    torch.manual_seed(2)
    policy = build_policy(world.observation_space, 3, eyes).to(memory_format=torch.channels_last)
    seen, _ = world.reset()
    for action in (0, 2, 1):
        log_probs, value = policy.compute_single_outputs(seen)
        logits, written_out = make_forward(policy)(seen)
        torch.testing.assert_close(torch.log_softmax(logits, dim=0), log_probs, atol=1e-6, rtol=0)
        torch.testing.assert_close(written_out, value, atol=1e-6, rtol=0)
        seen, *_ = world.step(action)


def test_acting_asked_for_again_knows_the_weights_after_an_update():
    world = TrainingEnv(GRID_WORLD, {}, seed=1, eyesight=ObservationEncoder(missions=True))
    policy = build_policy(world.observation_space, 3, "grid")
    seen, _ = world.reset()
    before = make_forward(policy)(seen)[1].clone()
    policy.compute_outputs({name: torch.as_tensor(part)[None] for name, part in seen.items()})[1].sum().backward()
    policy.optimizer.step()
    after = make_forward(policy)(seen)[1]
    torch.testing.assert_close(after, policy.compute_single_outputs(seen)[1], atol=1e-6, rtol=0)
    assert not torch.equal(before, after)


@pytest.fixture(params=[("grid", GRID_WORLD), ("atari", FIRST_PERSON_WORLD)], ids=["grid", "first person"])
def two(request):
    """Stable-Baselines3's PPO and ours, seeded alike, each in a world of its own; short episodes, so that many end."""
    eyes, world_id = request.param
    made = []
    for kind in (PPO, LeanPpo):
        world = TrainingEnv(world_id, {"max_steps": 11}, seed=5, eyesight=ObservationEncoder(missions=True), actions=3)
        ppo = kind(
            Policy, DummyVecEnv([lambda world=world: world]), n_steps=96, batch_size=32, n_epochs=3, seed=7,
            policy_kwargs=get_policy_settings(eyes), device="cpu", ent_coef=0.01,
        )  # fmt: skip
        made.append(ppo)
    return made


def learned(ppo, steps):
    np.random.seed(3)
    torch.manual_seed(3)
    before = {name: parameter.detach().clone() for name, parameter in ppo.policy.named_parameters()}
    ppo.learn(steps, log_interval=None)
    return {name: parameter.detach() - before[name] for name, parameter in ppo.policy.named_parameters()}


def test_an_update_moves_every_weight_as_stable_baselines_does(two):
    theirs, ours = (learned(ppo, 96) for ppo in two)
    for name, moved in theirs.items():
        # Adam divides by a gradient's own size, so where it is next to nothing its rounding shows
        torch.testing.assert_close(
            ours[name], moved, atol=3e-5, rtol=1e-3, msg=lambda text, name=name: f"{name}: {text}"
        )
    assert max(float(moved.abs().max()) for moved in theirs.values()) > 1e-3


def test_a_rollout_holds_what_stable_baselines_collects(two):
    for ppo in two:
        learned(ppo, 96)
    buffer, rollout = two[0].rollout_buffer, two[1]._rollout
    assert np.array_equal(buffer.actions.ravel(), rollout.actions)
    assert np.array_equal(buffer.episode_starts.ravel(), rollout.starts)
    assert rollout.starts.sum() > 5
    np.testing.assert_allclose(rollout.rewards, buffer.rewards.ravel(), atol=1e-6)
    np.testing.assert_allclose(rollout.advantages, buffer.advantages.ravel(), atol=1e-5)
    assert list(two[0].ep_info_buffer) == list(two[1].ep_info_buffer)
