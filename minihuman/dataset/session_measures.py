"""Compute one session's measures per episode, before any selection, and aggregate them over episodes."""

import json
import math
import statistics
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.dataset.measures import (
    KeyTally,
    PathMeasures,
    excess_steps,
    key_discovery_times,
    layout_path_bounds,
    log_excess_steps,
    log_steps_ratio,
    mean_and_median,
    measure_paths,
    playing_s,
    response_ms,
    slope_per_episode,
    spl,
    world_options_json,
)
from minihuman.errors import WorldError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.worlds.contract import UNKNOWN_BOUNDS, PathLengthBounds
from minihuman.worlds.pose import Map

PathPlanner = Callable[[EpisodePlan], PathLengthBounds]
MeasureRow = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class SessionMeasures:
    """A session's measures: one row per episode in the order played, and the episodes' key counts."""

    rows: tuple[MeasureRow, ...]  # columns of the table "episodes"
    tallies: tuple[KeyTally, ...]

    @classmethod
    def of(cls, log: SessionLog, planner: PathPlanner) -> "SessionMeasures":
        """Measure every episode.

        ``planner`` returns the bounds on the fewest steps in which an episode can be solved.
        """
        tallies = tuple(KeyTally.of(episode) for episode in log.episodes)
        rows: list[MeasureRow] = []
        for tally, walk in zip(tallies, measure_paths(log.episodes), strict=True):
            row = _measure_episode(tally, walk)
            rows.append(row | compare_with_shortest_path(row, planner(tally.episode.plan)))
        return cls(tuple(rows), tallies)

    def aggregate(self, indices: Sequence[int]) -> MeasureRow:
        """Aggregate the measures of the episodes at the given indices; None where a measure is unknown.

        The discovery time of a key does not depend on which episodes are included: it is computed from all episodes
        that were begun in the same blocks.
        """
        return _aggregate_episodes(
            [self.rows[index] for index in indices],
            [self.tallies[index] for index in indices],
            self.select_tallies({self.rows[index]["block"] for index in indices}),
        )

    def select_tallies(self, blocks: Collection[str]) -> list[KeyTally]:
        """Return the tallies of all episodes that were begun in the given blocks."""
        return [tally for row, tally in zip(self.rows, self.tallies, strict=True) if row["block"] in blocks]


def find_path_bounds(plan: EpisodePlan) -> PathLengthBounds:
    """Return bounds on the fewest steps of an episode; unknown bounds if the world cannot be created here."""
    return find_layout_bounds(plan.world, world_options_json(plan), plan.seed)


def find_layout_bounds(world_id: str, options: str, seed: int) -> PathLengthBounds:
    """Return bounds on the fewest steps in the world made from a seed; ``options`` is JSON.

    The bounds are unknown if the world cannot be created here.
    """
    try:
        return layout_path_bounds(world_id, options, seed)
    except WorldError:
        return UNKNOWN_BOUNDS


def skip_path_bounds(plan: EpisodePlan) -> PathLengthBounds:
    """Return unknown bounds without creating a world."""
    return UNKNOWN_BOUNDS


def locate_episode(episode: EpisodeLog) -> MeasureRow:
    """Return the columns by which every table identifies an episode within its session."""
    return {
        "block": episode.plan.block_name,
        "segment": episode.segment,
        "episode": episode.number,
        "attempt": episode.attempt,
    }


def _measure_episode(tally: KeyTally, walk: PathMeasures) -> MeasureRow:
    """Return an episode's row of measures, from its key tally and its path."""
    episode = tally.episode
    plan = episode.plan
    mean_ms, median_ms = mean_and_median(episode.rt_ms)
    response_mean_ms, response_median_ms = mean_and_median(response_ms(episode))
    labels = ""
    if plan.labels:
        labels = json.dumps(plan.labels, sort_keys=True, ensure_ascii=False)
    turns_in_place = None  # unknown without poses
    if not math.isnan(walk.length):
        turns_in_place = walk.turns
    return locate_episode(episode) | {
        "episode_in_block": plan.episode_in_block + 1,
        "world": plan.world,
        "seed": plan.seed,
        "t_ns": int(episode.t_ns[0]),
        "outcome": episode.outcome_word,
        "success": episode.success,
        "reward": episode.return_,
        "steps": len(episode.actions),
        "max_steps": plan.max_steps,
        "playing_s": playing_s(episode),
        "reaction_mean_ms": mean_ms,
        "reaction_median_ms": median_ms,
        "response_mean_ms": response_mean_ms,
        "response_median_ms": response_median_ms,
        "path_length": _none_if_nan(walk.length),
        "unit": find_place_unit(episode),
        "path_efficiency": _none_if_nan(walk.efficiency),
        "turns_in_place": turns_in_place,
        "ineffective_steps": tally.ineffective_steps.total(),
        "refused": tally.refused.total(),
        "absent_share": None if episode.team is None else episode.team.absent_share,
        "labels": labels,
        "info_at_end": _encode_last_info(episode),
    }


def _encode_last_info(episode: EpisodeLog) -> str:
    """Return what the log keeps of the world's info after the last step, as JSON; "" if it keeps nothing."""
    if not episode.infos:
        return ""
    return json.dumps(episode.infos[-1], sort_keys=True)


def find_place_unit(episode: EpisodeLog) -> str:
    """Return the unit of an episode's positions, cell or m; "" if its world has no map."""
    floor = episode.start.map
    if not floor:
        return ""
    return floor.unit


def encode_map(floor: Map | None) -> str:
    """Encode a map as JSON, "" for None; a map of a single floor omits the fields about floors."""
    if floor is None:
        return ""
    fields = msgspec.to_builtins(floor)
    if not floor.levels:
        del fields["levels"], fields["wall_floors"]
        for thing in fields["things"]:
            del thing["floor"]
    return msgspec.json.encode(fields).decode()


def compare_with_shortest_path(row: Mapping[str, Any], bounds: PathLengthBounds) -> MeasureRow:
    """Return the measures that compare an episode's steps with the fewest possible and with the best known path.

    Args:
        row: the episode's row, with at least its ``steps``, ``max_steps`` and ``outcome``.
        bounds: the bounds on the fewest steps to the goal.
    """
    steps = row["steps"]
    limit = row["max_steps"]
    outcome = row["outcome"]
    return {
        "shortest_steps": bounds.at_least,
        "feasible_steps": bounds.feasible,
        "excess_steps": excess_steps(steps, bounds.feasible, success=outcome == "goal"),
        "log_excess_steps": log_excess_steps(steps, bounds.feasible, limit, outcome),
        "log_steps_ratio": log_steps_ratio(steps, bounds.feasible, limit, outcome),
        "spl": spl(steps, bounds.feasible, outcome),
    }


def _aggregate_episodes(
    rows: Sequence[MeasureRow], tallies: Sequence[KeyTally], begun_tallies: Sequence[KeyTally]
) -> MeasureRow:
    """Aggregate the included episodes of a block or a session; None where a measure is unknown.

    Args:
        rows: the measures of the included episodes.
        tallies: their key counts.
        begun_tallies: the key counts of all episodes begun in the same blocks, for the discovery of keys.
    """
    rewards = [row["reward"] for row in rows]
    steps = [row["steps"] for row in rows]
    n_steps = sum(steps)
    reward_sd = None
    if len(rewards) > 1:
        reward_sd = float(np.std(rewards, ddof=1))
    ineffective_share = None
    if n_steps:
        ineffective_share = sum(row["ineffective_steps"] for row in rows) / n_steps
    return {
        "episodes": len(rows),
        "success": _mean([row["success"] for row in rows]),
        "reward_mean": _mean(rewards),
        "reward_sd": reward_sd,
        "reward_first": rewards[0] if rewards else None,
        "reward_slope": _fit_reward_slope(rows),
        "steps_mean": _mean(steps),
        "steps_at_limit_mean": _mean(map(_steps_at_limit, rows)),
        **average_path_measures(rows),
        "playing_s_mean": _mean([row["playing_s"] for row in rows]),
        "reaction_median_ms": _find_median_ms(tally.episode.rt_ms for tally in tallies),
        "response_median_ms": _find_median_ms(response_ms(tally.episode) for tally in tallies),
        "path_efficiency_mean": _mean([row["path_efficiency"] for row in rows]),
        "ineffective_share": ineffective_share,
        "refused": sum(row["refused"] for row in rows),
        **_aggregate_key_discoveries(begun_tallies),
    }


def _find_median_ms(times_ms: Iterable[NDArray[np.float64]]) -> float | None:
    """Return the median of the times of several episodes, in milliseconds; None if there are none."""
    _, median_ms = mean_and_median(np.concatenate([np.zeros(0), *times_ms]))
    return median_ms


def _aggregate_key_discoveries(begun_tallies: Sequence[KeyTally]) -> MeasureRow:
    """Return the columns for the discovery of keys; the time to discover all is None if one was never discovered."""
    times_s = key_discovery_times(begun_tallies)
    discovered_s = [time_s for time_s in times_s if time_s is not None]
    all_keys_discovered_s: float | None = None
    if discovered_s and len(discovered_s) == len(times_s):
        all_keys_discovered_s = max(discovered_s)
    return {
        "keys_discovered": len(discovered_s),
        "keys_total": len(times_s),
        "all_keys_discovered_s": all_keys_discovered_s,
    }


def _steps_at_limit(row: MeasureRow) -> float | None:
    """Return an episode's steps if it succeeded, else its step limit; None if success is unknown."""
    if row["success"] is None:
        return None
    column = "steps" if row["success"] else "max_steps"
    steps: float = row[column]
    return steps


def average_path_measures(rows: Sequence[Mapping[str, Any]]) -> MeasureRow:
    """Return the means of the shortest-path measures over episodes; None for a measure that no episode has."""
    names = ("excess_steps", "log_excess_steps", "log_steps_ratio", "spl")
    return {f"{name}_mean": _mean(row[name] for row in rows) for name in names}


def _fit_reward_slope(rows: Sequence[MeasureRow]) -> float | None:
    """Return the reward's change per episode over the first episodes of one block, with excluded episodes as gaps.

    Return None if the rows are not all of one block, or if fewer than two of its first episodes have a row.
    """
    if len({row["block"] for row in rows}) != 1:
        return None
    rewards = [math.nan] * max(row["episode_in_block"] for row in rows)
    for row in rows:
        rewards[row["episode_in_block"] - 1] = row["reward"]
    return _none_if_nan(slope_per_episode(rewards))


def _mean(values: Iterable[float | None]) -> float | None:
    """Return the mean of the values that are not None; None if there are none."""
    present_values = [value for value in values if value is not None]
    if not present_values:
        return None
    return statistics.fmean(present_values)


def _none_if_nan(value: float) -> float | None:
    if math.isnan(value):
        return None
    return value
