"""The interaction of groups and conditions in a mixed design: participants' contrast scores, compared between groups.

The module computes the results, the sentences that answer the study's question with them, and their table.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import get_args

import numpy as np
import pandas as pd

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import Contrast, ExperimentDesign
from minihuman.reporting.block_measures import (
    Role,
    assign_roles,
    label_measure,
    list_default_measures,
    phrase_measure,
    take_logarithms,
)
from minihuman.reporting.results import Results
from minihuman.reporting.statements import state_interval, state_p
from minihuman.reporting.template import (
    Table,
    format_difference,
    format_explained_variance,
    format_interval,
    format_number,
    format_p_value,
    format_pair,
    format_with_interval,
)
from minihuman.statistics.comparison import GroupComparison, compare_pair, correct_comparisons, holm_correction
from minihuman.statistics.interaction import InteractionTest, compare_contrast_scores
from minihuman.statistics.permutation import ALPHA, permutation_tests


@dataclass(frozen=True, slots=True)
class ContrastComparison:
    """A comparison of two groups on the scores of one contrast between conditions."""

    contrast: str
    groups: GroupComparison


@dataclass(frozen=True, slots=True)
class OmnibusInteraction:
    """A test of all groups and conditions together on one measure, for an interaction of several degrees of freedom."""

    measure: str
    test: InteractionTest
    p_holm: float  # corrected for the measures of the same role


@dataclass(frozen=True, slots=True, eq=False)
class InteractionResults:
    """The results of crossing groups and conditions."""

    groups: tuple[str, ...]
    conditions: tuple[str, ...]
    roles: Mapping[str, Role]
    omnibus: tuple[OmnibusInteraction, ...]  # none of one degree of freedom, or where contrasts are stated
    contrasts: tuple[ContrastComparison, ...]
    left_out: int  # participants without a value in every condition, of the first measure
    cells: pd.DataFrame  # of the first measure: index group and participant, a column per condition
    scaled_cells: pd.DataFrame  # the same on the scale of the tests, times as logarithms
    tested_contrasts: tuple[Contrast, ...]

    @property
    def measure(self) -> str:
        """Return the primary measure, or the first measure that has values; "" if there is none."""
        return min(self.roles, key=lambda name: self.roles[name] != "primary", default="")

    @property
    def headline(self) -> tuple[ContrastComparison, ...]:
        """Return the contrasts of the primary measure, or of the first measure that has values."""
        return tuple(compared for compared in self.contrasts if compared.groups.measure == self.measure)


def compute_interaction(
    rows: pd.DataFrame,
    design: ExperimentDesign,
    analysis: AnalysisSpec,
    order: tuple[str, ...],
    *,
    intervals: bool = True,
) -> InteractionResults | None:
    """Compare contrast scores between groups on the measures that the protocol names, or on all that have values.

    A participant's value in a condition is the mean over its blocks and sessions. Participants without a value in every
    condition are omitted. The result is None unless the design is mixed and at least two groups have values.

    ``rows`` are the included rows of the table of blocks, with teams in place of their members, and ``order`` has the
    groups in order. ``intervals`` says whether to compute intervals of contrasts, which take most of the time.
    """
    if not design.is_mixed:
        return None
    compared = _name_conditions(rows, design)
    measures = _list_measures(compared, analysis)
    groups = tuple(group for group in order if (compared["group"] == group).any())
    if not measures or len(groups) < 2:
        return None
    scaled, logs = take_logarithms(compared, measures)
    roles = assign_roles(measures, analysis)
    tables = {name: _tabulate_cells(scaled, name, design.conditions) for name in measures}
    complete = {name: table.dropna() for name, table in tables.items()}
    first = min(measures, key=lambda name: roles[name] != "primary")
    return InteractionResults(
        groups=groups,
        conditions=design.conditions,
        roles=roles,
        omnibus=_test_omnibus(complete, groups, roles, design),
        contrasts=_compare_contrasts(complete, design.tested_contrasts, groups, roles, logs, intervals=intervals),
        left_out=len(tables[first]) - len(complete[first]),
        cells=_tabulate_cells(compared, first, design.conditions),
        scaled_cells=tables[first],
        tested_contrasts=design.tested_contrasts,
    )


def _list_measures(rows: pd.DataFrame, analysis: AnalysisSpec) -> list[str]:
    """Return the measures that the protocol names, or all measures if it names none, without those that lack values."""
    named_measures = [name for name in (analysis.primary_measure, *analysis.secondary_measures) if name]
    return [name for name in named_measures or list_default_measures(rows) if rows[name].notna().any()]


def _name_conditions(rows: pd.DataFrame, design: ExperimentDesign) -> pd.DataFrame:
    """Return the rows of the blocks that are compared, with their condition in the column ``condition``."""
    condition_of_block = dict(design.condition_of_block)
    compared = rows[rows["block"].isin(condition_of_block)]
    return compared.assign(condition=compared["block"].map(condition_of_block))


def choose_first_block(
    design: ExperimentDesign, analysis: AnalysisSpec, results: Results, interaction: InteractionResults | None
) -> str:
    """Return the block whose group comparison answers the study's question; "" if the interaction answers it.

    The interaction answers it if the design says so and the protocol names no block: the last block that all groups
    play is then an arbitrary condition. Otherwise, return ``results.target``, which can also be "".
    """
    answers_by_interaction = interaction is not None and design.primary_effect == "interaction"
    if answers_by_interaction and not analysis.block:
        return ""
    return results.target


def _tabulate_cells(rows: pd.DataFrame, measure: str, conditions: tuple[str, ...]) -> pd.DataFrame:
    """Tabulate a measure with a row per group and participant and a column per condition; NaN for a missing value."""
    present = rows.assign(value=rows[measure].astype(float)).dropna(subset=["value"])
    means = present.groupby(["group", "participant", "condition"])["value"].mean()
    return means.unstack("condition").reindex(columns=list(conditions))


def _select_group(table: pd.DataFrame, group: str) -> pd.DataFrame:
    return table[table.index.get_level_values("group") == group]


def _compare_contrasts(
    tables: Mapping[str, pd.DataFrame],
    contrasts: tuple[Contrast, ...],
    groups: tuple[str, ...],
    roles: Mapping[str, Role],
    logs: frozenset[str],
    *,
    intervals: bool,
) -> tuple[ContrastComparison, ...]:
    """Compare each pair of groups on every contrast of every measure; p is corrected within each role (Holm).

    Args:
        tables: by measure, a row per group and participant and a column per condition, without missing values.
        contrasts: the contrasts between conditions.
        groups: the groups, in order.
        roles: the role of each measure.
        logs: the measures that are logarithms.
        intervals: whether to compute intervals, which take most of the time.
    """
    corrected: list[ContrastComparison] = []
    for role in get_args(Role):
        names = []
        comparisons = []
        measures = [measure for measure in roles if roles[measure] == role]
        for measure, contrast, pair in product(measures, contrasts, combinations(groups, 2)):
            is_log = measure in logs
            names.append(contrast.name)
            comparisons.append(
                _compare_scores(tables[measure], measure, contrast, pair, is_log=is_log, intervals=intervals)
            )
        corrected += map(ContrastComparison, names, correct_comparisons(comparisons))
    return tuple(corrected)


def _compare_scores(
    table: pd.DataFrame,
    measure: str,
    contrast: Contrast,
    pair: tuple[str, str],
    *,
    is_log: bool,
    intervals: bool,
) -> GroupComparison:
    """Compare two groups on their participants' scores of a contrast: weighted sums of the values in its conditions.

    ``table`` has a row per group and participant, and a column per condition.
    """
    weight_of_condition = dict(contrast.weights)
    weights = np.array(list(weight_of_condition.values()))
    scores = []
    for group in pair:
        cells = _select_group(table, group).reindex(columns=list(weight_of_condition)).dropna()
        scores.append(cells.to_numpy(float) @ weights)
    first, second = scores
    (test,) = permutation_tests([(first, second)])
    return compare_pair(measure, (pair[0], first), (pair[1], second), test, is_log=is_log, intervals=intervals)


def _test_omnibus(
    tables: Mapping[str, pd.DataFrame], groups: tuple[str, ...], roles: Mapping[str, Role], design: ExperimentDesign
) -> tuple[OmnibusInteraction, ...]:
    """Test all groups and conditions together; () if there is one degree of freedom or the design states contrasts.

    ``tables`` has, by measure, a row per group and participant and a column per condition, without missing values.
    """
    has_one_degree_of_freedom = len(groups) == 2 and len(design.conditions) == 2
    if design.contrasts or has_one_degree_of_freedom:
        return ()
    tests = {}
    for measure, table in tables.items():
        scores = [np.diff(_select_group(table, group).to_numpy(float), axis=1) for group in groups]
        tests[measure] = compare_contrast_scores(scores)
    corrected: dict[str, float] = {}
    for role in get_args(Role):
        names = [measure for measure in tests if roles[measure] == role]
        corrected |= zip(names, holm_correction([tests[name].p for name in names]), strict=True)
    return tuple(OmnibusInteraction(measure, test, corrected[measure]) for measure, test in tests.items())


def state_interaction(interaction: InteractionResults) -> Iterator[str]:
    """Yield sentences on whether differences between conditions depend on the group, for ``interaction.measure``."""
    name = phrase_measure(interaction.measure)
    opening = f"{name[0].upper()}{name[1:]}, interaction of group and condition"
    omnibus = next((candidate for candidate in interaction.omnibus if candidate.measure == interaction.measure), None)
    if omnibus is not None:
        yield _state_omnibus(opening, omnibus.test, interaction)
    elif len(interaction.headline) == 1:
        yield _state_contrast(opening, interaction.headline[0])
    else:
        yield _summarise_contrasts(opening, interaction)
        for contrast in dict.fromkeys(compared.contrast for compared in interaction.headline):
            yield _state_pairs([compared for compared in interaction.headline if compared.contrast == contrast])
    if interaction.left_out:
        yield f"{interaction.left_out} participants without a value in every condition are not in the interaction."


def _state_omnibus(opening: str, test: InteractionTest, interaction: InteractionResults) -> str:
    """State whether differences between conditions depend on the group, by the test of all groups and conditions.

    ``opening`` is the beginning of the sentence, which names the measure.
    """
    if test.reason:
        return f"{opening}: not tested ({test.reason})."
    sizes = ", ".join(f"{n} in {group}" for n, group in zip(test.n, interaction.groups, strict=True))
    verdict = "depend" if test.p < ALPHA else "are not shown to depend"
    size = ""
    if not math.isnan(test.effect.estimate):
        share = format_number(test.effect.estimate, 2)
        bounds = format_interval(test.effect.interval, 2)
        size = f"; the group explains an estimated {share} of their variance, 90 % interval {bounds}"
    p = f"permutation p {format_p_value(test.p)}"
    return f"{opening}: differences between conditions {verdict} on the group ({p}{size}; {sizes})."


def _summarise_contrasts(opening: str, interaction: InteractionResults) -> str:
    """State in how many comparisons the difference between conditions depends on the group, and in which.

    ``opening`` is the beginning of the sentence, which names the measure.
    """
    comparisons = interaction.headline
    significant = [compared for compared in comparisons if compared.groups.p_holm < ALPHA]
    kind = "ratio" if any(compared.groups.is_log for compared in comparisons) else "difference"
    sizes = {group: n for compared in comparisons for group, n in _list_sizes(compared)}
    of_groups = ", ".join(f"{n} in {group}" for group, n in sizes.items())
    key = f"in brackets 95 % intervals; p by permutation, after Holm; {of_groups}"
    n = len(comparisons)
    if not significant:
        verdict = f"in none of {n} comparisons is a {kind} between conditions shown to depend on the group"
        return f"{opening}: {verdict} ({key})."
    larger = "; ".join(f"{name_contrast(compared)} is {_name_larger(compared.groups)}" for compared in significant)
    verdict = f"in {len(significant)} of {n} comparisons a {kind} between conditions depends on the group"
    return f"{opening}: {verdict}: {larger} ({key})."


def _list_sizes(compared: ContrastComparison) -> Iterator[tuple[str, int]]:
    """Yield both groups of a comparison, each with its number of participants."""
    yield compared.groups.first, compared.groups.n[0]
    yield compared.groups.second, compared.groups.n[1]


def _state_pairs(comparisons: Sequence[ContrastComparison]) -> str:
    """State how much each pair of groups differs on the one contrast of the comparisons, or why it is not compared."""
    return f"{name_contrast(comparisons[0])}: {'; '.join(_state_pair(compared.groups) for compared in comparisons)}."


def _state_pair(groups: GroupComparison) -> str:
    """State how much two groups differ on a contrast, or why they are not compared, as a part of a sentence."""
    pair = format_pair(groups.first, groups.second, is_log=groups.is_log)
    if groups.reason and math.isnan(groups.p):
        return f"{pair} not compared ({groups.reason})"
    estimate = format_difference(groups.difference, groups.interval, is_log=groups.is_log, sign="+")
    return f"{pair} {estimate}, p {format_p_value(groups.p_holm)}"


def name_contrast(compared: ContrastComparison) -> str:
    """Return the name of a contrast; a contrast of logarithms is written as a ratio, "a / b" instead of "a - b"."""
    if compared.groups.is_log:
        return compared.contrast.replace(" \N{MINUS SIGN} ", " / ")
    return compared.contrast


def _state_contrast(opening: str, compared: ContrastComparison) -> str:
    """State how much two groups differ on a contrast, or why they are not compared, after the words ``opening``."""
    groups = compared.groups
    subject = f"{opening}: {name_contrast(compared)}, {format_pair(groups.first, groups.second, is_log=groups.is_log)}"
    if groups.reason and math.isnan(groups.p):
        return f"{subject}: not compared ({groups.reason})."
    estimate = format_difference(groups.difference, (math.nan, math.nan), is_log=groups.is_log, sign="+")
    interval = state_interval(groups.interval, is_log=groups.is_log)
    if groups.is_log:
        interval = f"ratio of ratios, {interval}"
    p = f"permutation {state_p(groups.p, groups.smallest_p)}"
    size = ""
    if not math.isnan(groups.g):
        size = f"; standardised g {format_number(groups.g, 2)}, interval {format_interval(groups.g_interval, 2)}"
    n = f"{groups.n[0]} and {groups.n[1]} participants"
    caution = f" With care: {groups.caution}." if groups.caution else ""
    return f"{subject} is {estimate} ({interval}; {p}{size}; {n}).{caution}{_state_verdict(groups)}"


def _state_verdict(groups: GroupComparison) -> str:
    """State in which group the difference between conditions is larger, or that it is not shown to differ."""
    size = "ratio" if groups.is_log else "difference"
    if groups.p >= ALPHA:
        return f" The {size} between conditions is not shown to depend on the group."
    return f" The {size} between conditions is {_name_larger(groups)}."


def _name_larger(groups: GroupComparison) -> str:
    """Return the words for the group in which the difference between conditions is larger."""
    larger, smaller = (groups.first, groups.second) if groups.difference > 0 else (groups.second, groups.first)
    return f"larger in {larger} than in {smaller}"


def interaction_table(interaction: InteractionResults) -> Table:
    """Tabulate the interaction for every measure: the omnibus test, then each contrast between each pair of groups."""
    rows: list[tuple[str, ...]] = []
    for measure in interaction.roles:
        start = (label_measure(measure), interaction.roles[measure])
        rows += [
            (*start, *_list_omnibus_cells(omnibus)) for omnibus in interaction.omnibus if omnibus.measure == measure
        ]
        rows += [
            (*start, *_list_contrast_cells(compared))
            for compared in interaction.contrasts
            if compared.groups.measure == measure
        ]
    effect = "g"
    if interaction.omnibus:
        effect = "g; W: \N{GREEK SMALL LETTER OMEGA}\N{SUPERSCRIPT TWO}"
    heads = ("measure", "named before", "contrast", "groups", "n", "difference", "p", "p (Holm)", effect)
    return Table(heads, rows, words=4)


def _list_omnibus_cells(omnibus: OmnibusInteraction) -> tuple[str, ...]:
    test = omnibus.test
    return (
        "all",
        "all",
        ", ".join(map(str, test.n)),
        f"W({test.freedom}) = {format_number(test.statistic)}",
        format_p_value(test.p),
        format_p_value(omnibus.p_holm),
        format_explained_variance(test.effect),
    )


def _list_contrast_cells(compared: ContrastComparison) -> tuple[str, ...]:
    groups = compared.groups
    return (
        name_contrast(compared),
        format_pair(groups.first, groups.second, is_log=groups.is_log),
        f"{groups.n[0]}, {groups.n[1]}",
        format_difference(groups.difference, groups.interval, is_log=groups.is_log),
        format_p_value(groups.p),
        format_p_value(groups.p_holm),
        format_with_interval(groups.g, groups.g_interval, 2),
    )


def cells_table(interaction: InteractionResults) -> Table:
    """Tabulate the mean and SD over participants of ``interaction.measure``, by group and condition."""
    rows = []
    for group in interaction.groups:
        values = _select_group(interaction.cells, group)
        rows.append((group, *(_format_cell(values[condition]) for condition in interaction.conditions)))
    return Table(("group", *interaction.conditions), rows)


def _format_cell(values: "pd.Series[float]") -> str:
    mean = format_number(float(values.mean()))
    sd = format_number(float(values.std()))
    return f"{mean} ({sd}), n {int(values.notna().sum())}"
