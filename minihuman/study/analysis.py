"""What a study will be judged by, named before anybody plays: in the protocol, whose hash is in every log."""

import msgspec

# What groups can be compared on: columns of the table "blocks", one value a participant.
MEASURES = (
    *("log_excess_steps_mean", "spl_mean", "success", "reward_mean", "steps_at_limit_mean", "excess_steps_mean"),
    *("reward_first", "reward_slope", "playing_s_mean", "reaction_median_ms", "path_efficiency_mean"),
    *("in_vain_share", "found_all_s", "log_steps_ratio_mean"),
)


class Analysis(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The measures that count, and how near two groups have to be to count as alike."""

    primary: str = ""  # one measure, judged by itself; "": all are corrected together
    secondary: tuple[str, ...] = ()  # corrected together, for how many there are
    equivalence: float | None = None  # groups whose primary measures differ by less than this are alike
    block: str = ""  # that groups are compared on; "": the last that all of them play


def complaints(analysis: Analysis, blocks: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every (path, complaint) about an analysis that cannot be made."""
    found = [
        (f"$.analysis.{field}", f"is {name!r}, which is no measure; there are {', '.join(MEASURES)}")
        for field, names in (("primary", (analysis.primary,)), ("secondary", analysis.secondary))
        for name in names
        if name and name not in MEASURES
    ]
    if analysis.primary in analysis.secondary and analysis.primary:
        found.append(("$.analysis.secondary", f"names {analysis.primary!r}, which is the primary measure already"))
    if analysis.equivalence is not None and not analysis.equivalence > 0:
        found.append(("$.analysis.equivalence", f"is {analysis.equivalence}; groups are alike within more than 0"))
    if analysis.equivalence is not None and not analysis.primary:
        found.append(("$.analysis.equivalence", "is of the primary measure; name one"))
    if analysis.block and analysis.block not in blocks:
        found.append(("$.analysis.block", f"is {analysis.block!r}, which is no block; blocks: {', '.join(blocks)}"))
    return found
