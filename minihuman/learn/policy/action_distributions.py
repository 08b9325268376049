"""Distributions of actions given a policy's outputs: of numbered actions, or of vectors (a diagonal Gaussian).

The outputs for numbered actions are their log-probabilities. The outputs for vectors are the means of the components,
followed by the logarithms of their standard deviations, which do not depend on the observation. A drawn vector is not
squashed: it is clipped to the bounds of a world's action space, and its log-probability is that of the vector before
clipping, as in Stable-Baselines3.
"""

import abc
import math
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

_LOG_SQRT_TAU = 0.5 * math.log(math.tau)


class ActionDistribution(abc.ABC):
    """A kind of distribution of actions, whose parameters are a policy's outputs, float32[batch, outputs]."""

    @abc.abstractmethod
    def draw(self, outputs: torch.Tensor, generator: torch.Generator | None = None) -> torch.Tensor:
        """Draw one action of each row, int64[batch] or float32[batch, components].

        Args:
            outputs: the policy's outputs.
            generator: the source of randomness; None for torch's global generator.
        """

    @abc.abstractmethod
    def log_probability(self, outputs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Return the log-probability, or the logarithm of the density, of each row's action, float32[batch].

        Args:
            outputs: the policy's outputs.
            actions: an action for each row, as ``draw`` returns them.
        """

    @abc.abstractmethod
    def entropy(self, outputs: torch.Tensor) -> torch.Tensor:
        """Return the entropy of each row's distribution in nats, float32[batch]."""


class CategoricalActions(ActionDistribution):
    """Numbered actions; outputs are their log-probabilities."""

    def draw(self, outputs: torch.Tensor, generator: torch.Generator | None = None) -> torch.Tensor:
        """Draw one action of each row, int64[batch]."""
        return torch.multinomial(outputs.exp(), 1, generator=generator).squeeze(1)

    def log_probability(self, outputs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Return the log-probability of each row's action, float32[batch]."""
        return outputs.gather(1, actions[:, None]).squeeze(1)

    def entropy(self, outputs: torch.Tensor) -> torch.Tensor:
        """Return the entropy of each row's distribution in nats, float32[batch]."""
        return -(outputs.exp() * outputs).sum(dim=1)


class GaussianActions(ActionDistribution):
    """Vectors from a diagonal Gaussian; outputs are means and logarithms of standard deviations."""

    def draw(self, outputs: torch.Tensor, generator: torch.Generator | None = None) -> torch.Tensor:
        """Draw one vector of each row, float32[batch, components]."""
        means, log_stds = outputs.chunk(2, dim=1)
        noise = torch.randn(means.shape, generator=generator, device=means.device)
        return means + log_stds.exp() * noise

    def log_probability(self, outputs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Return the logarithm of the density of each row's vector, float32[batch]."""
        means, log_stds = outputs.chunk(2, dim=1)
        deviations = (actions - means) / log_stds.exp()
        return (-0.5 * deviations.square() - log_stds - _LOG_SQRT_TAU).sum(dim=1)

    def entropy(self, outputs: torch.Tensor) -> torch.Tensor:
        """Return the entropy of each row's distribution in nats, float32[batch]."""
        _, log_stds = outputs.chunk(2, dim=1)
        return (log_stds + 0.5 + _LOG_SQRT_TAU).sum(dim=1)


def is_vector_space(space: spaces.Space[Any]) -> bool:
    """Return whether a space has vectors that a Gaussian policy can draw: a Box of one dimension, of floats."""
    return isinstance(space, spaces.Box) and len(space.shape) == 1 and space.dtype.kind == "f"


def clip_actions(space: spaces.Space[Any], actions: NDArray[Any]) -> NDArray[Any]:
    """Return actions, one per row, clipped to the bounds of a world's action space; numbered actions are unchanged."""
    if isinstance(space, spaces.Box):
        clipped: NDArray[Any] = np.clip(actions, space.low, space.high).astype(space.dtype)
        return clipped
    return actions
