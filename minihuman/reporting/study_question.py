"""The question that a study asks, worded for its report, and the reason if nothing can be compared."""

from collections.abc import Sequence

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign
from minihuman.reporting.block_measures import label_measure
from minihuman.reporting.interactions import InteractionResults
from minihuman.reporting.results import Results


def ask_question(
    analysis: AnalysisSpec,
    results: Results,
    design: ExperimentDesign | None = None,
    interaction: InteractionResults | None = None,
) -> str:
    """State in one sentence what the study compares, after the protocol's own question if it has one."""
    stated = ""
    if design and design.question:
        stated = f"{design.question} "
    if analysis.primary_measure:
        measure = label_measure(analysis.primary_measure)
    else:
        measure = "every measure"
    if design and interaction and design.primary_effect == "interaction":
        return (
            f"{stated}Asked: whether differences between conditions {join_names(interaction.conditions)} in {measure} "
            f"depend on the group ({join_names(interaction.groups)})."
        )
    groups: list[str] = []
    if results.target_block is not None:
        groups = results.target_block.groups["group"].tolist()
    conditions: Sequence[str] = ()
    if results.within is not None:
        conditions = results.within.conditions
    parts = []
    if len(groups) > 1:
        parts.append(f"groups {join_names(groups)} in block {results.target}")
    if results.within and results.within.label:
        parts.append(f"levels {join_names(conditions)} of {results.within.label} within participants")
    elif conditions:
        parts.append(f"blocks {join_names(conditions)} within participants")
    if not parts:
        return f"{stated}{_explain_no_comparison(results, design)}"
    return f"{stated}Asked: how {', and '.join(parts)} differ in {measure}."


def _explain_no_comparison(results: Results, design: ExperimentDesign | None) -> str:
    """Explain why nothing is compared: the plan has one group, or too few participants are included."""
    if not results.included[0]:
        return "Nobody is included: nothing is compared."
    planned_groups: Sequence[str] = results.order  # those who were excluded too
    if design is not None and design.levels("group"):
        planned_groups = design.levels("group")
    if len(planned_groups) < 2:
        return "One group: nothing is compared between groups."
    groups = f"groups {join_names(planned_groups)}"
    if results.target_block is None:
        return f"No block was played by included participants of all of {groups}: nothing is compared between groups."
    (included_group,) = results.target_block.groups["group"]
    return f"Of {groups} only {included_group} has included participants: nothing is compared between groups."


def join_names(names: Sequence[str]) -> str:
    """Join names into a list for a sentence, with "and" before the last."""
    if len(names) > 1:
        return f"{', '.join(names[:-1])} and {names[-1]}"
    return names[0]
