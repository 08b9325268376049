"""A session in words and as JSON: what ``minihuman info`` prints."""

from typing import Any

import msgspec
import numpy as np

from minihuman.recorded.episode import Episode, SessionLog


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
        "",
        f"{'episode':>7}  {'block':16} {'outcome':10} {'steps':>5} {'return':>7} {'time s':>7} {'rt ms':>6}  seed",
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
        "key_presses": sum(key.down for key in session.keys),
        "facts": session.facts,
    }
    return msgspec.json.format(msgspec.json.encode(facts), indent=2).decode()


def _episode_line(episode: Episode) -> str:
    facts = _episode_facts(episode)
    rt_ms = "-" if facts["median_rt_ms"] is None else f"{facts['median_rt_ms']:.0f}"
    return (
        f"{facts['episode']:7}  {facts['block']:16} {facts['outcome']:10} {facts['steps']:5} "
        f"{facts['return']:7.3f} {facts['duration_s']:7.1f} {rt_ms:>6}  {facts['seed']}"
    )


def _episode_facts(episode: Episode) -> dict[str, Any]:
    plan, answered = episode.plan, episode.rt_ms[~np.isnan(episode.rt_ms)]
    return {
        "episode": plan.episode,
        "block": plan.block_name,
        "world": plan.world,
        "seed": plan.seed,
        "segment": episode.segment,
        "outcome": episode.outcome_word,
        "steps": len(episode.actions),
        "return": episode.return_,
        "duration_s": float(episode.t_ns[-1] - episode.t_ns[0]) / 1e9,
        "median_rt_ms": float(np.median(answered)) if len(answered) else None,
    }
