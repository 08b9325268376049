"""The report's section on teaching: who steered, how often policy and person agreed, what was rated and preferred."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from minihuman.dataset.selection import Selection
from minihuman.dataset.store import CachedSession
from minihuman.figures.figure_data import draw_figure_files, strip_events
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.log.model.teaching_events import NO_ADVICE, TeachingRecord
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.study_measures import TeachingMeasure
from minihuman.reporting.template import ReportFigure, Table, format_number

TaughtEpisode = tuple[EpisodeLog, TeachingRecord]
_MS_PER_MIN = 60_000.0


def read_taught_logs(
    kept: Sequence[CachedSession], controls: pd.DataFrame, selection: Selection
) -> Mapping[str, SessionLog]:
    """The sessions that an agent had a part in, by participant and session, each with its episodes that count.

    None is opened where no agent had a part in any; one of which nothing counts is excluded.
    """
    if controls.empty:
        return {}
    wanted = set(zip(controls["participant"], controls["session"], strict=True))
    judged = (selection.judge(read_log(Path(one.path))) for one in kept if one.outline is not None)
    logs = (counted.session for counted in judged if counted.places)
    found = {(log.plan.participant.id, log.plan.session): log for log in logs}
    return {f"{who} session {number}": log for (who, number), log in sorted(found.items()) if (who, number) in wanted}


def group_taught_by_block(log: SessionLog) -> dict[str, list[TaughtEpisode]]:
    """The episodes with an agent, by block."""
    found: dict[str, list[TaughtEpisode]] = defaultdict(list)
    for episode in log.episodes:
        if episode.taught is not None and len(episode.actions):
            found[episode.plan.block_name].append((episode, episode.taught))
    return found


def steering_minutes(episode: EpisodeLog, taught: TeachingRecord) -> float:
    """Minutes in which the person steered, without pauses."""
    begins, ends = episode.t_ns[:-1], episode.t_ns[1:]
    took = ends - begins
    for pause_ns, resume_ns in episode.pauses:
        took = took - np.clip(np.minimum(ends, resume_ns) - np.maximum(begins, pause_ns), 0, None)
    return float(took[taught.by_person].sum() / 1e6 / _MS_PER_MIN)


def policy_agreement(episodes: Sequence[TaughtEpisode]) -> float:
    """The share of the person's steps at which the policy would have done the same; NaN without any."""
    same = [
        taught.policy_actions[mine] == episode.actions[mine]
        for episode, taught in episodes
        if (mine := taught.by_person & (taught.policy_actions != NO_ADVICE)).any()
    ]
    return float(np.concatenate(same).mean()) if same else float("nan")


def autonomy_gain_per_min(episodes: Sequence[TaughtEpisode]) -> float:
    """By how much the agent's share of an episode's steps grew with each minute that the person had steered before.

    The slope of a least-squares line; NaN where the person's minutes do not tell episodes apart.
    """
    minutes = np.cumsum([0.0, *(steering_minutes(episode, taught) for episode, taught in episodes)])[:-1]
    shares = np.array([float((~taught.by_person).mean()) for _, taught in episodes])
    spread = minutes - minutes.mean()
    total = float((spread**2).sum())
    return float((spread * shares).sum() / total) if total > 0 else float("nan")


def teaching_figures(logs: Mapping[str, SessionLog], out: Path) -> Iterator[ReportFigure]:
    """Draw who was in control and how it was rated, per session and block."""
    for name, log in logs.items():
        for block, episodes in group_taught_by_block(log).items():
            where = out / f"{block}_steering_{name.replace(' ', '_')}"
            stripped = [strip_events(episode) for episode, _ in episodes]
            png, _ = draw_figure_files(where, "teaching_figures.steering_figure", stripped)
            yield ReportFigure(
                block, png, f"Who was in control in block {block}, {name}; a line marks a change of policy."
            )
            if any(taught.ratings for _, taught in episodes):
                where = out / f"{block}_ratings_{name.replace(' ', '_')}"
                png, _ = draw_figure_files(where, "teaching_figures.ratings_figure", stripped)
                said = f"Ratings in block {block}, {name}: presses, and the share of good ones among the last ten"
                yield ReportFigure(block, png, f"{said}; a dotted line marks a change of policy.")


class TeachingSection(NamedTuple):
    """The tables on agents that were taught."""

    table: Table
    corrections: Table | None
    preferences: Table | None


def teaching_section(logs: Mapping[str, SessionLog]) -> TeachingSection | None:
    """The report's tables on teaching; None where no agent played."""
    if not logs:
        return None
    rows = [
        _row(name, block, episodes)
        for name, log in logs.items()
        for block, episodes in group_taught_by_block(log).items()
    ]
    heads = (
        "session", "block", "episodes", "policies", "takeovers per episode", "person", "min", "agreement",
        "gain per minute", "good", "bad",
    )  # fmt: skip
    corrected = [
        (name, str(len(log.corrections)), str(sum(len(each.actions) for each in log.corrections)))
        for name, log in logs.items()
        if log.corrections
    ]
    return TeachingSection(
        Table(heads, rows, words=2),
        Table(("session", "corrections", "steps"), corrected) if corrected else None,
        _preferences(logs) if any(log.comparisons for log in logs.values()) else None,
    )


def measure_teaching(episodes: Sequence[TaughtEpisode]) -> dict[str, float]:
    """The measures of a session's block that a protocol can name as ``teaching:NAME``."""
    steps = np.concatenate([taught.by_person for _, taught in episodes])
    return {
        "takeovers": sum(taught.interventions for _, taught in episodes) / len(episodes),
        "person": float(steps.mean()),
        "minutes": sum(steering_minutes(episode, taught) for episode, taught in episodes),
        "agreement": policy_agreement(episodes),
        "gain": autonomy_gain_per_min(episodes),
    }


def tabulate_teaching(logs: Mapping[str, SessionLog]) -> pd.DataFrame:
    """A row per session and block with an agent: participant, session, block and the measures of teaching."""
    rows = [
        {
            "participant": log.plan.participant.id,
            "session": log.plan.session,
            "block": block,
            **measure_teaching(episodes),
        }
        for log in logs.values()
        for block, episodes in group_taught_by_block(log).items()
    ]
    return pd.DataFrame(rows, columns=["participant", "session", "block", *TeachingMeasure.LABELS])


def _row(name: str, block: str, episodes: Sequence[TaughtEpisode]) -> tuple[str, ...]:
    ratings = [rating.value for _, taught in episodes for rating in taught.ratings]
    measured = measure_teaching(episodes)
    return (
        name,
        block,
        str(len(episodes)),
        str(len({taught.policy for _, taught in episodes if taught.policy})),
        *(format_number(measured[which], 2) for which in ("takeovers", "person", "minutes", "agreement")),
        format_number(measured["gain"], 2, sign="+"),
        str(sum(value > 0 for value in ratings)),
        str(sum(value < 0 for value in ratings)),
    )


def _preferences(logs: Mapping[str, SessionLog]) -> Table:
    rows = []
    for name, log in logs.items():
        said = [compared.preference.answer for compared in log.comparisons]
        if said:
            took = [compared.answer_ms for compared in log.comparisons if not np.isnan(compared.answer_ms)]
            counts = [str(said.count(answer)) for answer in ("left", "right", "equal", "cannot_tell")]
            again = str(sum(compared.preference.replays for compared in log.comparisons))
            rows.append((name, str(len(said)), *counts, format_number(float(np.median(took)) / 1e3, 2), again))
    heads = ("session", "pairs", "left", "right", "equal", "cannot tell", "s", "replays")
    return Table(heads, rows)
