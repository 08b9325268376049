"""One session's rows for every table, column by column."""

import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from minihuman.data.exclusions import UNFINISHED_OUTCOMES, Rules
from minihuman.data.marks import tags_of
from minihuman.data.rows import Part, Rows
from minihuman.measures.adaptation import slope_per_episode
from minihuman.measures.keys import Tally, key_uses, times_to_find, visible_effect
from minihuman.measures.path import Walk, walks
from minihuman.measures.shortest import Shortest
from minihuman.measures.timing import playing_s, reaction_ms
from minihuman.recorded.categorical import Words
from minihuman.recorded.columns import NO_ACTION
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.study.plan import EpisodePlan

Planner = Callable[[EpisodePlan], Shortest]
_Columns = dict[str, Any]


def session_tables(
    log: SessionLog, *, tags: Mapping[int | None, frozenset[str]], rules: Rules, shortest: Planner
) -> Rows:
    """Every table's rows of one session; ``shortest`` says how few steps an episode could have taken.

    Rows that the rules leave out stay in the tables, with the reason in ``left_out``; block and participant rows are
    over the episodes that count.
    """
    who = {
        "study": log.plan.study,
        "participant": log.plan.participant.id,
        "group": log.plan.participant.group,
        "session": log.plan.session,
    }
    tallies = [Tally.of(episode) for episode in log.episodes]
    episodes = [
        who
        | _place(tally.episode)
        | _episode(tally, walk)
        | _least(tally.episode, shortest(tally.episode.plan))
        | {"tags": " ".join(sorted(tags_of(tally.episode, tags)))}
        for tally, walk in zip(tallies, walks(log.episodes), strict=True)
    ]
    for row in episodes:
        row["left_out"] = rules.episode(row)
    counted = [tally for tally, row in zip(tallies, episodes, strict=True) if not row["left_out"]]
    kept = [row for row in episodes if not row["left_out"]]
    names = list(dict.fromkeys(episode.plan.block_name for episode in log.episodes))
    blocks = [
        who
        | {"block": name}
        | _over(
            [row for row in kept if row["block"] == name],
            [tally for tally in counted if tally.episode.plan.block_name == name],
        )
        for name in names
    ]
    session: _Columns = {
        "player": log.player,
        "started_at": log.started_at,
        "end_reason": log.end_reason,
        "clean": log.clean,
    }
    completed = {row["episode"] for row in episodes if row["outcome"] not in UNFINISHED_OUTCOMES}
    session["completed_share"] = len(completed) / len(log.plan.episodes)
    participant = who | session | _over(kept, counted)
    participant["left_out"] = rules.participant(participant)
    for row in blocks:
        row["left_out"] = participant["left_out"] or ("" if row["episodes"] else "no episode counts")
    steps, presses = (Part.below([of(episode) for episode in log.episodes], **who) for of in (_steps, _presses))
    return Rows(
        {
            "steps": steps,
            "presses": presses,
            "keys": Part.of([who | row for row in _keys(tallies)]),
            "episodes": Part.of(episodes),
            "blocks": Part.of(blocks),
            "participants": Part.of([participant]),
        }
    )


def _place(episode: Episode) -> _Columns:
    return {"block": episode.plan.block_name, "episode": episode.number, "attempt": episode.attempt}


def _steps(episode: Episode) -> Part:
    n = len(episode.actions)
    columns = {
        "step": np.arange(1, n + 1),
        "t_s": episode.t_ns[1:] / 1e9,
        "action": Words(episode.actions, episode.start.action_names),
        "key": Words.of(episode.step_keys),
        "reward": episode.rewards,
        "reaction_ms": episode.rt_ms,
        "visible_effect": visible_effect(episode),
        "x": episode.poses[1:, 0],
        "z": episode.poses[1:, 2],
        "yaw_rad": episode.poses[1:, 3],
        "terminated": episode.terminated,
        "truncated": episode.truncated,
    }
    return Part(n, _place(episode) | columns)


def _presses(episode: Episode) -> Part:
    keys = episode.keys
    columns = {
        "t_s": keys.column("t_ns") / 1e9,
        "key": keys.column("key"),
        "down": keys.column("down"),
        "action": Words(keys.column("action") - NO_ACTION, ("", *episode.start.action_names)),
        "verdict": keys.column("verdict"),
    }
    return Part(len(keys), _place(episode) | columns)


def _keys(tallies: Sequence[Tally]) -> list[_Columns]:
    plans = [tally.episode.plan for tally in tallies]
    blocks = {plan.episode + 1: plan.block_name for plan in plans}
    return [
        {
            "block": blocks[use.first_episode],
            "first_episode": use.first_episode,
            "key": use.key,
            "action": use.action or "",
            "presses": use.presses,
            "steps": use.steps,
            "in_vain": use.in_vain,
            "refused": use.refused,
            "found_s": use.found_s,
            "found_steps": use.found_steps,
        }
        for use in key_uses(tallies)
    ]


def _episode(tally: Tally, walk: Walk) -> _Columns:
    episode = tally.episode
    plan = episode.plan
    mean_ms, median_ms = reaction_ms(episode)
    return {
        "episode_in_block": plan.episode_in_block + 1,
        "world": plan.world,
        "seed": plan.seed,
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
        "turns_in_place": walk.turns,
        "in_vain": tally.in_vain.total(),
        "refused": tally.refused.total(),
    }


def _least(episode: Episode, least: Shortest) -> _Columns:
    """The fewest possible steps, and how many more an episode took that reached the goal."""
    excess_steps = None
    if episode.outcome == "goal" and least.at_least is not None:
        excess_steps = float(len(episode.actions) - least.at_least)
    return {"shortest_steps": least.at_least, "feasible_steps": least.feasible, "excess_steps": excess_steps}


def _over(rows: Sequence[_Columns], tallies: Sequence[Tally]) -> _Columns:
    """What a block's or a session's episodes that count amount to; None where nothing tells."""
    rewards = [row["reward"] for row in rows]
    steps = [row["steps"] for row in rows]
    times = np.concatenate([np.zeros(0), *(tally.episode.rt_ms for tally in tallies)])
    times = times[~np.isnan(times)]
    to_find = times_to_find(tallies)
    found = [found_s for found_s in to_find if found_s is not None]
    return {
        "episodes": len(rows),
        "success": _mean([row["success"] for row in rows]),
        "reward_mean": _mean(rewards),
        "reward_sd": float(np.std(rewards, ddof=1)) if len(rewards) > 1 else None,
        "reward_first": rewards[0] if rewards else None,
        "reward_slope": _told(slope_per_episode(rewards)),
        "steps_mean": _mean(steps),
        "excess_steps_mean": _mean([row["excess_steps"] for row in rows]),
        "playing_s_mean": _mean([row["playing_s"] for row in rows]),
        "reaction_median_ms": float(np.median(times)) if times.size else None,
        "path_efficiency_mean": _mean([row["path_efficiency"] for row in rows]),
        "in_vain_share": sum(row["in_vain"] for row in rows) / sum(steps) if sum(steps) else None,
        "refused": sum(row["refused"] for row in rows),
        "keys_found": len(found),
        "keys_to_find": len(to_find),
        "found_all_s": max(found) if found and len(found) == len(to_find) else None,
    }


def _mean(values: Iterable[float | None]) -> float | None:
    told = [value for value in values if value is not None]
    return statistics.fmean(told) if told else None


def _told(value: float) -> float | None:
    return None if math.isnan(value) else value
