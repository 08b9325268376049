"""The keyboard check in plans that were recorded before plans had parts."""

from collections.abc import Iterator

from minihuman.activities.keyboard_check.plan import KeyboardCheckPlan
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan


def find_early_check(plan: SessionPlan) -> Iterator[tuple[int, PlannedPart]]:
    """Yield the keyboard check of an early plan, with its position in the session."""
    if plan.keyboard_check:
        yield 1, PlannedPart("keyboard_check", "keyboard_check", KeyboardCheckPlan(plan.key_pool))
