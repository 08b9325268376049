"""The report's section on teaching: who was in control, how often policy and person agreed, and the ratings."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from minihuman.figures.figure_data import draw_figure_files, strip_events
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.log.model.teaching_events import NO_ADVICE, TeachingRecord
from minihuman.reporting.activity_sections import CaptionedTable, ReportSection, SectionSource
from minihuman.reporting.study_measures import TeachingMeasure
from minihuman.reporting.template import ReportFigure, Table, format_number

TaughtEpisode = tuple[EpisodeLog, TeachingRecord]
_NS_PER_MS = 1e6
_MS_PER_MIN = 60_000.0


def group_taught_by_block(log: SessionLog) -> dict[str, list[TaughtEpisode]]:
    """Return the episodes that an agent played, with their records of teaching, by the name of their block.

    Episodes without a step are left out.
    """
    episodes_by_block: dict[str, list[TaughtEpisode]] = defaultdict(list)
    for episode in log.episodes:
        if episode.taught is not None and len(episode.actions):
            episodes_by_block[episode.plan.block_name].append((episode, episode.taught))
    return episodes_by_block


def steering_minutes(episode: EpisodeLog, taught: TeachingRecord) -> float:
    """Return the minutes, without pauses, in which the person controlled an episode that has a record of teaching."""
    begins_ns = episode.t_ns[:-1]
    ends_ns = episode.t_ns[1:]
    durations_ns = ends_ns - begins_ns
    for pause_ns, resume_ns in episode.pauses:
        paused_ns = np.minimum(ends_ns, resume_ns) - np.maximum(begins_ns, pause_ns)
        durations_ns = durations_ns - np.clip(paused_ns, 0, None)
    return float(durations_ns[taught.by_person].sum() / _NS_PER_MS / _MS_PER_MIN)


def policy_agreement(episodes: Sequence[TaughtEpisode]) -> float:
    """Return the share of the person's steps at which the policy would have acted the same.

    Steps without the policy's advice do not count; NaN if no step counts.
    """
    agreements = [np.zeros(0, np.bool_)]
    for episode, taught in episodes:
        is_advised = taught.by_person & (taught.policy_actions != NO_ADVICE)
        agreements.append(taught.policy_actions[is_advised] == episode.actions[is_advised])
    all_agreements = np.concatenate(agreements)
    if len(all_agreements):
        return float(all_agreements.mean())
    return float("nan")


def autonomy_gain_per_min(episodes: Sequence[TaughtEpisode]) -> float:
    """Return how much the agent's share of an episode's steps grew per minute of the person's earlier control.

    This is the slope of a least-squares line over the episodes of one block, in the order of play. NaN if each of them
    follows the same number of minutes.
    """
    minutes = np.cumsum([0.0, *(steering_minutes(episode, taught) for episode, taught in episodes)])[:-1]
    shares = np.array([float((~taught.by_person).mean()) for _, taught in episodes])
    deviations = minutes - minutes.mean()
    sum_of_squares = float((deviations**2).sum())
    if sum_of_squares > 0:
        return float((deviations * shares).sum() / sum_of_squares)
    return float("nan")


def teaching_figures(logs: Mapping[str, SessionLog], out: Path) -> Iterator[ReportFigure]:
    """Draw and yield, for each session and block, a figure of who was in control, and one of the ratings, if any.

    Args:
        logs: the logs by the session's name, which is part of the file names and captions.
        out: the folder in which the figures are written.
    """
    for name, log in logs.items():
        for block, episodes in group_taught_by_block(log).items():
            stem = out / f"{block}_steering_{name.replace(' ', '_')}"
            stripped = [strip_events(episode) for episode, _ in episodes]
            png, _ = draw_figure_files(stem, "teaching_figures.steering_figure", stripped)
            yield ReportFigure(
                block, png, f"Who was in control in block {block}, {name}; a line marks a change of policy."
            )
            if any(taught.ratings for _, taught in episodes):
                stem = out / f"{block}_ratings_{name.replace(' ', '_')}"
                png, _ = draw_figure_files(stem, "teaching_figures.ratings_figure", stripped)
                caption = f"Ratings in block {block}, {name}: presses, and the share of good ones among the last ten"
                yield ReportFigure(block, png, f"{caption}; a dotted line marks a change of policy.")


def build_section(source: SectionSource) -> ReportSection:
    """Build the report's section on teaching; it has no table if no agent played."""
    logs = source.read_logs(source.table("controls"))
    heads = (
        "session", "block", "episodes", "policies", "takeovers per episode", "person", "min", "agreement",
        "gain per minute", "good", "bad",
    )  # fmt: skip
    rows = []
    for name, log in logs.items():
        rows += [_build_row(name, block, episodes) for block, episodes in group_taught_by_block(log).items()]
    return ReportSection(
        "Teaching",
        [CaptionedTable(Table(heads, rows, words=2), _CAPTION)] if logs else [],
        figures=teaching_figures(logs, source.figures),
        measure_tables={"teaching": tabulate_teaching(logs)},
    )


_CAPTION = """\
Teaching, per session and block, over the included episodes. Takeovers: by key press while the agent was in control.
Person: the share of the steps, and the minutes without pauses, in which the person was in control. Agreement: the share
of the person's steps at which the policy would have acted alike. Gain: how much the agent's share of an episode's steps
grew per minute of the person's earlier control (slope of a line). Good, bad: ratings."""


def measure_teaching(episodes: Sequence[TaughtEpisode]) -> dict[str, float]:
    """Return the measures that a protocol can name as ``teaching:NAME``, by NAME, for one block of one session."""
    is_by_person = np.concatenate([taught.by_person for _, taught in episodes])
    return {
        "takeovers": sum(taught.interventions for _, taught in episodes) / len(episodes),
        "person": float(is_by_person.mean()),
        "minutes": sum(steering_minutes(episode, taught) for episode, taught in episodes),
        "agreement": policy_agreement(episodes),
        "gain": autonomy_gain_per_min(episodes),
    }


def tabulate_teaching(logs: Mapping[str, SessionLog]) -> pd.DataFrame:
    """Return a table of the measures of teaching, with one row per session and block that an agent played.

    The columns are participant, session, block and the measures.
    """
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


def _build_row(name: str, block: str, episodes: Sequence[TaughtEpisode]) -> tuple[str, ...]:
    """Return the cells of the report's table on teaching for one block of the session called ``name``."""
    ratings = [rating.value for _, taught in episodes for rating in taught.ratings]
    policies = {taught.policy for _, taught in episodes if taught.policy}
    measured = measure_teaching(episodes)
    return (
        name,
        block,
        str(len(episodes)),
        str(len(policies)),
        format_number(measured["takeovers"], 2),
        format_number(measured["person"], 2),
        format_number(measured["minutes"], 2),
        format_number(measured["agreement"], 2),
        format_number(measured["gain"], 2, sign="+"),
        str(sum(rating > 0 for rating in ratings)),
        str(sum(rating < 0 for rating in ratings)),
    )
