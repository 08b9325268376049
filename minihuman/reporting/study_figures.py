"""The report's figures of a study's results, block by block, and of one session's paths in each group."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from minihuman.dataset.cached_sessions import CachedSession
from minihuman.dataset.tables import Tables
from minihuman.figures.figure_data import (
    Difference,
    are_few,
    collect_learning_curves,
    draw_figure_files,
    group_by_block,
    has_participant_lines,
    name_measure,
)
from minihuman.reporting.block_measures import label_measure, phrase_measure
from minihuman.reporting.block_results import BlockResults, lacks_goal
from minihuman.reporting.interactions import ContrastComparison, InteractionResults, name_contrast
from minihuman.reporting.results import Results
from minihuman.reporting.template import ReportFigure, format_pair
from minihuman.reporting.within_results import WithinResults, unite_teams
from minihuman.statistics.paired import PairedComparison

CURVES = (
    ("log_excess_steps", "log of the excess steps over the shortest path", (0.0, math.inf)),
    ("reward", "reward", (0.0, 1.0)),
    ("success", "success (share)", (0.0, 1.0)),
    ("playing_s", "playing time (s)", (0.0, math.inf)),
)
_LONG_PARENTHESIS = 12  # characters
_TITLE_WIDTH = 110  # characters of a line in the title of a wide figure
_AXIS = {
    "log_excess_steps": "log of excess steps",
    "reward": "reward",
    "success": "share of episodes",
    "playing_s": "playing time (s)",
}
_BOUNDED_MEASURES = frozenset(
    {"success", "spl_mean", "reward_mean", "reward_first", "path_efficiency_mean", "ineffective_share"}
)


def _find_limits(measure: str, values: "pd.Series[float]") -> tuple[float, float] | None:
    """Return the theoretical bounds of a measure for its axis; None if it has none or a value lies outside them."""
    if measure in _BOUNDED_MEASURES and values.dropna().between(0, 1).all():
        return (0.0, 1.0)
    return None


def _begin_sentence(label: str) -> str:
    return f"{label[0].upper()}{label[1:]}"


def _shorten(label: str) -> str:
    """Return a measure's label without long parentheses or the text after a colon, for use on an axis."""
    name, _, parenthesis = label.partition(" (")
    if len(parenthesis) < _LONG_PARENTHESIS:  # a unit or a scale
        name = label
    return name.partition(":")[0]


def draw_estimates(
    blocks: pd.DataFrame, results: Results, out: Path, teams: pd.DataFrame | None = None
) -> Iterator[ReportFigure]:
    """Yield a figure per block of every participant's value and the groups' differences on the block's main measure.

    A team has one value. A block without comparisons or values has no figure. ``out`` is the folder of the figures.
    """
    included = unite_teams(blocks[blocks["exclusion_reason"].isna()], teams)
    for block in results.blocks:
        if not block.headline:
            continue
        measure = block.headline[0].measure
        rows = included[included["block"] == block.block]
        if not rows[measure].notna().any():
            continue
        means = rows.groupby(["group", "participant"])[measure].mean()  # over sessions, as the groups are compared
        groups = {group: means.loc[group].to_numpy(float) for group in results.order if group in means.index}
        differences = [
            Difference(comparison.first, comparison.second, comparison.difference, comparison.interval)
            for comparison in block.headline
        ]
        label = label_measure(measure)
        are_ratios = block.headline[0].is_log
        png, _ = draw_figure_files(
            out / f"{block.block}_result",
            "estimation.estimation_figure",
            groups,
            differences,
            measure=_shorten(label),
            title=name_measure(label, block.block, width=_TITLE_WIDTH),
            limits=_find_limits(measure, rows[measure]),
            unit=_name_unit(block),
            are_ratios=are_ratios,
        )
        of_means = _describe_differences(n=len(differences), are_ratios=are_ratios)
        caption = (
            f"{_begin_sentence(label)} in block {block.block}. A: a dot per {_name_unit(block)}, beside them the "
            f"group's mean with its 95 % interval. B: {of_means} of the comparison."
        )
        yield ReportFigure(block.block, png, caption)


def _describe_differences(*, n: int, are_ratios: bool) -> str:
    """Return the words for what panel B of a block's figure shows: ``n`` differences or ratios with intervals."""
    name, averages = "difference", "means"
    if are_ratios:
        name, averages = "ratio", "geometric means"
    if n == 1:
        return f"the {name} of the {averages}, with the interval"
    return f"{name}s of the {averages}, with the intervals"


def draw_interaction(interaction: InteractionResults, out: Path, condition_label: str = "") -> ReportFigure:
    """Return a figure of every participant's value by group and condition, and of the interaction's contrasts.

    Args:
        interaction: the results to draw.
        out: the folder of the figures.
        condition_label: the label of trials whose levels the conditions are; "" where they are blocks.
    """
    label = phrase_measure(interaction.measure)
    cells = interaction.cells
    groups = {
        group: cells[cells.index.get_level_values("group") == group].to_numpy(float) for group in interaction.groups
    }
    is_log = any(compared.groups.is_log for compared in interaction.headline)
    png, _ = draw_figure_files(
        out / "groups_and_conditions_result",
        "design_cells.cells_figure",
        groups,
        interaction.conditions,
        [*map(_convert_to_difference, interaction.headline)],
        measure=_shorten(label),
        title=name_measure(label, width=_TITLE_WIDTH),
        condition=condition_label,
        level="ratio of ratios" if is_log else "difference of contrast scores",
        are_ratios=is_log,
        limits=_find_limits(interaction.measure, pd.Series(cells.to_numpy(float).ravel())),
    )
    caption = (
        f"{_begin_sentence(label)} by group and condition. A: a dot per participant and condition, a thin line "
        "through the dots of each; large symbols: the cells' means with 95 % intervals. "
        f"B: {'ratios' if is_log else 'differences'} between groups of participants' contrasts between conditions, "
        "with the intervals of the comparison."
    )
    return ReportFigure("", png, caption)


def _convert_to_difference(compared: ContrastComparison) -> Difference:
    """Return the difference that a figure draws for a comparison of two groups on a contrast."""
    groups = compared.groups
    pair = format_pair(groups.first, groups.second, is_log=groups.is_log)
    return Difference(name_contrast(compared), pair, groups.difference, groups.interval)


def _name_unit(block: BlockResults) -> str:
    """Return the noun for what a dot in a block's figure represents."""
    if not block.teams:
        return "participant"
    if all(group in block.team_units for group in block.groups["group"]):
        return "team"
    return "team or participant"


def draw_conditions(within: WithinResults, out: Path) -> ReportFigure:
    """Return a figure of every participant's value in each condition, and of the differences within participants.

    ``out`` is the folder of the figures.
    """
    label = phrase_measure(within.measure)
    is_log = any(comparison.is_log for comparison in within.headline)
    differences = [
        Difference(_name_comparison(comparison), "", comparison.difference, comparison.interval)
        for comparison in within.headline
    ]
    png, _ = draw_figure_files(
        out / "conditions_result",
        "design_cells.cells_figure",
        {"participants": within.cells.to_numpy(float)},
        within.conditions,
        differences,
        measure=_shorten(label),
        title=name_measure(label, width=_TITLE_WIDTH),
        condition=within.label,
        level="ratio within participants" if is_log else "difference within participants",
        are_ratios=is_log,
        comparison="differences, 95 % interval",
        limits=_find_limits(within.measure, pd.Series(within.cells.to_numpy(float).ravel())),
    )
    caption = (
        f"{_begin_sentence(label)} by condition. A: a dot per participant and condition, a thin line through the dots "
        "of each; large symbols: means with 95 % intervals, which include how participants differ from each other. B: "
        "differences within participants, with the intervals of the comparison."
    )
    return ReportFigure("", png, caption)


def _name_comparison(comparison: PairedComparison) -> str:
    """Return the two conditions of a comparison, or the name of a contrast."""
    if comparison.second:
        return format_pair(comparison.first, comparison.second, is_log=comparison.is_log)
    return comparison.first


_BINS_PER_OCTAVE = 4
REACTION_TIME_QUERY = f"""
    SELECT block, "group", participant, floor({_BINS_PER_OCTAVE} * log2(response_ms))::INTEGER AS bin, count(*) AS n
    FROM steps
    WHERE (study, participant, session, episode, attempt) IN (
        SELECT (study, participant, session, episode, attempt) FROM episodes WHERE exclusion_reason IS NULL
    ) AND response_ms > 0 GROUP BY ALL ORDER BY ALL
"""


def draw_reaction_times(times: pd.DataFrame, results: Results, out: Path) -> Iterator[ReportFigure]:
    """Yield a figure per block of the distribution of each participant's reaction times.

    ``times`` is the result of ``REACTION_TIME_QUERY``; a block without reaction times has no figure.
    """
    for block in results.blocks:
        rows = times[times["block"] == block.block]
        if rows.empty:
            continue
        bins = range(int(rows["bin"].min()), int(rows["bin"].max()) + 1)
        counts = rows.pivot_table(
            index=["group", "participant"], columns="bin", values="n", aggfunc="sum", fill_value=0
        )
        shares = counts.reindex(columns=bins, fill_value=0)
        shares = shares.div(shares.sum(axis=1), axis=0)
        groups = {group: shares.loc[group].to_numpy(float) for group in results.order if group in shares.index}
        edges_ms = 2.0 ** (np.arange(bins.start, bins.stop + 1) / _BINS_PER_OCTAVE)
        stem = out / f"{block.block}_reaction_times"
        title = name_measure("reaction times", block.block)
        participants = "Thin lines: participants"
        if not are_few(groups):
            participants = "Band: from the 10th to the 90th percentile of the participants"
        png, _ = draw_figure_files(stem, "estimation.reaction_time_figure", groups, edges_ms, title=title)
        caption = (
            f"Reaction times in block {block.block}, {_BINS_PER_OCTAVE} bins per doubling. {participants}; thick line: "
            "the mean over the group's participants."
        )
        yield ReportFigure(block.block, png, caption)


def draw_learning_curves(
    episodes: pd.DataFrame, results: Results, out: Path, teams: pd.DataFrame | None = None
) -> Iterator[ReportFigure]:
    """Yield a figure of the groups' learning curves for each block of several episodes and each measure of `CURVES`.

    A team is one curve, the mean of its members. A measure without values in a block has no figure.
    """
    included = _average_members(episodes[episodes["exclusion_reason"].isna()], teams)
    for block in results.blocks:
        rows = included[included["block"] == block.block]
        if rows["episode_in_block"].nunique() < 2:
            continue
        for measure, label, bounds in CURVES:
            curves = collect_learning_curves(rows, measure, order=results.order)
            if not curves or not rows[measure].notna().any() or (measure == "success" and lacks_goal(rows)):
                continue
            limits = None
            if rows[measure].dropna().between(*bounds).all():
                limits = bounds
            png, _ = draw_figure_files(
                out / f"{block.block}_{measure}",
                "learning_curves.learning_figure",
                curves,
                measure=_AXIS[measure],
                limits=limits,
                title=name_measure(label, block.block),
                xlabel="trial in the block" if results.are_trials else "episode in the block",
            )
            units = "trials" if results.are_trials else "episodes"
            marks = _describe_curves(has_lines=has_participant_lines(curves, limits))
            caption = f"{_begin_sentence(label)} over the {units} of block {block.block}: {marks}."
            yield ReportFigure(block.block, png, caption)


def _average_members(episodes: pd.DataFrame, teams: pd.DataFrame | None) -> pd.DataFrame:
    """Return a row per episode of each team with the means over its members, and of each participant without a team.

    Of several attempts of a participant at an episode, the last counts.
    """
    if teams is None or teams.empty or episodes.empty:
        return episodes
    keys = ["group", "participant", "session", "block", "episode_in_block"]
    measures = [measure for measure, _, _ in CURVES]
    united = unite_teams(episodes.drop_duplicates(keys, keep="last").reset_index(drop=True), teams)
    return united.astype(dict.fromkeys(measures, float)).groupby(keys, sort=False)[measures].mean().reset_index()


def _describe_curves(*, has_lines: bool) -> str:
    """Return the words for what a figure of learning curves draws; ``has_lines`` if it has a line per participant."""
    if has_lines:
        return "mean, 95 % interval; thin lines: participants"
    return "mean, 95 % interval"


def draw_sessions(blocks: pd.DataFrame, results: Results, out: Path) -> Iterator[ReportFigure]:
    """Yield a figure of the main measure, session by session, for each block that was played in several sessions."""
    included = blocks[blocks["exclusion_reason"].isna()]
    for block in results.blocks:
        rows = included[included["block"] == block.block]
        measures = [comparison.measure for comparison in block.headline] or block.by_session["measure"].tolist()
        if not measures or rows["session"].nunique() < 2:
            continue
        measure = measures[0]
        sessions = sorted(rows["session"].unique())
        curves = {}
        for group in results.order:
            group_rows = rows[rows["group"] == group]
            if len(group_rows):
                table = group_rows.pivot(index="participant", columns="session", values=measure)
                curves[group] = table.reindex(columns=sessions).to_numpy(float)
        label = label_measure(measure)
        limits = _find_limits(measure, rows[measure])
        png, _ = draw_figure_files(
            out / f"{block.block}_sessions",
            "learning_curves.learning_figure",
            curves,
            measure=_shorten(label),
            limits=limits,
            xlabel="session",
            numbers=sessions,
            title=name_measure(label, block.block),
        )
        marks = _describe_curves(has_lines=has_participant_lines(curves, limits))
        caption = f"{_begin_sentence(label)} in block {block.block}, session by session: {marks}."
        yield ReportFigure(block.block, png, caption)


def draw_waiting_times(results: Results, out: Path) -> Iterator[ReportFigure]:
    """Yield figures of the survival curves of reaching the goal and of discovering all keys, for blocks with times."""
    for block in results.blocks:
        if block.waits.goal:
            waiting = "episodes that have not reached the goal"
            png, _ = draw_figure_files(
                out / f"{block.block}_waiting_goal",
                "survival_curves.survival_figure",
                block.waits.goal,
                label="steps of an episode",
                title=name_measure(f"share of {waiting}", block.block),
                counted="without the goal",
            )
            caption = (
                f"Share of {waiting} (Kaplan and Meier). Ticks: episodes that never reached it, at their last step, "
                "or at the step limit if they failed, as they can no longer reach it. Below: the number without the "
                "goal just before that step."
            )
            yield ReportFigure(block.block, png, caption)
        if block.waits.keys:
            waiting = "participants who have not discovered all keys"
            png, _ = draw_figure_files(
                out / f"{block.block}_waiting_keys",
                "survival_curves.survival_figure",
                block.waits.keys,
                label="playing time (s)",
                title=name_measure(f"share of {waiting}", block.block),
                independent=True,  # a time per participant
            )
            caption = (
                f"Share of {waiting} (Kaplan and Meier); 95 % intervals (Greenwood, log-log); ticks: censored. Below: "
                "the number at risk."
            )
            yield ReportFigure(block.block, png, caption)


def draw_paths(tables: Tables, out: Path, *, has_practice: bool = False) -> Iterator[ReportFigure]:
    """Yield a figure per group of the paths of one session: of those with the most blocks, the first.

    Practice is included; ``has_practice`` says so in the caption. A session without maps has no figure.
    """
    examples: dict[str, CachedSession] = {}
    for candidate in sorted(tables.sessions, key=lambda session: -session.blocks):
        if candidate.blocks and candidate.outline is not None:
            examples.setdefault(candidate.outline.group, candidate)
    has_several_sessions = len({candidate.outline.session for candidate in tables.sessions if candidate.outline}) > 1
    for group, example in sorted(examples.items()):
        session = tables.read_session(example).session
        if not any(episode.start.map for episode in session.episodes):  # trials, for instance
            continue
        png, _ = draw_figure_files(out / f"paths_{group}", "path_figures.blocks_figure", group_by_block(session))
        participant = session.plan.participant.id
        session_note = f" in session {session.plan.session}" if has_several_sessions else ""
        caption = (
            f"Paths of {participant} (group {group}), the first participant with the most blocks{session_note}"
            f"{'; practice is included' if has_practice else ''}."
        )
        yield ReportFigure("", png, caption)
