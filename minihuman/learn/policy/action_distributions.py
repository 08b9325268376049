"""How a policy's outputs become actions: one of several by number, or a vector from a diagonal Gaussian.

The outputs for numbered actions are their log-probabilities. Those for vectors are the means of the components,
followed by the logarithms of their standard deviations, which do not depend on the observation. A drawn vector is not
squashed: worlds take it clipped to the bounds of their action space, and its log-probability is that of the vector
before it was clipped, as in Stable-Baselines3.
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
    """The distribution of actions that a policy's outputs, float32[batch, outputs], stand for."""

    @abc.abstractmethod
    def draw(self, outputs: torch.Tensor, generator: torch.Generator | None = None) -> torch.Tensor:
        """Draw one action of each row, int64[batch] or float32[batch, components]."""

    @abc.abstractmethod
    def log_probability(self, outputs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Return the log-probability, or the logarithm of the density, of each row's action, float32[batch]."""

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
    """Return whether actions are vectors that a Gaussian policy can draw: a Box of one dimension with fractions."""
    return isinstance(space, spaces.Box) and len(space.shape) == 1 and space.dtype.kind == "f"


def clip_actions(space: spaces.Space[Any], actions: NDArray[Any]) -> NDArray[Any]:
    """Return actions, one a row, within the bounds of a world's action space; numbered ones as they are."""
    if isinstance(space, spaces.Box):
        clipped: NDArray[Any] = np.clip(actions, space.low, space.high).astype(space.dtype)
        return clipped
    return actions
