"""Learning curves: area, improvement over a baseline, and how sure one can be. Numbers only, no training."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RESAMPLES = 10_000


def area_under(steps: NDArray[np.float64], rewards: NDArray[np.float64]) -> float:
    """The trapezoid area under a reward curve whose steps are divided by the last one.

    ``steps`` and ``rewards`` have one value an update. A curve of one update has no area and yields its reward. The
    curve starts at its first update, not at 0, as in the published study.

    Raises:
        ValueError: if the two differ in length, are empty, or the steps do not grow.
    """
    x, y = np.asarray(steps, dtype=float), np.asarray(rewards, dtype=float)
    if len(x) != len(y) or not len(x) or np.any(np.diff(x) <= 0):
        raise ValueError(f"a curve needs as many growing steps as rewards; got {len(x)} steps and {len(y)} rewards")
    if len(x) == 1:
        return float(y[0])
    return float(np.trapezoid(y, x / x[-1]))


@dataclass(frozen=True, slots=True)
class Improvement:
    """How much more area a transfer has than the baseline, relative to the baseline: 0.1 is 10 % more.

    ``low`` and ``high`` bound the mean with 95 % confidence by bootstrap; NaN where fewer than two runs of either
    side leave no spread to resample. ``sd`` is NaN for one run.
    """

    mean: float
    sd: float
    low: float
    high: float
    runs: int


def improvement(
    transfer: NDArray[np.float64], baseline: NDArray[np.float64], *, rng: np.random.Generator
) -> Improvement:
    """``(transfer AUC - baseline AUC) / baseline AUC`` over the runs of both, one area a run.

    The interval resamples transfer and baseline runs independently, so the baseline's own spread is in it. (The
    published script divided by the area of a single baseline run, as if it were known exactly.)
    """
    ours, base = np.asarray(transfer, dtype=float), np.asarray(baseline, dtype=float)
    relative = ours / base.mean() - 1
    sd = float(relative.std(ddof=1)) if len(relative) > 1 else float("nan")
    low = high = float("nan")
    if len(ours) > 1 and len(base) > 1:
        means = _resampled_means(ours, rng) / _resampled_means(base, rng) - 1
        low, high = (float(value) for value in np.quantile(means, (0.025, 0.975)))
    return Improvement(mean=float(relative.mean()), sd=sd, low=low, high=high, runs=len(ours))


def _resampled_means(values: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    draws = rng.integers(len(values), size=(RESAMPLES, len(values)))
    means: NDArray[np.float64] = values[draws].mean(axis=1)
    return means


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """The 95 % score interval (Wilson, 1927) of a success rate; (0, 1) where nothing was tried."""
    if trials == 0:
        return 0.0, 1.0
    z = 1.959963984540054
    rate = successes / trials
    middle = rate + z * z / (2 * trials)
    half = z * np.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return float(max(0.0, (middle - half) / scale)), float(min(1.0, (middle + half) / scale))
