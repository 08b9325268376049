"""Plans of comparisons of clips."""

from collections.abc import Container
from typing import ClassVar, Literal

from minihuman.activities.agent_blocks.plan import AGENT_HOST
from minihuman.experiment.plan.session_plan import PartPlan, ShownView
from minihuman.worlds.contract import Palette

PairingPolicy = Literal["random", "disagreement"]  # any pair, or one that an ensemble of reward models disagrees on


class PreferencesPlan(PartPlan, frozen=True, forbid_unknown_fields=True):
    """The plan of an activity of kind "preferences"."""

    host: ClassVar[str] = AGENT_HOST
    source: str  # the block of this session whose episodes are compared
    pairs: int = 20
    steps: int = 12  # of a clip
    step_ms: float = 200.0  # each picture is seen so long
    pairing: PairingPolicy = "random"
    wait_s: float = 15.0  # for a pair that is disagreed on; then any pair comes
    left: str = "f"
    right: str = "j"
    equal: str = "b"
    cannot_tell: str = "n"
    again: str = "r"
    view: ShownView = "partial"
    palette: Palette = "classic"

    @property
    def needs_learner(self) -> bool:
        """Return whether a learner chooses the pairs, by the disagreement about them."""
        return self.pairing == "disagreement"

    def plays_policy_file(self, files: Container[str]) -> bool:
        """Return whether a policy plays in the part; always false."""
        return False
