"""Statistics of the features of a dataset, merged episode by episode, as LeRobot stores them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_LEVELS = list(QUANTILES.values())


class FeatureStatistics:
    """Statistics of one feature over episodes. As in LeRobot, their quantiles are means weighted by numbers of frames.

    Args:
        values: an episode's values, one row per frame; a picture is uint8 (frames, H, W, 3), with separate statistics
            for each channel, scaled to the range 0 to 1.
    """

    def __init__(self, values: NDArray[Any]) -> None:
        self._is_picture = values.ndim == 4
        self._n_frames = len(values)
        quantiles = self._measure_pictures(values) if self._is_picture else self._measure_numbers(values)
        self._quantiles = quantiles * len(values)  # (5, numbers) times frames

    def _measure_pictures(self, pictures: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Set the statistics of pictures, of shape (frames, H, W, 3); return the quantiles, of shape (5, 3)."""
        counts = np.array([_count_levels(channel) for channel in pictures.reshape(-1, 3).T])
        scale = np.arange(256) / 255.0
        occurs = counts > 0
        share = np.cumsum(counts, axis=1) / counts[0].sum()
        self._n_samples = int(counts[0].sum())
        self._low = scale[occurs.argmax(axis=1)]
        self._high = scale[255 - occurs[:, ::-1].argmax(axis=1)]  # the last level that occurs
        self._sum = counts @ scale
        self._squares = counts @ scale**2
        return np.array([scale[np.searchsorted(channel, _LEVELS)] for channel in share]).T

    def _measure_numbers(self, rows: NDArray[Any]) -> NDArray[np.float64]:
        """Set the statistics of numbers, one row per frame; return the quantiles, of shape (5, numbers)."""
        samples = rows.reshape(len(rows), -1).astype(np.float64)
        self._n_samples = len(samples)
        self._low = samples.min(axis=0)
        self._high = samples.max(axis=0)
        self._sum = samples.sum(axis=0)
        self._squares = (samples**2).sum(axis=0)
        return np.quantile(samples, _LEVELS, axis=0)

    def add(self, other: "FeatureStatistics") -> None:
        """Merge another episode's statistics into these."""
        self._n_frames += other._n_frames
        self._n_samples += other._n_samples
        self._low = np.minimum(self._low, other._low)
        self._high = np.maximum(self._high, other._high)
        self._sum = self._sum + other._sum
        self._squares = self._squares + other._squares
        self._quantiles = self._quantiles + other._quantiles

    def statistics(self) -> dict[str, Any]:
        """Return each statistic by LeRobot's name for it, as a list with one entry per number of the feature.

        For pictures, it is a list of [[number]], one per channel. "count" is a list with the number of frames.
        """
        mean = self._sum / self._n_samples
        values = {
            "min": self._low,
            "max": self._high,
            "mean": mean,
            "std": np.sqrt(np.maximum(self._squares / self._n_samples - mean**2, 0.0)),
            **dict(zip(QUANTILES, self._quantiles / self._n_frames, strict=True)),
        }
        shape = (-1, 1, 1) if self._is_picture else (-1,)
        return {name: numbers.reshape(shape).tolist() for name, numbers in values.items()} | {"count": [self._n_frames]}


def _count_levels(samples: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return how often each of the 256 levels occurs; two samples are counted at a time, which is faster."""
    n_pairs = len(samples) // 2
    pairs = np.ascontiguousarray(samples[: 2 * n_pairs]).view(np.uint16)
    # a pair is one number of 16 bits: its high byte is the row, its low byte the column
    by_pair = np.bincount(pairs, minlength=1 << 16).reshape(256, 256)
    counts: NDArray[np.int64] = by_pair.sum(axis=0) + by_pair.sum(axis=1)
    return counts + np.bincount(samples[2 * n_pairs :], minlength=256)


NO_STATISTICS = dict.fromkeys(("min", "max", "mean", "std", *QUANTILES, "count"))  # of a column without values


def select_known(column: NDArray[Any]) -> NDArray[Any]:
    """Return the rows of a column that can enter statistics: finite numbers and booleans, but no texts or None.

    Columns of vectors and pictures are returned as they are.
    """
    if column.dtype == object:
        return np.array([cell for cell in column if isinstance(cell, bool)], np.bool_)
    if column.dtype.kind == "f" and column.ndim == 1:
        finite: NDArray[Any] = column[np.isfinite(column)]
        return finite
    return column
