"""Plans of corrections."""

import msgspec


class CorrectionPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``plan`` of an activity of kind "correction"."""

    source: str  # the block of this session whose episodes are looked at
    episodes: int = 3  # the latest of them
    steps: int = 20  # that a correction has at most
    back: str = "comma"
    forward: str = "period"
    begin: str = "space"  # begins a correction at the step that is seen, and ends it
