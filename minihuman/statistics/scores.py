"""Success rates and scores: Wilson's interval of a rate; scores of players on the same levels, human-normalised and
relative, with crossed bootstrap intervals. Needs neither scipy nor pandas.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Compute the 95 % score interval (Wilson, 1927) of a success rate; (0, 1) where nothing was tried."""
    if trials == 0:
        return 0.0, 1.0
    z = 1.959963984540054
    rate = successes / trials
    middle = rate + z * z / (2 * trials)
    half = z * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


Array = NDArray[np.float64]
DRAWS = 2_000
HUMAN_REFERENCE = 10  # people from whom on a reference is called human


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and its 95 % interval; NaN where it cannot be known."""

    value: float
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Say whether the interval contains a value."""
        return self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class Runs:
    """One player's episodes on some levels; NaN where a run has no episode of a level.

    Attributes:
        success: (runs, levels), 1 or 0; means over a run's repeated episodes.
        efficiency: (runs, levels), the fewest steps over the steps taken, 0 without success; NaN where the fewest are
            not known.
        steps: (runs, levels), the step limit without success.
    """

    success: Array
    efficiency: Array
    steps: Array


@dataclass(frozen=True, slots=True)
class PlayerScore:
    """How one player compares with the reference on the levels that both played."""

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

    The human-normalised score is that of Mnih et al. (2015), of efficiency: (player - floor) / (reference - floor).

    Args:
        player: whose score it is; the reference itself scores 1 with the spread of its own people.
        reference: people, or who stands in for them.
        floor: the random player; None: 0.
        seed: of the draws.
        draws: of the bootstrap.
    """
    rng = np.random.default_rng(seed)
    level_weights = _draw_weights(rng, player.success.shape[1], draws)
    player_weights = _draw_weights(rng, len(player.success), draws)
    reference_weights = _draw_weights(rng, len(reference.success), draws)
    means = _average_runs(player, player_weights, level_weights)
    reference_means = _average_runs(reference, reference_weights, level_weights)
    if floor is None:
        least = np.zeros(draws + 1)
    else:
        floor_weights = _draw_weights(rng, len(floor.success), draws)
        least = _weighted_mean(floor.efficiency, floor_weights, level_weights)
    with np.errstate(invalid="ignore", divide="ignore"):
        normalised = (means["efficiency"] - least) / (reference_means["efficiency"] - least)
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
    """Draw how often each of ``count`` is in each draw, (draws + 1, count); the first draw is the sample itself."""
    resamples = rng.multinomial(count, np.full(count, 1 / count), size=draws).astype(float)
    return np.concatenate([np.ones((1, count)), resamples])


def _average_runs(runs: Runs, run_weights: Array, level_weights: Array) -> dict[str, Array]:
    """Average each measure of a player over runs and levels, under each draw's weights."""
    return {
        name: _weighted_mean(getattr(runs, name), run_weights, level_weights)
        for name in ("success", "efficiency", "steps")
    }


def _weighted_mean(values: Array, rows: Array, columns: Array) -> Array:
    """Average (runs, levels) under each draw's weights, (draws + 1,): the mean of each level's mean over its runs."""
    present = ~np.isnan(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        levels = (rows @ np.where(present, values, 0.0)) / (rows @ present.astype(float))
        weights = np.where(np.isnan(levels), 0.0, columns)
        mean: Array = (np.nan_to_num(levels) * weights).sum(1) / weights.sum(1)
    return mean


def _excludes(draws: Array, value: float) -> bool:
    """Say whether the interval of 97.5 %, one of two tests, leaves out a value; False where it cannot be known."""
    interval = _estimate(draws, share=0.975)
    return interval.high < value or interval.low > value


def _estimate(draws: Array, least: float = -np.inf, most: float = np.inf, *, share: float = 0.95) -> Estimate:
    """Return the sample's value, and the percentile interval of the draws."""
    known = draws[1:][np.isfinite(draws[1:])]
    if not len(known) or not np.isfinite(draws[0]):
        return Estimate(float(draws[0]), np.nan, np.nan)
    low, high = np.quantile(known, ((1 - share) / 2, (1 + share) / 2))
    return Estimate(float(draws[0]), float(max(least, low)), float(min(most, high)))
