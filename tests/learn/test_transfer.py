import numpy as np
import pytest
import torch
from gymnasium import spaces

from minihuman.errors import LearnError
from minihuman.learn.policy.network import build_policy
from transfer_study.job import PARTS, get_part_parameters, transfer_as_published, transfer_in_place


def space(height, width):
    return spaces.Dict(
        {"image": spaces.Box(0, 255, (3, height, width), np.uint8), "mission": spaces.Box(0, 1, (9,), np.float32)}
    )


@pytest.fixture(scope="module")
def source():
    torch.manual_seed(1)
    policy = build_policy(space(7, 7), 7, "grid")
    with torch.no_grad():
        for parameter in policy.parameters():
            parameter.normal_()  # biases start at zero, which would hide a copy
    return policy.state_dict()


@pytest.fixture
def target():
    torch.manual_seed(2)
    return build_policy(space(60, 80), 3, "atari")


def weights_of(policy):
    return {name: parameter.detach().clone() for name, parameter in policy.named_parameters()}


def one_step(policy):
    """A step of the policy's own optimiser on everything it computes."""
    rng = np.random.default_rng(3)
    seen = {
        "image": torch.as_tensor(rng.integers(0, 256, (8, 3, 60, 80), dtype=np.uint8)),
        "mission": torch.as_tensor(rng.random((8, 9), dtype=np.float32)),
    }
    policy.optimizer.zero_grad()
    values, log_prob, entropy = policy.evaluate_actions(seen, torch.as_tensor([0, 1, 2, 0, 1, 2, 0, 1]))
    (values.sum() + log_prob.sum() + entropy.sum()).backward()
    torch.nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
    policy.optimizer.step()


def moved(before, policy):
    return {name for name, parameter in policy.named_parameters() if not torch.equal(before[name], parameter)}


def names_of(policy, parts):
    return {name for part in parts for name in get_part_parameters(policy, part)}


def test_the_parts_and_the_eyes_are_the_whole_network(target):
    everything = set(weights_of(target))
    eyes = {name for name in everything if name.startswith("features_extractor.image.")}
    assert names_of(target, PARTS) | eyes == everything
    assert sum(len(names_of(target, part)) for part in PARTS) == len(names_of(target, PARTS))


def test_the_network_is_the_published_one(target):
    shapes = {name: tuple(parameter.shape) for name, parameter in target.named_parameters()}
    assert shapes["features_extractor.mission.weight"] == (32, 9)
    assert shapes["features_extractor.image.linear.0.weight"] == (64, 1536)
    assert shapes["mlp_extractor.policy_net.0.weight"] == (64, 96)
    assert shapes["mlp_extractor.policy_net.2.weight"] == (64, 64)
    assert shapes["mlp_extractor.value_net.0.weight"] == (64, 96)
    assert shapes["action_net.weight"] == (3, 64)


@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("parts", ["M", "A", "C", "AM", "CM", "ACM"])
def test_transfer_copies_exactly_its_parts_and_only_frozen_ones_stay(source, target, parts, frozen):
    fresh = weights_of(target)
    transfer_in_place(target, source, parts, frozen=frozen, head_rows=range(3))
    transferred = names_of(target, parts)
    assert moved(fresh, target) == transferred
    for name in transferred:
        expected = source[name][:3] if name.startswith("action_net.") else source[name]
        assert torch.equal(dict(target.named_parameters())[name], expected)

    before = weights_of(target)
    one_step(target)
    stayed = transferred if frozen else set()
    assert moved(before, target) == set(before) - stayed


def test_the_heads_rows_follow_the_shared_actions(source, target):
    transfer_in_place(target, source, "A", frozen=False, head_rows=(2, 0, 1))
    assert torch.equal(target.action_net.weight, source["action_net.weight"][[2, 0, 1]])


def test_a_source_of_another_network_is_refused(target):
    with pytest.raises(LearnError, match="the source has no"):
        transfer_in_place(target, {}, "M", frozen=False, head_rows=range(3))
    other = {"features_extractor.mission.weight": torch.zeros(5, 9), "features_extractor.mission.bias": torch.zeros(32)}
    with pytest.raises(LearnError, match="another network"):
        transfer_in_place(target, other, "M", frozen=False, head_rows=range(3))


@pytest.mark.parametrize("state", ["as-published", "as-published-2023-05-28"])
@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("parts", ["M", "A", "C", "AM", "CM", "ACM"])
def test_as_published_transferred_layers_never_move(source, target, parts, frozen, state):
    transfer_as_published(target, source, frozenset(parts), frozen=frozen, state=state)
    before = weights_of(target)
    one_step(target)
    left = {"value_net.bias"} if state == "as-published-2023-05-28" and not frozen else set()
    still = names_of(target, parts) - left
    assert moved(before, target) == set(before) - still


def test_as_published_the_actor_has_seven_outputs_where_three_actions_are(source, target):
    transfer_as_published(target, source, frozenset("A"), frozen=False)
    assert target.action_net.weight.shape == (7, 64)


def test_as_published_frozen_cm_leaves_m_free(source, target):
    transfer_as_published(target, source, frozenset("CM"), frozen=True)
    free = {name for name, parameter in target.named_parameters() if parameter.requires_grad}
    assert names_of(target, "M") <= free
    assert not names_of(target, "C") & free


def test_until_june_2023_the_critics_head_was_frozen_in_every_row(source, target):
    transfer_as_published(target, source, frozenset("C"), frozen=False, state="as-published-2023-05-28")
    assert not target.value_net.weight.requires_grad
    assert not torch.equal(target.value_net.bias, source["value_net.bias"])


def test_as_published_the_critics_head_moves_whole(source, target):
    transfer_as_published(target, source, frozenset("C"), frozen=False)
    assert target.value_net.weight.requires_grad
    assert torch.equal(target.value_net.bias, source["value_net.bias"])


def test_as_published_gradients_of_replaced_layers_pile_up(source, target):
    transfer_as_published(target, source, frozenset("M"), frozen=False)
    one_step(target)
    first = target.features_extractor.mission.weight.grad.clone()
    one_step(target)
    assert not torch.equal(first, target.features_extractor.mission.weight.grad)


def test_as_published_frozen_layers_get_no_gradient(source, target):
    transfer_as_published(target, source, frozenset("M"), frozen=True)
    one_step(target)
    assert target.features_extractor.mission.weight.grad is None
