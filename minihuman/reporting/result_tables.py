"""The tables of a block's results, and of conditions compared within participants."""

from collections.abc import Mapping, Sequence
from typing import Any

from minihuman.reporting.block_measures import label_measure
from minihuman.reporting.block_results import BlockResults, BlockSurvival, SessionChange
from minihuman.reporting.template import (
    Table,
    format_difference,
    format_explained_variance,
    format_mean_sd,
    format_number,
    format_p_value,
    format_pair,
    format_with_interval,
    to_records,
)
from minihuman.reporting.within_results import WithinResults
from minihuman.statistics.reliability import Reliability
from minihuman.statistics.two_part_model import PartComparison, TwoPartComparison

_NONE = "\N{EN DASH}"  # a cell without a number


def _join_sizes(n: tuple[int, int]) -> str:
    return f"{n[0]}, {n[1]}"


def conditions_table(within: WithinResults) -> Table | None:
    """Tabulate the comparisons of conditions within participants; None if there are none."""
    rows = [
        (
            label_measure(comparison.measure),
            within.roles[comparison.measure],
            format_pair(comparison.first, comparison.second, is_log=comparison.is_log),
            str(comparison.n),
            ", ".join(map(format_number, comparison.means)),
            format_difference(comparison.difference, comparison.interval, is_log=comparison.is_log),
            format_p_value(comparison.p),
            format_p_value(comparison.p_holm),
            format_p_value(comparison.smallest_p),
        )
        for comparison in within.comparisons
    ]
    if not rows:
        return None
    heads = ("measure", "named before", "conditions", "n", "means", "difference", "p", "p (Holm)", "smallest p")
    return Table(heads, rows, words=3)


def crossover_table(within: WithinResults) -> Table | None:
    """Tabulate the effects of position and carry-over; None if neither could be tested, as with a single order."""
    rows = [
        (
            label_measure(term.measure),
            term.effect,
            _join_sizes(term.freedom),
            format_number(term.f),
            format_p_value(term.p),
            format_explained_variance(term.variance),
        )
        for term in within.effects
    ]
    if not rows:
        return None
    return Table(
        ("measure", "effect", "degrees of freedom", "F", "p", "\N{GREEK SMALL LETTER OMEGA}\N{SUPERSCRIPT TWO} (90 %)"),
        rows,
        words=2,
    )


def survival_table(survival: BlockSurvival) -> Table | None:
    """Tabulate the comparisons of key discovery; None if there are none.

    Participants who never discovered all keys are censored.
    """
    rows = [
        (
            format_pair(first, second),
            _join_sizes(comparison.n),
            _join_sizes(comparison.censored),
            format_number(comparison.until),
            ", ".join(map(format_number, comparison.means)),
            format_with_interval(comparison.difference, comparison.interval, sign="+"),
            format_p_value(comparison.p),
            format_p_value(comparison.logrank_p),
        )
        for first, second, comparison in survival.compared
    ]
    if not rows:
        return None
    heads = ("groups", "n", "never", "observed (s)", "restricted means (s)", "difference (95 %)", "p", "curves: p")
    return Table(heads, rows)


def reliability_table(reliabilities: Sequence[Reliability], *, are_trials: bool = False) -> Table | None:
    """Tabulate how well each measure distinguishes participants; None if no reliability was estimated."""
    rows = [
        (
            label_measure(reliability.measure),
            str(reliability.participants),
            str(reliability.episodes),
            format_with_interval(reliability.icc, reliability.icc_interval),
            format_with_interval(reliability.halves, reliability.halves_interval),
        )
        for reliability in reliabilities
    ]
    if not rows:
        return None
    unit = "trial" if are_trials else "episode"
    return Table(("measure", "participants", f"{unit}s", f"one {unit}: ICC", "all: split-half"), rows)


def list_reliability_notes(reliabilities: Sequence[Reliability]) -> list[str]:
    """Return a note for each reason why measures have no interval, or why it may not hold, with their labels."""
    measures: dict[str, list[str]] = {}
    for reliability in reliabilities:
        if reliability.note:
            measures.setdefault(reliability.note, []).append(label_measure(reliability.measure))
    return [f"{', '.join(names)}: {note}" for note, names in measures.items()]


def session_table(block: BlockResults) -> Table | None:
    """Tabulate each session's values, and the changes from the block's first session; None for a single session."""
    sessions = sorted(block.by_session["session"].unique())
    if len(sessions) < 2:
        return None
    first, *later = sessions
    values = {(row["measure"], row["group"], row["session"]): row for row in to_records(block.by_session)}
    changes = {(change.measure, change.group, change.sessions[1]): change for change in block.changes}
    rows: list[tuple[str, ...]] = []
    for measure, group in dict.fromkeys((measure, group) for measure, group, _ in values):
        cells = [_format_session(values.get((measure, group, session))) for session in sessions]
        for session in later:
            cells += _list_change_cells(changes.get((measure, group, session)))
        rows.append((label_measure(measure), group, *cells))
    heads = ["measure", "group", *(f"session {session}" for session in sessions)]
    for session in later:
        pair = f", {first} to {session}" if len(sessions) > 2 else ""
        heads += [f"{head}{pair}" for head in ("n", "change", "p")]
    return Table(tuple(heads), rows, words=2)


def _format_session(row: Mapping[str, Any] | None) -> str:
    """Format the mean and SD of one session; a dash if no participant has a value."""
    if row is None or not row["n"]:
        return _NONE
    return format_mean_sd(row["mean"], row["sd"])


def _list_change_cells(change: SessionChange | None) -> tuple[str, str, str]:
    """Return the cells n, change and p; dashes if no participant has values in both sessions."""
    if change is None:
        return ("0", _NONE, _NONE)
    estimate = format_difference(change.estimate, change.interval, is_log=change.is_log, sign="+")
    return (str(change.n), estimate, format_p_value(change.p))


def session_changes_table(block: BlockResults) -> Table | None:
    """Tabulate how groups differ in their change between sessions; None for a single group or session."""
    has_several_changes = len({sessions for sessions, _ in block.changes_compared}) > 1
    rows = []
    for (first, later), comparison in block.changes_compared:
        measure = label_measure(comparison.measure)
        if has_several_changes:
            measure += f", session {first} to {later}"
        difference = format_difference(comparison.difference, comparison.interval, is_log=comparison.is_log, sign="+")
        rows.append(
            (
                measure,
                format_pair(comparison.first, comparison.second, is_log=comparison.is_log),
                _join_sizes(comparison.n),
                difference,
                format_p_value(comparison.p),
                format_p_value(comparison.p_holm),
            )
        )
    if not rows:
        return None
    return Table(("measure", "groups", "n", "difference of changes", "p", "p (Holm)"), rows, words=2)


def parts_table(comparisons: Sequence[TwoPartComparison]) -> Table | None:
    """Tabulate both parts of a reward that has mass at 0; None if there are no comparisons."""
    rows = [
        (
            format_pair(comparison.first, comparison.second),
            _join_sizes(comparison.n),
            f"{comparison.shares[0]:.1%}, {comparison.shares[1]:.1%}",
            _format_part(comparison.any),
            format_p_value(comparison.any.p),
            _format_part(comparison.amount),
            format_p_value(comparison.amount.p),
            format_p_value(comparison.p),
        )
        for comparison in comparisons
    ]
    if not rows:
        return None
    heads = ("groups", "n", "earned", "odds ratio", "p", "difference where earned", "p", "p of both")
    return Table(heads, rows)


def list_missing_parts(comparisons: Sequence[TwoPartComparison]) -> list[str]:
    """Return a text for each part of a reward that could not be compared, with the groups and the reason."""
    reasons = []
    for comparison in comparisons:
        groups = format_pair(comparison.first, comparison.second)
        for name, part in (("odds", comparison.any), ("difference", comparison.amount)):
            if part.reason:
                reasons.append(f"{name}, {groups}: {part.reason}")
    return reasons


def _format_part(part: PartComparison) -> str:
    """Format the estimate of one part with its interval, or without if the part could not be compared."""
    if part.reason:
        return format_number(part.estimate)
    return format_with_interval(part.estimate, part.interval)
