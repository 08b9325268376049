"""One session's episodes in numbers, before anybody says which of them count; and what several amount to."""

import math
import statistics
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.measures.adaptation import slope_per_episode
from minihuman.measures.effort import excess_steps, log_excess_steps, log_steps_ratio, spl
from minihuman.measures.keys import Tally, times_to_find
from minihuman.measures.path import Walk, walks
from minihuman.measures.shortest import shortest
from minihuman.measures.timing import playing_s, reaction_ms
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.contract import UNKNOWN, Bounds

Planner = Callable[[EpisodePlan], Bounds]
Row = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A session's episodes in the order played: one row of numbers for each, and its keys counted."""

    rows: tuple[Row, ...]  # columns of the table "episodes"
    tallies: tuple[Tally, ...]

    @classmethod
    def of(cls, log: SessionLog, planner: Planner) -> "Measured":
        """Measure every episode; ``planner`` says how few steps one could have taken."""
        tallies = tuple(Tally.of(episode) for episode in log.episodes)
        rows = (
            _episode(tally, walk) | _least(tally.episode, planner(tally.episode.plan))
            for tally, walk in zip(tallies, walks(log.episodes), strict=True)
        )
        return cls(tuple(rows), tallies)

    def over(self, places: Sequence[int]) -> Row:
        """What some of the episodes amount to; None where nothing tells.

        When a key was found does not hang on which episodes count: all that were begun in their blocks tell it.
        """
        return _over(
            [self.rows[place] for place in places],
            [self.tallies[place] for place in places],
            self.of_blocks({self.rows[place]["block"] for place in places}),
        )

    def of_blocks(self, blocks: Collection[str]) -> list[Tally]:
        """The tallies of all episodes that were begun in some blocks."""
        return [tally for row, tally in zip(self.rows, self.tallies, strict=True) if row["block"] in blocks]


def known_shortest(plan: EpisodePlan) -> Bounds:
    """The fewest steps of an episode; unknown where the world cannot be made here."""
    try:
        return shortest(plan)
    except WorldError:
        return UNKNOWN


def no_shortest(plan: EpisodePlan) -> Bounds:
    """Ask no world."""
    return UNKNOWN


def place(episode: Episode) -> Row:
    """Which episode of the session it is, as every table names it."""
    return {
        "block": episode.plan.block_name,
        "segment": episode.segment,
        "episode": episode.number,
        "attempt": episode.attempt,
    }


def _episode(tally: Tally, walk: Walk) -> Row:
    episode = tally.episode
    plan = episode.plan
    mean_ms, median_ms = reaction_ms(episode)
    return place(episode) | {
        "episode_in_block": plan.episode_in_block + 1,
        "world": plan.world,
        "seed": plan.seed,
        "t_ns": int(episode.t_ns[0]),
        "outcome": episode.outcome_word,
        "success": episode.outcome == "goal",
        "reward": episode.return_,
        "steps": len(episode.actions),
        "max_steps": plan.max_steps,
        "playing_s": playing_s(episode),
        "reaction_mean_ms": _told(mean_ms),
        "reaction_median_ms": _told(median_ms),
        "path_length": _told(walk.length),
        "path_efficiency": _told(walk.efficiency),
        "turns_in_place": None if math.isnan(walk.length) else walk.turns,  # nobody knows where no pose is told
        "in_vain": tally.in_vain.total(),
        "refused": tally.refused.total(),
    }


def _least(episode: Episode, least: Bounds) -> Row:
    """The fewest possible steps, and how the episode's stand to those of the best way that is known."""
    steps, limit, outcome = len(episode.actions), episode.plan.max_steps, episode.outcome_word
    return {
        "shortest_steps": least.at_least,
        "feasible_steps": least.feasible,
        "excess_steps": excess_steps(steps, least.feasible, success=outcome == "goal"),
        "log_excess_steps": log_excess_steps(steps, least.feasible, limit, outcome),
        "log_steps_ratio": log_steps_ratio(steps, least.feasible, limit, outcome),
        "spl": spl(steps, least.feasible, outcome),
    }


def _over(rows: Sequence[Row], tallies: Sequence[Tally], begun: Sequence[Tally]) -> Row:
    """What a block's or a session's episodes that count amount to; None where nothing tells."""
    rewards = [row["reward"] for row in rows]
    steps = [row["steps"] for row in rows]
    times = np.concatenate([np.zeros(0), *(tally.episode.rt_ms for tally in tallies)])
    times = times[~np.isnan(times)]
    to_find = times_to_find(begun)
    found = [found_s for found_s in to_find if found_s is not None]
    return {
        "episodes": len(rows),
        "success": _mean([row["success"] for row in rows]),
        "reward_mean": _mean(rewards),
        "reward_sd": float(np.std(rewards, ddof=1)) if len(rewards) > 1 else None,
        "reward_first": rewards[0] if rewards else None,
        "reward_slope": _slope(rows),
        "steps_mean": _mean(steps),
        "steps_at_limit_mean": _mean([row["steps"] if row["success"] else row["max_steps"] for row in rows]),
        "excess_steps_mean": _mean([row["excess_steps"] for row in rows]),
        "log_excess_steps_mean": _mean([row["log_excess_steps"] for row in rows]),
        "log_steps_ratio_mean": _mean([row["log_steps_ratio"] for row in rows]),
        "spl_mean": _mean([row["spl"] for row in rows]),
        "playing_s_mean": _mean([row["playing_s"] for row in rows]),
        "reaction_median_ms": float(np.median(times)) if times.size else None,
        "path_efficiency_mean": _mean([row["path_efficiency"] for row in rows]),
        "in_vain_share": sum(row["in_vain"] for row in rows) / sum(steps) if sum(steps) else None,
        "refused": sum(row["refused"] for row in rows),
        "keys_found": len(found),
        "keys_to_find": len(to_find),
        "found_all_s": max(found) if found and len(found) == len(to_find) else None,
    }


def _slope(rows: Sequence[Row]) -> float | None:
    """The reward's change an episode over a block's first, with a gap where one does not count; None of many blocks."""
    if len({row["block"] for row in rows}) != 1:
        return None
    rewards = [math.nan] * max(row["episode_in_block"] for row in rows)
    for row in rows:
        rewards[row["episode_in_block"] - 1] = row["reward"]
    return _told(slope_per_episode(rewards))


def _mean(values: Iterable[float | None]) -> float | None:
    told = [value for value in values if value is not None]
    return statistics.fmean(told) if told else None


def _told(value: float) -> float | None:
    return None if math.isnan(value) else value
