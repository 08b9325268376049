"""Plans of keyboard checks."""

from minihuman.experiment.plan.session_plan import PartPlan


class KeyboardCheckPlan(PartPlan, frozen=True):
    """The keys that are asked for."""

    keys: tuple[str, ...]

    @property
    def is_repeated_on_resume(self) -> bool:
        """Whether it is done again: the keyboard may be another."""
        return True
