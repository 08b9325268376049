"""The question that a study asks, worded for its report, and the reason if nothing can be compared."""

from collections.abc import Iterator, Sequence

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign
from minihuman.reporting.block_measures import phrase_measure
from minihuman.reporting.interactions import InteractionResults
from minihuman.reporting.results import Results


def ask_question(
    analysis: AnalysisSpec,
    results: Results,
    design: ExperimentDesign | None = None,
    interaction: InteractionResults | None = None,
) -> str:
    """State what the study compares, or why nothing is compared, after the question that the protocol asks, if any."""
    own_question = ""
    if design and design.question:
        own_question = f"{design.question} "
    if analysis.primary_measure:
        measure = phrase_measure(analysis.primary_measure)
    else:
        measure = "every measure"
    if design and interaction and design.primary_effect == "interaction":
        conditions = f"conditions {join_names(interaction.conditions)}"
        if design.condition_label:
            conditions = f"levels {join_names(interaction.conditions)} of {design.condition_label}"
        groups = join_names(interaction.groups)
        is_log = any(compared.groups.is_log for compared in interaction.headline)
        differences = f"{'ratios of' if is_log else 'differences in'} {measure} between {conditions}"
        return f"{own_question}Asked: whether {differences} depend on the group ({groups})."
    comparisons = ", and ".join(_phrase_comparisons(results))
    if not comparisons:
        return own_question + _explain_no_comparison(results, design)
    return f"{own_question}Asked: differences in {measure} {comparisons}."


def _phrase_comparisons(results: Results) -> Iterator[str]:
    """Yield a phrase for the groups that the study compares, if any, and one for the conditions."""
    if results.target_block is not None:
        groups = results.target_block.groups["group"].tolist()
        if len(groups) > 1:
            over_sessions = ""
            if results.target_block.changes_compared:
                over_sessions = ", over the sessions and in the change between them"
            yield f"between groups {join_names(groups)} in block {results.target}{over_sessions}"
    if results.within is None:
        return
    conditions = join_names(results.within.conditions)
    if results.within.label:
        yield f"within participants between levels {conditions} of {results.within.label}"
    elif results.within.conditions:
        yield f"within participants between blocks {conditions}"


def _explain_no_comparison(results: Results, design: ExperimentDesign | None) -> str:
    """Explain why nothing is compared: the plan has one group, or too few participants are included."""
    if not results.included[0]:
        return "Nobody is included: nothing is compared."
    planned_groups: Sequence[str] = results.order  # including groups whose participants are all excluded
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
    """Join one or more names into a list for a sentence, with "and" before the last."""
    if len(names) > 1:
        return f"{', '.join(names[:-1])} and {names[-1]}"
    return names[0]
