"""Success rates and scores: the Wilson interval of a rate, and players' scores on the same levels.

Scores are human-normalised and relative, with crossed bootstrap intervals. The module needs neither SciPy nor pandas.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_Z_95 = 1.959963984540054  # the normal distribution's quantile at 0.975


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % score interval (Wilson, 1927) of a success rate; (0, 1) without any trial."""
    if trials == 0:
        return 0.0, 1.0
    z_squared = _Z_95 * _Z_95
    rate = successes / trials
    middle = rate + z_squared / (2 * trials)
    half = _Z_95 * math.sqrt(rate * (1 - rate) / trials + z_squared / (4 * trials * trials))
    scale = 1 + z_squared / trials
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


Array = NDArray[np.float64]
DRAWS = 2_000
HUMAN_REFERENCE = 10  # people from whom on a reference is called human


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and its 95 % interval; NaN where it is unknown."""

    value: float
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether the interval contains a value."""
        return self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class Runs:
    """One player's episodes on some levels; NaN where a run has no episode of a level.

    Attributes:
        success: an array of shape (runs, levels), 1 for success and 0 for failure; the mean of repeated episodes
        efficiency: an array of shape (runs, levels), the fewest possible steps divided by the steps taken; 0 without
            success, NaN where the fewest steps are unknown
        steps: an array of shape (runs, levels), the steps taken; the step limit without success
    """

    success: Array
    efficiency: Array
    steps: Array


@dataclass(frozen=True, slots=True)
class PlayerScore:
    """The scores of one player, compared with the reference on the levels that both played."""

    success: Estimate
    efficiency: Estimate
    normalised: Estimate  # 0: the floor; 1: the reference
    relative_efficiency: Estimate  # the reference's steps over the player's
    difference: Estimate  # of success from the reference's
    separable: bool  # whether the data tell the two apart, in success or in steps, with an error of 5 % over both


def score_player(
    player: Runs, reference: Runs, floor: Runs | None, *, seed: int = 1, draws: int = DRAWS
) -> PlayerScore:
    """Score a player against a reference and a floor, all on the same levels in the same order.

    The human-normalised score is that of Mnih et al. (2015), computed from efficiency: (player - floor) / (reference -
    floor).

    Args:
        player: the runs to score; if they are the reference itself, the score is 1 with the spread of those runs
        reference: the runs of people, or of the player that stands in for them
        floor: the runs of the random player; None for a floor of 0
        seed: the seed of the bootstrap
        draws: the number of bootstrap samples
    """
    rng = np.random.default_rng(seed)
    level_weights = _draw_weights(rng, player.success.shape[1], draws)
    player_weights = _draw_weights(rng, len(player.success), draws)
    reference_weights = _draw_weights(rng, len(reference.success), draws)
    means = _average_runs(player, player_weights, level_weights)
    reference_means = _average_runs(reference, reference_weights, level_weights)
    if floor is None:
        floor_means = np.zeros(draws + 1)
    else:
        floor_weights = _draw_weights(rng, len(floor.success), draws)
        floor_means = _average_weighted(floor.efficiency, floor_weights, level_weights)
    with np.errstate(invalid="ignore", divide="ignore"):
        normalised = (means["efficiency"] - floor_means) / (reference_means["efficiency"] - floor_means)
        relative = reference_means["steps"] / means["steps"]
    differences = means["success"] - reference_means["success"]
    if player is reference:  # one value by definition; the spread is that of people against their mean
        normalised[0] = relative[0] = 1.0
    return PlayerScore(
        success=_estimate(means["success"], 0, 1),
        efficiency=_estimate(means["efficiency"], 0, 1),
        normalised=_estimate(normalised),
        relative_efficiency=_estimate(relative),
        difference=_estimate(differences),
        separable=_excludes(differences, 0.0) or _excludes(relative, 1.0),
    )


def _draw_weights(rng: np.random.Generator, count: int, draws: int) -> Array:
    """Return how often each of ``count`` units is in each bootstrap sample, of shape (draws + 1, count).

    The first row is the original sample, with a weight of 1 for each unit.
    """
    resamples = rng.multinomial(count, np.full(count, 1 / count), size=draws).astype(float)
    return np.concatenate([np.ones((1, count)), resamples])


def _average_runs(runs: Runs, run_weights: Array, level_weights: Array) -> dict[str, Array]:
    """Return the mean of each measure over runs and levels, by measure, under each bootstrap sample's weights."""
    return {
        name: _average_weighted(getattr(runs, name), run_weights, level_weights)
        for name in ("success", "efficiency", "steps")
    }


def _average_weighted(values: Array, run_weights: Array, level_weights: Array) -> Array:
    """Return the mean over levels of each level's mean over runs, under each bootstrap sample's weights.

    Args:
        values: an array of shape (runs, levels); NaN where a run has no episode of a level
        run_weights: the weights of runs, of shape (draws + 1, runs)
        level_weights: the weights of levels, of shape (draws + 1, levels)
    """
    is_present = ~np.isnan(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        level_means = (run_weights @ np.where(is_present, values, 0.0)) / (run_weights @ is_present.astype(float))
        weights = np.where(np.isnan(level_means), 0.0, level_weights)
        mean: Array = (np.nan_to_num(level_means) * weights).sum(1) / weights.sum(1)
    return mean


def _excludes(draws: Array, value: float) -> bool:
    """Return whether the 97.5 % interval of a bootstrap excludes a value; False if there is no interval.

    Two such tests together have an error of at most 5 %.
    """
    interval = _estimate(draws, share=0.975)
    return interval.high < value or interval.low > value


def _estimate(draws: Array, least: float = -np.inf, most: float = np.inf, *, share: float = 0.95) -> Estimate:
    """Return the value of the original sample with the percentile interval of the bootstrap samples.

    Args:
        draws: the value in the original sample, then in each bootstrap sample; those that are not finite are ignored
        least: the smallest possible value, to which the interval is clipped
        most: the largest possible value
        share: the share of bootstrap samples in the interval
    """
    samples = draws[1:]
    finite = samples[np.isfinite(samples)]
    if not len(finite) or not np.isfinite(draws[0]):
        return Estimate(float(draws[0]), np.nan, np.nan)
    low, high = np.quantile(finite, ((1 - share) / 2, (1 + share) / 2))
    return Estimate(float(draws[0]), float(max(least, low)), float(min(most, high)))
