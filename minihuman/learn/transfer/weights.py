"""Weights from a trained policy into a fresh one: in place and honestly frozen, or as the published code did it."""

from collections.abc import Iterable, Mapping, Sequence

import torch
from torch import nn

from minihuman.errors import LearnError
from minihuman.learn.agent.network import ACTOR_HEAD, part_parameters
from minihuman.learn.transfer.plan import ProtocolName

Weights = Mapping[str, torch.Tensor]


def transfer_in_place(
    policy: nn.Module, source: Weights, parts: Iterable[str], *, frozen: bool, head_rows: Sequence[int]
) -> None:
    """Copy parts of a source's weights into the policy's own parameters, so that the optimiser still holds them.

    ``head_rows`` says which of the source's actions each of the policy's actions is; the actor's head takes those
    rows. Frozen parameters get no gradient and stay equal to the bit.

    Raises:
        LearnError: if the source lacks a parameter or has another shape.
    """
    for part in sorted(parts):
        for name, parameter in part_parameters(policy, part).items():
            value = _find(source, name)
            if name.startswith(ACTOR_HEAD):
                value = value[list(head_rows)]
            if value.shape != parameter.shape:
                raise LearnError(
                    f"{name} is {tuple(value.shape)} in the source and {tuple(parameter.shape)} here; "
                    "the source was trained with another network"
                )
            with torch.no_grad():
                parameter.copy_(value)
            parameter.requires_grad_(not frozen)


def transfer_as_published(
    policy: nn.Module, source: Weights, parts: frozenset[str], *, frozen: bool, state: ProtocolName = "as-published"
) -> None:
    """Reproduce the published code, defects included (named in ``plan.DEFECTS``).

    Call it after the optimiser is built: the replaced parameters are then not in it. The actor's head becomes as
    wide as the source's. Until June 2023 the critic's head had its weight frozen always, its bias moved only so.
    """
    old_head = state == "as-published-2023-05-28"
    for part in sorted(parts):
        for name in part_parameters(policy, part):
            if old_head and name == "value_net.bias" and not frozen:
                continue
            misspelled = parts == frozenset("CM") and part == "M"
            free = (not frozen or misspelled) and not (old_head and name == "value_net.weight")
            _replace(policy, name, nn.Parameter(_find(source, name).clone(), requires_grad=free))


def _replace(policy: nn.Module, name: str, parameter: nn.Parameter) -> None:
    owner, _, attribute = name.rpartition(".")
    setattr(policy.get_submodule(owner), attribute, parameter)


def _find(source: Weights, name: str) -> torch.Tensor:
    try:
        return source[name]
    except KeyError:
        raise LearnError(f"the source has no {name}; it was trained with another network") from None
