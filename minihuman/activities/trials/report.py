"""The report's section on trials: accuracy, response times, detection, effects of conditions, and learning."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from minihuman.activities.trials.stop_signal import FEWEST_STOP_TRIALS, StopSignalEstimate, estimate_people
from minihuman.activities.trials.trial_measures import (
    ALL,
    ANTICIPATION_MS,
    COMPARED,
    MEASURES,
    average_sessions,
    find_quantiles,
    mark_trimmed,
    measure_conditions,
    measure_quarters,
    read_labels,
)
from minihuman.figures.figure_data import draw_figure_files
from minihuman.reporting.activity_sections import CaptionedTable, ReportSection, SectionSource
from minihuman.reporting.template import (
    ReportFigure,
    Table,
    format_difference,
    format_interval,
    format_mean_sd,
    format_number,
    format_p_value,
    format_pair,
)
from minihuman.statistics.comparison import GroupComparison, compare_groups
from minihuman.statistics.paired import PairedComparison, compare_conditions
from minihuman.worlds.catalogue import TRIAL_WORLDS

_QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
_LIMITS: dict[str, tuple[float, float]] = {"accuracy": (0.0, 1.0)}
_SHOWN = ("accuracy", "response_median_ms", "response_mean_ms", "omissions")
_DETECTION = ("hit_rate", "false_alarm_rate", "d_prime", "criterion")
_HEADS = {
    "accuracy": "accuracy",
    "response_median_ms": "RT median (ms)",
    "response_mean_ms": "RT mean (ms)",
    "omissions": "omissions",
    "hit_rate": "hits",
    "false_alarm_rate": "false alarms",
    "d_prime": "d'",
    "criterion": "c",
}

_SSRT = "SSRT (ms)"
_STOP_HEADS = (
    "block", "group", "participant", "go trials", "go accuracy", "go omissions", "go RT (ms)", "stop trials",
    "p(respond | signal)", "delay (ms)", "failed stop RT (ms)", _SSRT,
)  # fmt: skip
_REMARK_HEADS = ("block", "group", "participant", "remark")
_STOP_CAPTION = (
    "Stop signals: go RT, mean of all go responses; delay, mean of the presented ones; failed stop RT, mean of "
    "responses in stop trials; SSRT, by integration with go omissions replaced by the slowest go response, wrong and "
    f"premature go responses included (Verbruggen et al., 2019). None with fewer than {FEWEST_STOP_TRIALS} stop "
    "trials, or where failed stops are not faster than go responses. Last row of a group: mean (standard deviation) "
    "over participants, and the mean's 95 % interval (Student's t)."
)
_STOP_COMPARISON_CAPTION = (
    "Stop signals: groups compared on the SSRT of the participants who have one: difference, 95 % interval and p by "
    "the two-sided permutation test of Welch's t; p (Holm) is corrected over the pairs of groups of one block."
)
_REMARK_CAPTION = "Stop signals: why a participant has no SSRT, or one that is unreliable."


def build_section(source: SectionSource) -> ReportSection | None:
    """Build the section on trials; None if no trial was recorded, or none of the included ones has a measure."""
    trials = source.table("trials")
    if trials.empty:
        return None
    trials = source.keep_analysed(source.keep_included(trials))
    measured = measure_conditions(trials)
    if measured.empty:
        return None
    people = average_sessions(measured)
    tables = (
        *_tabulate_conditions(people),
        *_tabulate_detection(people),
        *_tabulate_stop_signals(trials),
        *_tabulate_differences(people),
        *_tabulate_group_differences(people),
        *_tabulate_quarters(average_sessions(measure_quarters(trials))),
        *_tabulate_quantiles(trials),
    )
    return ReportSection(
        "Trials",
        tables,
        figures=_draw_conditions(people, source),
        measure_tables={"trial_measures": measured[measured["label"].eq("")], "trial_levels": measured},
        blocks=frozenset(trials.loc[trials["world"].isin(TRIAL_WORLDS), "block"]),
        is_leading=True,
    )


def _name_level(label: str, level: str) -> str:
    if not label:
        return "all trials"
    return f"{label} = {level}"


def _iterate_levels(people: pd.DataFrame) -> Iterator[tuple[str, str, str, str, pd.DataFrame]]:
    """Yield block, group, label and level, each with the rows of ``people``, as `average_sessions` returns them."""
    for (block, group, label), label_rows in people.groupby(["block", "group", "label"], sort=False):
        for level, rows in label_rows.groupby("level", sort=True):
            yield str(block), str(group), str(label), str(level), rows


def _format_over_people(rows: pd.DataFrame, measure: str) -> str:
    """Return a measure's mean and standard deviation over the participants who have it, as text; "n/a" if none has."""
    measured = rows[measure].dropna()
    if len(measured):
        return format_mean_sd(float(measured.mean()), float(measured.std()))
    return "n/a"


def _tabulate(people: pd.DataFrame, measures: Sequence[str], caption: str) -> list[CaptionedTable]:
    """Return a table of the measures that any participant has, by block, group and level; [] without any measure."""
    present_measures = [measure for measure in measures if people[measure].notna().any()]
    if not present_measures:
        return []
    rows = [
        (
            block, group, _name_level(label, level), str(len(part)), format_number(float(part["trials"].mean()), 1),
            *(_format_over_people(part, measure) for measure in present_measures),
        )
        for block, group, label, level, part in _iterate_levels(people)
    ]  # fmt: skip
    heads = ("block", "group", "trials of", "n", "trials each", *(_HEADS[measure] for measure in present_measures))
    return [CaptionedTable(Table(heads, rows, words=3), caption)]


def _tabulate_conditions(people: pd.DataFrame) -> list[CaptionedTable]:
    """Return the table of accuracy, response times and omissions by level; [] if no participant has any of them."""
    caption = (
        "Trials by block, group and level of each label: mean (standard deviation) over the n participants. RT: from "
        "the onset of the stimulus to the key press, of correct responses alone. Median: of all of these. Mean: "
        f"without those before {ANTICIPATION_MS:g} ms and those further than 3 scaled median absolute deviations from "
        "the participant's median in the block (Leys et al., 2013). Omissions: no response where one was correct. "
        "Practice is not included."
    )
    return _tabulate(people, _SHOWN, caption)


def _tabulate_detection(people: pd.DataFrame) -> list[CaptionedTable]:
    """Return the table of signal detection by level; [] if no trial asks to withhold the response."""
    measured = people[people["d_prime"].notna()]
    caption = (
        "Signal detection, where to withhold the response is correct in some trials: hits, responses where one is "
        "correct; false alarms, responses where none is. d' and criterion c of the equal-variance normal model "
        "(Macmillan and Creelman, 2005), for every participant with the log-linear correction: 0.5 added to each count "
        "and 1 to the trials (Hautus, 1995). Mean (standard deviation) over participants."
    )
    if len(measured):
        return _tabulate(measured, _DETECTION, caption)
    return []


def _tabulate_stop_signals(trials: pd.DataFrame) -> list[CaptionedTable]:
    """Return the tables of stop-signal reaction times, of their comparison and of remarks; [] without stop signals."""
    groups: dict[tuple[str, str], list[tuple[str, StopSignalEstimate]]] = {}
    for block, group, participant, estimate in estimate_people(trials):
        groups.setdefault((block, group), []).append((participant, estimate))
    rows: list[tuple[str, ...]] = []
    remarks: list[tuple[str, ...]] = []
    for (block, group), people in groups.items():
        for participant, estimate in people:
            rows.append((block, group, participant, *_format_stop_estimate(estimate)))
            if estimate.remark:
                remarks.append((block, group, participant, estimate.remark))
        rows.append(_summarise_stop_signals(block, group, [estimate for _, estimate in people]))
    if not rows:
        return []
    tables = [CaptionedTable(Table(_STOP_HEADS, rows, words=3), _STOP_CAPTION)]
    tables += _compare_stop_signals(groups)
    if remarks:
        tables.append(CaptionedTable(Table(_REMARK_HEADS, remarks, words=4), _REMARK_CAPTION))
    return tables


def _compare_stop_signals(
    groups: Mapping[tuple[str, str], Sequence[tuple[str, StopSignalEstimate]]],
) -> list[CaptionedTable]:
    """Build the table that compares groups on the stop-signal reaction time; no table if each block has one group.

    Args:
        groups: for each block and group, the participants with their estimates.
    """
    ssrts = [(block, group, estimate.ssrt_ms) for (block, group), people in groups.items() for _, estimate in people]
    times = pd.DataFrame(ssrts, columns=["block", "group", _SSRT]).dropna()
    rows = []
    for block, block_times in times.groupby("block", sort=False):
        if block_times["group"].nunique() < 2:
            continue
        for comparison in compare_groups(block_times, [_SSRT], order=list(dict.fromkeys(block_times["group"]))):
            _, *cells = _format_comparison(comparison, f"{comparison.n[0]}, {comparison.n[1]}")  # without the measure
            rows.append((str(block), *cells))
    heads = ("block", "groups", "n", "difference in SSRT (ms, 95 %)", "p", "p (Holm)")
    return [CaptionedTable(Table(heads, rows, words=2), _STOP_COMPARISON_CAPTION)] if rows else []


def _format_stop_estimate(estimate: StopSignalEstimate) -> tuple[str, ...]:
    """Format the cells of a participant's stop-signal estimate, in the order of `_STOP_HEADS` from the go trials on."""
    return (
        str(estimate.go_trials),
        _format_or_na(estimate.go_accuracy, 3),
        _format_or_na(estimate.go_omissions, 3),
        _format_or_na(estimate.go_ms, 0),
        str(estimate.stop_trials),
        _format_or_na(estimate.response_rate, 3),
        _format_or_na(estimate.mean_delay_ms, 0),
        _format_or_na(estimate.failed_stop_ms, 0),
        _format_or_na(estimate.ssrt_ms, 0),
    )


def _summarise_stop_signals(block: str, group: str, estimates: list[StopSignalEstimate]) -> tuple[str, ...]:
    """Return the last row of a group's participants, with the mean stop-signal reaction time in its last column.

    The mean has its standard deviation, and its 95 % interval if several participants have an estimate.
    """
    from minihuman.figures.learning_curves import mean_and_band  # Matplotlib, which only this section needs

    times = pd.Series([estimate.ssrt_ms for estimate in estimates]).dropna()
    summary = "n/a"
    if len(times):
        summary = format_mean_sd(float(times.mean()), float(times.std()))
    if len(times) > 1:
        _, low, high = mean_and_band(np.asarray(times, np.float64)[:, None])
        summary += f", {format_interval((float(low[0]), float(high[0])))}"
    first_cells = (block, group, f"all with an SSRT: {len(times)} of {len(estimates)}")
    empty_cells = [""] * (len(_STOP_HEADS) - len(first_cells) - 1)
    return (*first_cells, *empty_cells, summary)


def _format_or_na(number: float, digits: int) -> str:
    if math.isnan(number):
        return "n/a"
    return format_number(number, digits)


def _tabulate_differences(people: pd.DataFrame) -> list[CaptionedTable]:
    """Return the table of differences within participants between the levels of a label; [] if there are none.

    A congruency effect is an example.
    """
    rows = []
    for block, labels in people[people["label"].ne("")].groupby("block", sort=False):
        for label, part in labels.groupby("label", sort=False):
            tables_by_measure = {
                measure: part.pivot_table(measure, "participant", "level").dropna(axis="columns", how="all")
                for measure in (*COMPARED, "d_prime", "criterion")
                if part[measure].notna().any()
            }
            rows += [
                (str(block), str(label), *_format_comparison(comparison, str(comparison.n)))
                for comparison in compare_conditions(tables_by_measure)
            ]
    heads = ("block", "label", "measure", "levels", "n", "difference (95 %)", "p", "p (Holm)")
    caption = (
        "Levels of each label compared within participants, over those who have both. Difference, 95 % interval and p: "
        "paired permutation test; p (Holm) is corrected over the comparisons of one label in one block."
    )
    if rows:
        return [CaptionedTable(Table(heads, rows, words=4), caption)]
    return []


def compute_effects(people: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Compute the differences of a measure between every two levels of every label, for each participant.

    ``people`` is a table as `average_sessions` returns it.

    Returns:
        A row per participant and pair of levels, with the participant's group, the block, the label, the levels as
        text, and ``effect``: the measure at the first level minus that at the second.
    """
    rows = []
    labelled = people[people["label"].ne("")]
    for (block, label), part in labelled.groupby(["block", "label"], sort=False):
        table = part.pivot_table(measure, ["participant", "group"], "level")
        for first, second in combinations(table.columns, 2):
            effect = (table[first] - table[second]).dropna().rename("effect").reset_index()
            levels = format_pair(str(first), str(second))
            rows.append(effect.assign(block=str(block), label=str(label), levels=levels))
    if rows:
        return pd.concat(rows)
    return pd.DataFrame(columns=["participant", "group", "effect", "block", "label", "levels"])


def _tabulate_group_differences(people: pd.DataFrame) -> list[CaptionedTable]:
    """Return the table that compares groups on all trials and on the differences between levels; [] for one group.

    The comparison of differences is the interaction of group and label.
    """
    overall = people[people["label"].eq("")]
    if overall["group"].nunique() < 2:
        return []
    rows = []
    for block, part in overall.groupby("block", sort=False):
        measures = [name for name in (*COMPARED, "d_prime", "criterion") if part[name].notna().any()]
        rows += _format_group_comparisons(str(block), "all trials", part, measures)
    effects = pd.concat([compute_effects(people, measure).assign(measure=measure) for measure in COMPARED])
    for (block_name, label, levels), part in effects.groupby(["block", "label", "levels"], sort=False):
        person_effects = part.pivot_table("effect", ["participant", "group"], "measure").reset_index()
        measures = [measure for measure in COMPARED if measure in person_effects]
        rows += _format_group_comparisons(str(block_name), f"{label}: {levels}", person_effects, measures)
    heads = ("block", "trials", "measure", "groups", "n", "difference (95 %)", "p", "p (Holm)")
    caption = (
        "Groups compared, on all trials and on the differences between levels (the interaction of group and label): "
        "two-sided permutation test of Welch's t; p (Holm) is corrected over the measures and pairs of groups of the "
        "same trials."
    )
    if rows:
        return [CaptionedTable(Table(heads, rows, words=4), caption)]
    return []


def _format_group_comparisons(
    block: str, trials: str, rows: pd.DataFrame, measures: Sequence[str]
) -> list[tuple[str, ...]]:
    """Return a row of table cells for each comparison of two groups on a measure; none if there is only one group.

    Args:
        block: the block's name.
        trials: the cell that says which trials are compared.
        rows: the participants' measures, with their groups.
        measures: the columns to compare.
    """
    if rows["group"].nunique() < 2:
        return []
    return [
        (block, trials, *_format_comparison(comparison, f"{comparison.n[0]}, {comparison.n[1]}"))
        for comparison in compare_groups(rows, measures)
    ]


def _format_comparison(comparison: GroupComparison | PairedComparison, count: str) -> tuple[str, ...]:
    """Format the table cells of a comparison: measure, levels or groups, count, difference, p and corrected p.

    ``count`` is the cell with the number of participants.
    """
    return (
        MEASURES.get(comparison.measure, comparison.measure),
        format_pair(comparison.first, comparison.second),
        count,
        format_difference(comparison.difference, comparison.interval, is_log=False, sign="+"),
        format_p_value(comparison.p),
        format_p_value(comparison.p_holm),
    )


def _tabulate_quarters(people: pd.DataFrame) -> list[CaptionedTable]:
    """Return the table of measures in each quarter of a block; [] if no participant has any measure."""
    caption = (
        "Learning over trials: each quarter of a block, mean (standard deviation) over participants, measured as above."
    )
    return _tabulate(people, _SHOWN[:3], caption)


def _tabulate_quantiles(trials: pd.DataFrame) -> list[CaptionedTable]:
    """Return the table of quantiles of the correct response times, by block and by each level of each label."""
    rows = []
    for block, part in trials.groupby("block", sort=False):
        levels_by_label = {"": pd.Series(ALL, part.index), **read_labels(part)}
        for label, levels in levels_by_label.items():
            for level, quantiles in find_quantiles(part, levels, _QUANTILES).iterrows():
                times = (format_number(float(quantile), 0) for quantile in quantiles)
                rows.append((str(block), _name_level(label, str(level)), *times))
    trimmed = trials[mark_trimmed(trials)]
    is_correct = trials["is_correct"].eq(True) & trials["response_ms"].notna()
    share = 1 - len(trimmed) / max(1, int(is_correct.sum()))
    caption = (
        "The distribution of correct response times (ms): quantiles of each participant, then their mean (Ratcliff, "
        f"1979). The trimmed means above leave out {format_number(100 * share, 1)} % of them."
    )
    return [CaptionedTable(Table(("block", "trials of", *map(str, _QUANTILES)), rows, words=2), caption)]


def _draw_conditions(people: pd.DataFrame, source: SectionSource) -> Iterator[ReportFigure]:
    """Draw and yield a figure for each label of each block: every participant's measures at each level.

    A label with one level or without measures gets no figure.
    """
    for (block, label), part in people[people["label"].ne("")].groupby(["block", "label"], sort=False):
        levels = sorted(part["level"].unique())
        measures = [name for name in COMPARED if part[name].notna().any()]
        if len(levels) < 2 or not measures:
            continue
        panels = [(MEASURES[name], _collect_values(part, name, levels), _LIMITS.get(name)) for name in measures]
        stem = source.figures / f"{block}_trials_{_make_file_name(str(label))}"
        png, _ = draw_figure_files(
            stem, "trial_figures.condition_figure", panels, levels, label=str(label), title=f"Block {block}: {label}"
        )
        caption = f"Trials of block {block} by {label}: every participant (thin), means and their 95 % intervals."
        yield ReportFigure(str(block), png, caption)


def _collect_values(part: pd.DataFrame, measure: str, levels: Sequence[str]) -> list[tuple[str, NDArray[np.float64]]]:
    """Return each group's name and its values, float64[participants, levels]; groups without a value are left out."""
    return [
        (
            str(group),
            rows.pivot_table(measure, "participant", "level").reindex(columns=list(levels)).to_numpy(np.float64),
        )
        for group, rows in part.groupby("group", sort=False)
        if not math.isnan(rows[measure].mean())
    ]


def _make_file_name(label: str) -> str:
    return "".join(character if character.isalnum() else "_" for character in label)
