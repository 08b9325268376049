"""A session in words and as JSON: what ``minihuman info`` prints."""

from typing import Any

import msgspec
import numpy as np

from minihuman.measures.timing import playing_s
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.recorded.segment import Segment

_HEADS = (
    f"{'episode':>7} {'attempt':>7} {'segment':>7}  {'block':16} {'outcome':10} {'steps':>5} {'return':>7} "
    f"{'at s':>9} {'played':>7} {'rt ms':>6}  seed"
)


def as_lines(session: SessionLog) -> list[str]:
    """A readable summary: the session in a few lines, then a line an episode."""
    plan = session.plan
    lines = [
        f"{session.path}",
        f"study        {plan.study} (version {plan.study_version}, seed {plan.study_seed})",
        f"participant  {plan.participant.id}, group {plan.participant.group}, session {plan.session}",
        f"player       {session.player}",
        f"started      {session.started_at}",
        f"ended        {session.end_reason}, {'clean' if session.clean else 'not clean'}",
        f"episodes     {len(session.episodes)} played, {len(plan.episodes)} planned",
        f"steps        {sum(len(episode.actions) for episode in session.episodes)}",
        f"keys         {sum(key.down for key in session.keys)} presses",
        *(_segment_line(segment) for segment in session.segments),
        "",
        "at s: session time at the reset, since the first segment began; played: seconds to the last step, no pauses",
        _HEADS,
    ]
    return lines + [_episode_line(episode) for episode in session.episodes]


def as_json(session: SessionLog) -> str:
    """The same facts as one JSON object."""
    plan = session.plan
    facts = {
        "path": str(session.path),
        "study": plan.study,
        "study_version": plan.study_version,
        "participant": plan.participant.id,
        "group": plan.participant.group,
        "session": plan.session,
        "player": session.player,
        "started_at": session.started_at,
        "end_reason": session.end_reason,
        "clean": session.clean,
        "episodes_planned": len(plan.episodes),
        "episodes": [_episode_facts(episode) for episode in session.episodes],
        "segments": [_segment_facts(segment) for segment in session.segments],
        "key_presses": sum(key.down for key in session.keys),
        "facts": session.facts,
    }
    return msgspec.json.format(msgspec.json.encode(facts), indent=2).decode()


def _segment_line(segment: Segment) -> str:
    ended = f"{segment.end_reason}, {'clean' if segment.clean else 'not clean'}"
    return (
        f"segment {segment.number:<4} {segment.started_at}, session time {segment.start_ns / 1e9:.1f} to "
        f"{segment.end_ns / 1e9:.1f} s; {ended}; {len(segment.pauses)} pauses"
    )


def _segment_facts(segment: Segment) -> dict[str, Any]:
    return {
        "segment": segment.number,
        "started_at": segment.started_at,
        "started_unix_ns": segment.started_unix_ns,
        "started_monotonic_ns": segment.started_monotonic_ns,
        "monotonic_clock": segment.monotonic_clock or None,
        "start_s": segment.start_ns / 1e9,
        "end_s": segment.end_ns / 1e9,
        "end_reason": segment.end_reason,
        "clean": segment.clean,
        "pauses_s": [[begin / 1e9, end / 1e9] for begin, end in segment.pauses],
    }


def _episode_line(episode: Episode) -> str:
    facts = _episode_facts(episode)
    rt_ms = "-" if facts["median_rt_ms"] is None else f"{facts['median_rt_ms']:.0f}"
    return (
        f"{facts['episode']:7} {facts['attempt']:7} {facts['segment']:7}  {facts['block']:16} {facts['outcome']:10} "
        f"{facts['steps']:5} {facts['return']:7.3f} {facts['session_time_s']:9.1f} {facts['playing_s']:7.1f} "
        f"{rt_ms:>6}  {facts['seed']}"
    )


def _episode_facts(episode: Episode) -> dict[str, Any]:
    plan, answered = episode.plan, episode.rt_ms[~np.isnan(episode.rt_ms)]
    return {
        "episode": episode.number,
        "attempt": episode.attempt,
        "block": plan.block_name,
        "world": plan.world,
        "seed": plan.seed,
        "segment": episode.segment,
        "outcome": episode.outcome_word,
        "steps": len(episode.actions),
        "return": episode.return_,
        "session_time_s": float(episode.t_ns[0]) / 1e9,
        "playing_s": playing_s(episode),
        "median_rt_ms": float(np.median(answered)) if len(answered) else None,
    }
