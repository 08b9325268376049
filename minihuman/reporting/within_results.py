"""Conditions compared within participants: blocks, or the levels of a label of trials."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import msgspec
import pandas as pd

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import Contrast, ExperimentDesign
from minihuman.reporting.block_measures import (
    MEASURES,
    Role,
    assign_roles,
    list_default_measures,
    take_logarithms,
)
from minihuman.reporting.study_measures import load_trial_measures
from minihuman.statistics.paired import CrossoverTerm, PairedComparison, compare_conditions, fit_crossover
from minihuman.statistics.units import find_units, name_units


@dataclass(frozen=True, slots=True, eq=False)
class WithinResults:
    """The results of comparing conditions within participants, with one value per participant and condition."""

    conditions: tuple[str, ...]
    comparisons: tuple[PairedComparison, ...]
    effects: tuple[CrossoverTerm, ...]  # of order, where it differs between participants
    roles: Mapping[str, Role]
    cells: pd.DataFrame  # of the first measure: index participant, a column per condition, times in their unit
    label: str = ""  # of trials, whose levels the conditions are; "" where they are blocks

    @property
    def measure(self) -> str:
        """Return the primary measure, or the first measure that has values; "" if there is none."""
        return _find_main_measure(self.roles)

    @property
    def headline(self) -> tuple[PairedComparison, ...]:
        """Return the comparisons on the primary measure, or on the first measure that has values."""
        return tuple(comparison for comparison in self.comparisons if comparison.measure == self.measure)


def _find_main_measure(roles: Mapping[str, Role]) -> str:
    """Return the primary measure, or the first measure; "" if there is none."""
    return min(roles, key=lambda name: roles[name] != "primary", default="")


def unite_teams(rows: pd.DataFrame, teams: pd.DataFrame | None) -> pd.DataFrame:
    """Return the rows with the members of each team replaced by the team, in blocks that people played together."""
    if teams is None or teams.empty:
        return rows
    parts = [
        name_units(part, find_units(teams[teams["block"] == block]))
        for block, part in rows.groupby("block", sort=False)
    ]
    return pd.concat(parts).loc[rows.index]


def name_conditions(
    rows: pd.DataFrame, analysis: AnalysisSpec, design: ExperimentDesign
) -> tuple[pd.DataFrame, AnalysisSpec]:
    """Return the rows and the analysis with each block replaced by its condition, if the design has conditions."""
    if not design.conditions:
        return rows, analysis
    condition_rows = rows.assign(block=rows["block"].replace(dict(design.condition_of_block)))
    return condition_rows, msgspec.structs.replace(analysis, conditions=design.conditions)


def compare_within(
    rows: pd.DataFrame, analysis: AnalysisSpec, contrasts: Sequence[Contrast] = (), *, has_order: bool = True
) -> WithinResults | None:
    """Compare the protocol's conditions within participants; None if it names none.

    The measures are the primary and the secondary ones or, if the protocol names none, all that have values; p values
    are corrected within each role (Holm). A participant's value in a condition is the mean over sessions.

    Args:
        rows: the included rows of the table of blocks, with the condition in the column ``block``.
        analysis: the planned analysis, which names the conditions and the measures.
        contrasts: the contrasts to test; without them, each pair of conditions is compared.
        has_order: whether to test effects of position and carry-over, in the order of the first session. False if
            conditions alternate within a block.
    """
    if not analysis.conditions:
        return None
    rows = rows.reset_index(drop=True)
    positions = rows.groupby(["participant", "session"], sort=False).cumcount()
    condition_rows = rows.assign(place=positions)[rows["block"].isin(analysis.conditions)]
    named_measures = [name for name in (analysis.primary_measure, *analysis.secondary_measures) if name]
    candidates = named_measures or list_default_measures(condition_rows)
    measured = [name for name in candidates if condition_rows[name].notna().any()]
    scaled, logs = take_logarithms(condition_rows, measured)
    roles = assign_roles(measured, analysis)
    tables = {
        name: scaled.pivot_table(name, "participant", "block").reindex(columns=list(analysis.conditions))
        for name in measured
    }
    weights = {contrast.name: dict(contrast.weights) for contrast in contrasts}
    comparisons: list[PairedComparison] = []
    for role in get_args(Role):
        tables_of_role = {name: tables[name] for name in roles if roles[name] == role}
        comparisons += compare_conditions(tables_of_role, log_measures=logs, contrasts=weights)
    effects: tuple[CrossoverTerm, ...] = ()
    if has_order:
        effects = _test_order_effects(scaled, measured)
    return WithinResults(
        analysis.conditions, tuple(comparisons), effects, roles, _tabulate_cells(condition_rows, roles, analysis)
    )


def _tabulate_cells(rows: pd.DataFrame, roles: Mapping[str, Role], analysis: AnalysisSpec) -> pd.DataFrame:
    """Tabulate the primary measure, or the first one, with a row per participant and a column per condition."""
    measure = _find_main_measure(roles)
    if not measure:
        return pd.DataFrame(columns=list(analysis.conditions), dtype=float)
    return rows.pivot_table(measure, "participant", "block").reindex(columns=list(analysis.conditions))


def _test_order_effects(scaled: pd.DataFrame, measures: Sequence[str]) -> tuple[CrossoverTerm, ...]:
    """Test position and carry-over in the first session of each condition; no test if the order is always the same.

    ``scaled`` has a row per participant, session and condition, with the row's position in the session as ``place``.
    """
    first = scaled.sort_values(["session", "place"]).drop_duplicates(["participant", "block"]).sort_values("place")
    order = first.groupby("participant", sort=False)
    first = first.assign(position=order.cumcount() + 1, before=order["block"].shift().fillna(""))
    if not first.groupby("block")["position"].nunique().max() > 1:
        return ()
    terms: list[CrossoverTerm] = []
    for name in measures:
        terms += fit_crossover(name, first.rename(columns={"block": "condition", name: "value"}))
    return tuple(terms)


def compare_labels(
    episodes: pd.DataFrame,
    analysis: AnalysisSpec,
    trial_levels: pd.DataFrame | None = None,
    contrasts: Sequence[Contrast] = (),
) -> WithinResults | None:
    """Compare the levels of a trial label within participants, over the included trials that have the label.

    A participant's value at a level is the mean over trials, or the median over trials for response times. For a
    measure of trials it is the value from the section on trials, averaged over blocks.

    Args:
        episodes: the included episodes.
        analysis: the planned analysis, which names the label and the measures.
        trial_levels: the measures of trials, with a row per participant, session, block, label and level.
        contrasts: the contrasts to test; without them, each pair of levels is compared.

    Returns:
        The results; None if the episodes have fewer than two levels of the label.
    """
    label = analysis.condition_label
    measured = measure_levels(episodes, label, trial_levels)
    conditions = tuple(sorted(measured["block"].unique()))
    if len(conditions) < 2:
        return None
    level_analysis = msgspec.structs.replace(select_measures(analysis, measured), conditions=conditions)
    within = compare_within(measured, level_analysis, contrasts, has_order=False)
    if within is None:
        return None
    return replace(within, label=label)


def select_measures(analysis: AnalysisSpec, rows: pd.DataFrame) -> AnalysisSpec:
    """Return an analysis of only those planned measures that are columns of the rows."""
    primary_measure = ""
    if analysis.primary_measure in rows:
        primary_measure = analysis.primary_measure
    secondary_measures = tuple(name for name in analysis.secondary_measures if name in rows)
    return AnalysisSpec(primary_measure=primary_measure, secondary_measures=secondary_measures)


def measure_levels(episodes: pd.DataFrame, label: str, trial_levels: pd.DataFrame | None = None) -> pd.DataFrame:
    """Compute each participant's measures at each level of a label; the level is in the column ``block``.

    With ``trial_levels``, the measures of trials by level, these are added as columns ``trials:NAME``.
    """
    levels = read_label(episodes, label)
    rows = episodes.assign(block=levels)[levels != ""]
    keys = ["group", "participant", "session", "block"]
    rows = rows.assign(success=pd.to_numeric(rows["success"]))
    values = rows.groupby(keys, sort=False).agg(
        success=("success", "mean"), reward_mean=("reward", "mean"), response_median_ms=("response_median_ms", "median")
    )
    measured = values.reindex(columns=list(MEASURES)).reset_index()
    if trial_levels is not None:
        label_rows = trial_levels[trial_levels["label"].eq(label)].drop(columns=["block"])
        names = {name: f"trials:{name}" for name in load_trial_measures()}
        label_rows = label_rows.rename(columns={"level": "block", **names})
        trial_keys = keys[1:]
        means = label_rows.groupby(trial_keys)[list(names.values())].mean()
        measured = measured.merge(means.reset_index(), on=trial_keys, how="left")
    return measured


def read_label(episodes: pd.DataFrame, label: str) -> "pd.Series[str]":
    """Return each episode's level of a label as text; "" if it has none."""
    return episodes["labels"].map(lambda text: str(json.loads(text or "{}").get(label, "")), na_action=None)
