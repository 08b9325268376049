import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import MultiInputActorCriticPolicy

from minihuman.learn.policy.network import CellEncoder, CodeEncoder, Policy, get_policy_settings
from minihuman.learn.policy.observation import SPREAD


@pytest.fixture(params=[("grid", (3, 7, 7), 7), ("atari", (3, 60, 80), 3)], ids=["grid", "atari"])
def pair(request):
    """Our policy and Stable-Baselines3's with the same weights, and something to look at."""
    eyes, shape, actions = request.param
    space = spaces.Dict({"image": spaces.Box(0, 255, shape, np.uint8), "mission": spaces.Box(0, 1, (9,), np.float32)})
    made = [
        kind(space, spaces.Discrete(actions), lambda _: 3e-4, **get_policy_settings(eyes))
        for kind in (Policy, MultiInputActorCriticPolicy)
    ]
    made[1].load_state_dict(made[0].state_dict())
    rng = np.random.default_rng(1)
    seen = {
        "image": torch.as_tensor(rng.integers(0, 256, (16, *shape), dtype=np.uint8)),
        "mission": torch.as_tensor(rng.random((16, 9), dtype=np.float32)),
    }
    return *made, seen


def test_it_draws_the_same_actions_as_stable_baselines(pair):
    ours, theirs, seen = pair
    for deterministic in (False, True):
        torch.manual_seed(4)
        expected = theirs(seen, deterministic)
        torch.manual_seed(4)
        drawn = ours(seen, deterministic)
        assert torch.equal(drawn[0], expected[0])
        torch.testing.assert_close(drawn[1:], expected[1:])


def test_it_judges_actions_as_stable_baselines_does(pair):
    ours, theirs, seen = pair
    actions = torch.arange(16) % ours.action_space.n
    torch.testing.assert_close(ours.evaluate_actions(seen, actions), theirs.evaluate_actions(seen, actions))


def test_its_gradients_are_those_of_stable_baselines(pair):
    gradients = []
    for policy in pair[:2]:
        values, log_prob, entropy = policy.evaluate_actions(pair[2], torch.zeros(16, dtype=torch.int64))
        (values.mean() + log_prob.mean() + entropy.mean()).backward()
        gradients.append({name: parameter.grad for name, parameter in policy.named_parameters()})
    torch.testing.assert_close(*gradients)


@pytest.mark.parametrize("kind", [CodeEncoder, CellEncoder])
def test_weights_looked_up_give_the_numbers_and_gradients_of_one_hot_inputs(kind):
    torch.manual_seed(1)
    rng = np.random.default_rng(2)
    codes = torch.as_tensor(np.stack([rng.integers(0, size, (32, 5, 6)) for size in kind.sizes], axis=1))
    image = (codes * torch.tensor(kind.factors).view(3, 1, 1)).to(torch.uint8)
    encoder = kind(spaces.Box(0, 255, (3, 5, 6), np.uint8))
    hot = [torch.nn.functional.one_hot(codes[:, part], size).flatten(1) for part, size in enumerate(kind.sizes)]
    answers = []
    for compute in (lambda: encoder(image), lambda: encoder.layers(torch.cat(hot, dim=1).float())):
        encoder.zero_grad()
        features = compute()
        (features * torch.linspace(-1, 1, 64)).sum().backward()
        answers.append([features.detach(), *(parameter.grad.clone() for parameter in encoder.parameters())])
    torch.testing.assert_close(*answers, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(encoder(image / 255), answers[0][0], atol=1e-6, rtol=1e-5)


def test_codes_of_worlds_with_kinds_of_their_own_are_told_apart():
    image = torch.zeros(2, 3, 5, 5, dtype=torch.uint8)
    image[0, 0, 2, 2] = 12  # the second of its own kinds
    image[1, 0, 2, 2] = 2
    encoder = CellEncoder(spaces.Box(0, 255, (3, 5, 5), np.uint8))
    assert not torch.equal(*encoder(image).detach())
    assert max(SPREAD) * 3 > 255, "why these codes are not spread"
