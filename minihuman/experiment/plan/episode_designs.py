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
    """Settings of a staircase."""

    option: str  # of the world
    values: tuple[bool | int | float | str, ...]  # from the easiest to the hardest
    down: int = 2  # successes in a row that lead to a harder value
    step_sizes: tuple[int, ...] = (1,)  # places to move, by the number of reversals; the last one stays
    start: int = 0  # place of the first value
    stop_reversals: int = 0  # the block is over after so many; 0: never
    averaged_reversals: int = 6  # the threshold is the mean of the values at the last so many


class Staircase(Design):
    """1-up-N-down staircase (Levitt, 1971, JASA 49): with ``down = 2`` it converges on 70.7 % successes."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        its = self.settings = read_design_settings(settings, StaircaseSettings)
        require_setting(len(its.values) > 1, f"values has {len(its.values)}; give two or more, the easiest first")
        require_setting(
            0 <= its.start < len(its.values), f"start is {its.start}; use a place in values, the first is 0"
        )
        sizes = bool(its.step_sizes) and min(its.step_sizes) > 0
        require_setting(
            sizes and its.down > 0 and its.averaged_reversals > 0, "down, step_sizes and averages are 1 or more"
        )

    def decide(self, history: Sequence[PlayedEpisode], draw: Draw) -> DesignDecision:
        """The value after the run of successes, or the failure."""
        its = self.settings
        place = self.settings.start
        run = 0
        direction = 0
        reversals: list[int] = []
        for episode in history:
            run = run + 1 if episode.success else 0
            move = -1 if not episode.success else int(run == its.down)
            if not move:
                continue
            run = 0
            if direction not in (0, move):
                reversals.append(place)
            direction = move
            move *= its.step_sizes[min(len(reversals), len(its.step_sizes) - 1)]
            place = min(max(place + move, 0), len(its.values) - 1)
        estimates = {"reversals": float(len(reversals))}
        turned = [its.values[at] for at in reversals[-its.averaged_reversals :]]
        if len(turned) > 1 and not any(isinstance(value, str) for value in turned):
            estimates["threshold"] = round_estimate(sum(map(float, turned)) / len(turned))
        stop = bool(its.stop_reversals) and len(reversals) >= its.stop_reversals
        return DesignDecision(
            {its.option: its.values[place]}, None, stop, estimates, (place, run, direction, reversals)
        )


class QuestPlusSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of QUEST+."""

    option: str  # of the world
    values: tuple[int | float, ...]  # above 0, in any order
    harder: Literal["smaller", "larger"] = "smaller"  # values
    guess: float = 0.5  # share of successes where the value is far too hard
    lapse: float = 0.02  # share of failures where it is far too easy
    slopes: tuple[float, ...] = (1.5, 2.5, 3.5, 5.0)  # of the Weibull function, that are thought possible
    thresholds: tuple[float, float] | None = None  # lowest and highest; absent: those of values
    grid: int = 80  # thresholds between them, spaced evenly on a logarithmic scale
    stop_sd: float = 0.0  # the block is over when the SD of the threshold's logarithm is below; 0: never


_LOG_UNIT = 2.0**20  # log-likelihoods are whole numbers of this part of a nat, so that sums are exact


class QuestPlus(Design):
    """QUEST+ (Watson, 2017, J. Vision 17(3):10) for the threshold of a Weibull function of the value's logarithm.

    The value is the one that is expected to leave the least entropy of the threshold, the slope averaged out (Prins,
    2013, J. Vision 13(7):3). The threshold is the value at 1 - 1/e of the way from guess to ceiling.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        its = self.settings = read_design_settings(settings, QuestPlusSettings)
        low, high = its.thresholds or (min(its.values, default=0), max(its.values, default=0))
        require_setting(len(its.values) > 1 and min(its.values) > 0, "values needs two or more, all above 0")
        require_setting(0 < low < high, f"thresholds is {[low, high]}; give the lowest, above 0, then the highest")
        require_setting(2 <= its.grid <= 1_000, f"grid is {its.grid}; use 2 to 1000")
        require_setting(bool(its.slopes) and min(its.slopes) > 0, "slopes needs one or more, all above 0")
        require_setting(0 <= its.guess < 1 - its.lapse <= 1, "guess and lapse are shares whose sum is below 1")
        self._log_thresholds = np.log(low) + np.arange(its.grid) * (np.log(high / low) / (its.grid - 1))
        distance = np.log(np.array(its.values))[:, None, None] - self._log_thresholds[:, None]
        distance = distance * np.array(its.slopes) * (1 if its.harder == "smaller" else -1)
        chance = its.guess + (1 - its.guess - its.lapse) * -np.expm1(-np.exp(np.minimum(distance, 50.0)))
        self._chance = np.clip(chance, 1e-6, 1 - 1e-6)  # [value, threshold, slope]
        self._log_chance = tuple(
            np.rint(np.log(share) * _LOG_UNIT).astype(np.int64) for share in (1 - self._chance, self._chance)
        )

    def decide(self, history: Sequence[PlayedEpisode], draw: Draw) -> DesignDecision:
        """The value that is expected to tell the most about the threshold."""
        its = self.settings
        places = {value: place for place, value in enumerate(self.settings.values)}
        scores = np.zeros(self._chance.shape[1:], np.int64)
        for episode in history:
            if (place := places.get(episode.options.get(its.option, 0.0))) is not None:
                scores = scores + self._log_chance[episode.success][place]
        weights = np.exp((scores - scores.max()) / _LOG_UNIT)
        weights /= weights.sum()
        share = weights.sum(axis=1)
        log = self._log_thresholds
        mean = float(share @ log)
        sd = float(np.sqrt(max(share @ (log - mean) ** 2, 0.0)))
        known = (
            ("threshold", float(np.exp(mean))),
            ("threshold_log_sd", sd),
            ("slope", float(weights.sum(axis=0) @ np.array(its.slopes))),
        )
        rounded = {name: round_estimate(value) for name, value in known}
        best = int(np.argmin(np.round(self._expected_entropy(weights), 9)))
        stop = bool(history) and rounded["threshold_log_sd"] < its.stop_sd
        return DesignDecision({its.option: its.values[best]}, None, stop, rounded, scores)

    def _expected_entropy(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of the threshold after an episode at each value, nats."""
        success = (self._chance * weights).sum(axis=2)
        failure = weights.sum(axis=1) - success
        return sum(_entropy(joint) for joint in (success, failure))  # type: ignore[return-value]


def _entropy(joint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each row's distribution, times the row's sum."""
    joint = np.maximum(joint, 1e-300)
    total = joint.sum(axis=1)
    found: NDArray[np.float64] = total * np.log(total) - (joint * np.log(joint)).sum(axis=1)
    return found


class LevelReplaySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of prioritized level replay."""

    seeds: tuple[int, ...]  # reset seeds: each with each row of options is a level
    options: tuple[dict[str, Any], ...] = ({},)  # rows of options of the world
    replay: float = 0.5  # how probable a level is played again while there are new ones
    staleness: float = 0.1  # share of the choice that goes by how long ago a level was played
    temperature: float = 0.1  # of the ranks of regret: near 0 the highest alone
    best_return: float = 1.0  # the highest return of an episode


class LevelReplay(Design):
    """Curriculum by regret: prioritized level replay (Jiang et al., 2021, ICML) over a list of levels.

    A level's regret is the best return minus its latest; levels are replayed by the rank of their regret.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        its = self.settings = read_design_settings(settings, LevelReplaySettings)
        self._levels = [(dict(row), seed) for row in its.options for seed in its.seeds]
        require_setting(len(self._levels) > 1, f"seeds and options make {len(self._levels)} levels; give two or more")
        require_setting(all(0 <= seed < 2**63 for seed in its.seeds), "a seed is 0 or more")
        require_setting(0 <= its.replay <= 1 and 0 <= its.staleness <= 1, "replay and staleness are shares from 0 to 1")
        require_setting(its.temperature >= 0.01, f"temperature is {its.temperature:g}; use 0.01 or more")

    def decide(self, history: Sequence[PlayedEpisode], draw: Draw) -> DesignDecision:
        """A new level, or one that is played again."""
        # regret, and when
        its = self.settings
        seen = dict[int, tuple[float, int]]()
        for when, episode in enumerate(history):
            if (level := self._find_level(episode)) is not None:
                seen[level] = (round_estimate(max(0.0, its.best_return - episode.return_)), when)
        new = [level for level in range(len(self._levels)) if level not in seen]
        again, which = draw(2)
        if new and (not seen or again >= its.replay):
            level = new[int(which * len(new))]
        else:
            levels = sorted(seen, key=lambda level: (-seen[level][0], level))
            by_regret = np.arange(1.0, len(levels) + 1) ** (-1 / its.temperature)
            age = np.array([len(history) - seen[level][1] for level in levels], float)
            share = (1 - its.staleness) * by_regret / by_regret.sum() + its.staleness * age / age.sum()
            place = int(np.searchsorted(np.round(np.cumsum(share), 9), which, side="right"))
            level = levels[min(place, len(levels) - 1)]
        estimates = {"levels": float(len(seen))} | (
            {"regret": round_estimate(sum(regret for regret, _ in seen.values()) / len(seen))} if seen else {}
        )
        return DesignDecision(*self._levels[level], False, estimates, sorted(seen.items()))

    def _find_level(self, episode: PlayedEpisode) -> int | None:
        given = episode.options.items()
        levels = enumerate(self._levels)
        return next((at for at, (its, seed) in levels if seed == episode.seed and its.items() <= given), None)
