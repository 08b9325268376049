"""The `[analysis]` table of a protocol: the study's measures and the comparisons of them."""

import re
from collections.abc import Iterator

import msgspec

from minihuman.experiment.protocol.validation_errors import FieldError

_NAMED_MEASURE = re.compile(r"[a-z][a-z0-9_-]*:.+")  # an answer's, of teaching, or of a lab's own package

# The measures on which groups can be compared: columns of the table "blocks", one number per participant.
COMPARABLE_MEASURES = (
    *("log_excess_steps_mean", "spl_mean", "success", "reward_mean", "steps_at_limit_mean", "excess_steps_mean"),
    *("reward_first", "reward_slope", "playing_s_mean", "response_median_ms", "path_efficiency_mean"),
    *("ineffective_share", "all_keys_discovered_s", "log_steps_ratio_mean", "reaction_median_ms"),
)


class AnalysisSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The study's measures, and how close two groups must be to count as equivalent."""

    primary_measure: str = ""  # the measure that is tested without correction; "" to correct all measures together
    secondary_measures: tuple[str, ...] = ()  # corrected together for multiple comparisons
    equivalence_margin: float | None = None  # groups whose primary measures differ by less than this are alike
    block: str = ""  # the block in which groups are compared; "" for the last block that all groups play
    conditions: tuple[str, ...] = ()  # compared within participants: blocks, or the levels of "label:NAME"
    covariates: tuple[str, ...] = ()  # for which a second comparison of the primary measure is adjusted

    @property
    def condition_label(self) -> str:
        """Return the label of trials whose levels are the conditions; "" if blocks are the conditions."""
        if len(self.conditions) == 1 and self.conditions[0].startswith("label:"):
            return self.conditions[0].removeprefix("label:")
        return ""

    def find_plugin_measures(self) -> tuple[str, ...]:
        """Return the measures and covariates that are not columns of the table of blocks ("answer:NAME"), each once."""
        named = (self.primary_measure, *self.secondary_measures, *self.covariates)
        return tuple(dict.fromkeys(name for name in named if ":" in name))


def check_analysis(
    analysis: AnalysisSpec, blocks: tuple[str, ...], *, practice: tuple[str, ...] = ()
) -> Iterator[FieldError]:
    """Yield an error for each value of the table [analysis] that has the right type but is not valid.

    Args:
        analysis: the table [analysis].
        blocks: the names of the study's blocks.
        practice: the names of its blocks with ``analysed = false``, in which groups cannot be compared.
    """
    yield from _check_measures(analysis)
    yield from _check_conditions(analysis, blocks)
    yield from _check_margin(analysis)
    block = analysis.block
    if block and block not in blocks:
        yield "$.analysis.block", f"is {block!r}, which is not a block; blocks: {', '.join(blocks)}"
    if block in practice:
        yield "$.analysis.block", f"is {block!r}, which has analysed = false; name another block"


def _check_measures(analysis: AnalysisSpec) -> Iterator[FieldError]:
    primary = analysis.primary_measure
    measures_by_field = {
        "primary_measure": (primary,) if primary else (),
        "secondary_measures": analysis.secondary_measures,
        "covariates": analysis.covariates,
    }
    for field, names in measures_by_field.items():
        for name in names:
            if name and name not in COMPARABLE_MEASURES and not _NAMED_MEASURE.fullmatch(name):
                measures = ", ".join(COMPARABLE_MEASURES)
                yield f"$.analysis.{field}", f"is {name!r}, which is not a measure; there are {measures}"
    if analysis.covariates and not primary:
        yield "$.analysis.covariates", "adjust the primary measure; name one"
    if primary and primary in analysis.secondary_measures:
        yield "$.analysis.secondary_measures", f"names {primary!r}, which is the primary measure already"


def _check_conditions(analysis: AnalysisSpec, blocks: tuple[str, ...]) -> Iterator[FieldError]:
    if analysis.condition_label:
        return
    conditions = analysis.conditions
    for name in conditions:
        if name not in blocks:
            yield "$.analysis.conditions", f"has {name!r}, which is not a block; blocks: {', '.join(blocks)}"
    if len(conditions) == 1 or len(set(conditions)) < len(conditions):
        yield (
            "$.analysis.conditions",
            "compares blocks with each other; name two or more, each once, or one label as 'label:NAME'",
        )


def _check_margin(analysis: AnalysisSpec) -> Iterator[FieldError]:
    margin = analysis.equivalence_margin
    if margin is None:
        return
    if not margin > 0:
        yield "$.analysis.equivalence_margin", f"is {margin}; groups are alike within more than 0"
    if not analysis.primary_measure:
        yield "$.analysis.equivalence_margin", "is of the primary measure; name one"
