"""Plans of keyboard checks."""

from minihuman.experiment.plan.session_plan import PartPlan


class KeyboardCheckPlan(PartPlan, frozen=True):
    """The keys that a keyboard check asks for."""

    keys: tuple[str, ...]

    @property
    def is_repeated_on_resume(self) -> bool:
        """Return whether a resumed session repeats the check; true, since the keyboard may be a different one."""
        return True
