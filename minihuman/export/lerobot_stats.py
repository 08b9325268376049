"""The statistics that LeRobot keeps of every feature: minimum, maximum, mean, deviation and five quantiles."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


class Total:
    """Running statistics of one feature. Quantiles over episodes are means of theirs by frames, as LeRobot's own are.

    Args:
        picture: whether it is a picture, whose channels are told apart and scaled to 0 to 1.
    """

    def __init__(self, *, picture: bool) -> None:
        self._picture = picture
        self._frames = 0
        self._samples = 0
        self._low: Any = np.inf
        self._high: Any = -np.inf
        self._sum: Any = 0.0
        self._squares: Any = 0.0
        self._quantiles: Any = 0.0  # (5, numbers) times frames

    def add(self, values: NDArray[Any]) -> None:
        """Take an episode's values in, a row a frame."""
        samples = _channels(values) if self._picture else values.reshape(len(values), -1).astype(np.float64)
        self._frames += len(values)
        self._samples += len(samples)
        self._low = np.minimum(self._low, samples.min(axis=0))
        self._high = np.maximum(self._high, samples.max(axis=0))
        self._sum = self._sum + samples.sum(axis=0)
        self._squares = self._squares + (samples**2).sum(axis=0)
        levels = list(QUANTILES.values())
        found = _of_bytes(values, levels) if self._picture else np.quantile(samples, levels, axis=0)
        self._quantiles = self._quantiles + found * len(values)

    def statistics(self) -> dict[str, Any]:
        """As the format keeps them: a list a number, [[[value]]] a channel of a picture."""
        mean = self._sum / self._samples
        values = {
            "min": self._low,
            "max": self._high,
            "mean": mean,
            "std": np.sqrt(np.maximum(self._squares / self._samples - mean**2, 0.0)),
            **dict(zip(QUANTILES, self._quantiles / self._frames, strict=True)),
        }
        shape = (-1, 1, 1) if self._picture else (-1,)
        return {key: value.reshape(shape).tolist() for key, value in values.items()} | {"count": [self._frames]}


def _channels(pictures: NDArray[np.uint8]) -> NDArray[np.float64]:
    return pictures.reshape(-1, pictures.shape[-1]) / 255.0


def _of_bytes(pictures: NDArray[np.uint8], levels: list[float]) -> NDArray[np.float64]:
    """Quantiles of each channel, from how often each of its 256 values occurs."""
    found = []
    for channel in pictures.reshape(-1, pictures.shape[-1]).T:
        share = np.cumsum(np.bincount(channel, minlength=256)) / channel.size
        found.append(np.searchsorted(share, levels) / 255.0)
    return np.array(found).T
