"""Plans of corrections."""

from collections.abc import Container
from typing import ClassVar

from minihuman.activities.agent_blocks.plan import AGENT_HOST
from minihuman.experiment.plan.session_plan import PartPlan


class CorrectionPlan(PartPlan, frozen=True, forbid_unknown_fields=True):
    """The plan of an activity of kind "correction"."""

    host: ClassVar[str] = AGENT_HOST
    source: str  # the block of this session whose episodes are looked at
    episodes: int = 3  # the latest of them
    steps: int = 20  # that a correction has at most
    back: str = "comma"
    forward: str = "period"
    begin: str = "space"  # begins a correction at the step that is seen, and ends it

    @property
    def needs_learner(self) -> bool:
        """Return whether a learner chooses the episodes; always false."""
        return False

    def plays_policy_file(self, files: Container[str]) -> bool:
        """Return whether a policy plays in the part; always false."""
        return False
