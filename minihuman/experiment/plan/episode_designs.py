"""Adaptive designs of a block: staircase, QUEST+ and prioritized level replay."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.plan.designs import (
    Design,
    DesignDecision,
    Draw,
    PlayedEpisode,
    read_design_settings,
    require_setting,
    round_estimate,
)


class StaircaseSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of a staircase."""

    option: str  # the world's option that the staircase sets
    values: tuple[bool | int | float | str, ...]  # from the easiest to the hardest
    down: int = 2  # successes in a row that lead to a harder value
    step_sizes: tuple[int, ...] = (1,)  # places to move after 0, 1, ... reversals; the last one stays
    start: int = 0  # place of the first value
    stop_reversals: int = 0  # number of reversals after which the block is over; 0 for never
    averaged_reversals: int = 6  # number of last reversals whose mean value is the threshold
    only: dict[str, bool | int | float | str] = {}  # options of the episodes that count; empty for all episodes


class Staircase(Design):
    """A 1-up-N-down staircase (Levitt, 1971, JASA 49); with ``down = 2`` it converges on 70.7 % successes."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.settings = spec = read_design_settings(settings, StaircaseSettings)
        require_setting(len(spec.values) > 1, f"values has {len(spec.values)}; give two or more, the easiest first")
        require_setting(
            0 <= spec.start < len(spec.values), f"start is {spec.start}; use a place in values, the first is 0"
        )
        are_sizes_positive = bool(spec.step_sizes) and min(spec.step_sizes) > 0
        require_setting(
            are_sizes_positive and spec.down > 0 and spec.averaged_reversals > 0,
            "down, step_sizes and averaged_reversals are 1 or more",
        )

    def decide(self, history: Sequence[PlayedEpisode], draw: Draw) -> DesignDecision:
        """Choose the value that follows from all counted episodes, and estimate the threshold from the reversals."""
        settings = self.settings
        last_index = len(settings.values) - 1
        index = settings.start  # of the present value
        n_successes = 0  # in a row, at the present value
        direction = 0  # of the last move: 1 to harder values, -1 to easier ones, 0 before the first
        reversals: list[int] = []  # the index of the value at each reversal
        for episode in history:
            if any(episode.options.get(name) != option for name, option in settings.only.items()):
                continue
            if episode.success:
                n_successes += 1
                move = 1 if n_successes == settings.down else 0
            else:
                move = -1
            if not move:
                continue
            n_successes = 0
            if direction not in (0, move):
                reversals.append(index)
            direction = move
            step_size = settings.step_sizes[min(len(reversals), len(settings.step_sizes) - 1)]
            index = min(max(index + move * step_size, 0), last_index)
        estimates = {"reversals": float(len(reversals))}
        averaged_values = [settings.values[reversal] for reversal in reversals[-settings.averaged_reversals :]]
        if len(averaged_values) > 1 and not any(isinstance(value, str) for value in averaged_values):
            estimates["threshold"] = round_estimate(sum(map(float, averaged_values)) / len(averaged_values))
        stop = bool(settings.stop_reversals) and len(reversals) >= settings.stop_reversals
        posterior = (index, n_successes, direction, reversals)
        # None: the plan's reset seed
        return DesignDecision({settings.option: settings.values[index]}, None, stop, estimates, posterior)


class QuestPlusSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of QUEST+."""

    option: str  # of the world
    values: tuple[int | float, ...]  # above 0, in any order
    harder: Literal["smaller", "larger"] = "smaller"  # which values are harder
    guess: float = 0.5  # proportion of successes at values that are far too hard
    lapse: float = 0.02  # proportion of failures at values that are far too easy
    slopes: tuple[float, ...] = (1.5, 2.5, 3.5, 5.0)  # possible slopes of the Weibull function
    thresholds: tuple[float, float] | None = None  # lowest and highest possible threshold; None for those of values
    grid: int = 80  # number of possible thresholds, spaced evenly on a logarithmic scale
    stop_sd: float = 0.0  # SD of the threshold's logarithm below which the block is over; 0 for never


_LOG_UNIT = 2.0**20  # units per nat in which log-likelihoods are whole numbers, so that sums are exact
_MIN_CHANCE = 1e-6  # of success and of failure, so that no episode excludes a threshold
_MAX_EXPONENT = 50.0  # beyond which the Weibull function is 1 and its inner exponential would overflow


class QuestPlus(Design):
    """QUEST+ (Watson, 2017, J. Vision 17(3):10) for the threshold of a Weibull function of the value's logarithm.

    Each episode gets the value that minimises the expected entropy of the threshold, with the slope marginalised
    (Prins, 2013, J. Vision 13(7):3). The threshold is the value at 1 - 1/e of the way from guess rate to ceiling.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.settings = spec = read_design_settings(settings, QuestPlusSettings)
        low, high = spec.thresholds or (min(spec.values, default=0), max(spec.values, default=0))
        require_setting(len(spec.values) > 1 and min(spec.values) > 0, "values needs two or more, all above 0")
        require_setting(0 < low < high, f"thresholds is {[low, high]}; give the lowest, above 0, then the highest")
        require_setting(2 <= spec.grid <= 1_000, f"grid is {spec.grid}; use 2 to 1000")
        require_setting(bool(spec.slopes) and min(spec.slopes) > 0, "slopes needs one or more, all above 0")
        require_setting(0 <= spec.guess < 1 - spec.lapse <= 1, "guess and lapse are shares whose sum is below 1")
        grid_step = np.log(high / low) / (spec.grid - 1)
        self._log_thresholds = np.log(low) + np.arange(spec.grid) * grid_step
        # of success: float64[values, thresholds, slopes]
        self._chance = np.clip(self._compute_success_chance(), _MIN_CHANCE, 1 - _MIN_CHANCE)
        self._log_chance = (_compute_log_units(1 - self._chance), _compute_log_units(self._chance))  # failure, success

    def _compute_success_chance(self) -> NDArray[np.float64]:
        """Return the probability of success by Weibull functions, float64[values, thresholds, slopes]."""
        spec = self.settings
        log_ratio = np.log(np.array(spec.values))[:, None, None] - self._log_thresholds[:, None]
        direction = 1 if spec.harder == "smaller" else -1
        exponent = log_ratio * np.array(spec.slopes) * direction
        weibull = -np.expm1(-np.exp(np.minimum(exponent, _MAX_EXPONENT)))
        return np.asarray(spec.guess + (1 - spec.guess - spec.lapse) * weibull)

    def decide(self, history: Sequence[PlayedEpisode], draw: Draw) -> DesignDecision:
        """Choose the value that is expected to leave the least entropy of the threshold, and estimate the threshold."""
        settings = self.settings
        index_of_value = {value: index for index, value in enumerate(settings.values)}
        log_likelihood = np.zeros(self._chance.shape[1:], np.int64)  # in units of `_LOG_UNIT`
        for episode in history:
            if (index := index_of_value.get(episode.options.get(settings.option, 0.0))) is not None:
                log_likelihood = log_likelihood + self._log_chance[episode.success][index]
        posterior = np.exp((log_likelihood - log_likelihood.max()) / _LOG_UNIT)
        posterior /= posterior.sum()
        threshold_share = posterior.sum(axis=1)
        log_thresholds = self._log_thresholds
        mean = float(threshold_share @ log_thresholds)
        sd = float(np.sqrt(max(threshold_share @ (log_thresholds - mean) ** 2, 0.0)))
        estimates = {
            "threshold": round_estimate(float(np.exp(mean))),
            "threshold_log_sd": round_estimate(sd),
            "slope": round_estimate(float(posterior.sum(axis=0) @ np.array(settings.slopes))),
        }
        best = int(np.argmin(np.round(self._compute_expected_entropy(posterior), 9)))
        stop = bool(history) and estimates["threshold_log_sd"] < settings.stop_sd
        # None: the plan's reset seed
        return DesignDecision({settings.option: settings.values[best]}, None, stop, estimates, log_likelihood)

    def _compute_expected_entropy(self, posterior: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the threshold's expected entropy in nats after an episode at each value, float64[values].

        ``posterior`` is float64[thresholds, slopes].
        """
        success = (self._chance * posterior).sum(axis=2)
        failure = posterior.sum(axis=1) - success
        return sum(_compute_weighted_entropy(joint) for joint in (success, failure))  # type: ignore[return-value]


def _compute_weighted_entropy(joint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return, by row, the entropy in nats of the row's numbers scaled to the sum 1, multiplied by their sum."""
    joint = np.maximum(joint, 1e-300)  # as 0 has no logarithm
    total = joint.sum(axis=1)
    entropy: NDArray[np.float64] = total * np.log(total) - (joint * np.log(joint)).sum(axis=1)
    return entropy


class LevelReplaySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of prioritized level replay."""

    seeds: tuple[int, ...]  # reset seeds: each with each row of options is a level
    options: tuple[dict[str, Any], ...] = ({},)  # rows of options of the world
    replay: float = 0.5  # probability of replaying a level while there are new ones
    staleness: float = 0.1  # weight of the time since a level was played, in the choice of the level to replay
    temperature: float = 0.1  # of the ranks of regret; near 0, only the level with the highest regret is replayed
    best_return: float = 1.0  # the highest return of an episode


class LevelReplay(Design):
    """A curriculum by regret: prioritized level replay (Jiang et al., 2021, ICML) over a list of levels.

    A level's regret is the setting ``best_return`` minus the level's latest return, at least 0. Levels are replayed by
    the rank of their regret.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.settings = spec = read_design_settings(settings, LevelReplaySettings)
        self._levels = [(dict(row), seed) for row in spec.options for seed in spec.seeds]
        are_shares = 0 <= spec.replay <= 1 and 0 <= spec.staleness <= 1
        require_setting(len(self._levels) > 1, f"seeds and options make {len(self._levels)} levels; give two or more")
        require_setting(all(0 <= seed < 2**63 for seed in spec.seeds), "a seed is 0 or more and below 2**63")
        require_setting(are_shares, "replay and staleness are shares from 0 to 1")
        require_setting(spec.temperature >= 0.01, f"temperature is {spec.temperature:g}; use 0.01 or more")

    def decide(self, history: Sequence[PlayedEpisode], draw: Draw) -> DesignDecision:
        """Choose a level at random among those that were not played yet, or a played one to replay."""
        regrets: dict[int, tuple[float, int]] = {}  # of each played level: the regret and index of its latest episode
        for number, episode in enumerate(history):
            played_level = self._find_level(episode)
            if played_level is not None:
                regret = max(0.0, self.settings.best_return - episode.return_)
                regrets[played_level] = (round_estimate(regret), number)
        new_levels = [level for level in range(len(self._levels)) if level not in regrets]
        replay_share, level_share = draw(2)
        may_be_new = not regrets or replay_share >= self.settings.replay
        if new_levels and may_be_new:
            level = new_levels[int(level_share * len(new_levels))]
        else:
            level = self._choose_played_level(regrets, len(history), level_share)
        estimates = {"levels": float(len(regrets))}
        if regrets:
            mean_regret = sum(regret for regret, _ in regrets.values()) / len(regrets)
            estimates["regret"] = round_estimate(mean_regret)
        options, seed = self._levels[level]
        # False: it never ends the block
        return DesignDecision(options, seed, False, estimates, sorted(regrets.items()))

    def _choose_played_level(
        self, regrets: Mapping[int, tuple[float, int]], n_episodes: int, level_share: float
    ) -> int:
        """Return the index of a played level, chosen by the rank of its regret and the episodes since it was played.

        Args:
            regrets: the regret and the index of the latest episode, by level.
            n_episodes: the number of episodes so far.
            level_share: a random number in [0, 1), which selects the level.
        """

        def rank_by_regret(level: int) -> tuple[float, int]:
            regret, _ = regrets[level]
            return (-regret, level)

        staleness = self.settings.staleness
        levels = sorted(regrets, key=rank_by_regret)
        ranks = np.arange(1.0, len(levels) + 1)
        regret_weights = ranks ** (-1 / self.settings.temperature)
        latest_episodes = [regrets[level][1] for level in levels]
        age = n_episodes - np.array(latest_episodes, float)
        share = (1 - staleness) * regret_weights / regret_weights.sum() + staleness * age / age.sum()
        cumulative_share = np.round(np.cumsum(share), 9)
        index = int(np.searchsorted(cumulative_share, level_share, side="right"))
        return levels[min(index, len(levels) - 1)]

    def _find_level(self, episode: PlayedEpisode) -> int | None:
        """Return the index of the level that an episode played; None if it is none of the levels."""
        for level, (options, seed) in enumerate(self._levels):
            if seed == episode.seed and options.items() <= episode.options.items():
                return level
        return None


def _compute_log_units(chance: NDArray[np.float64]) -> NDArray[np.int64]:
    """Compute the logarithms of probabilities in whole units of `_LOG_UNIT`, whose sums are exact on every machine."""
    return np.rint(np.log(chance) * _LOG_UNIT).astype(np.int64)
