"""The keyboard check in plans that were recorded before plans had parts."""

from collections.abc import Iterator

from minihuman.activities.keyboard_check.plan import KeyboardCheckPlan
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan

_POSITION = 1  # of the check in an early session: after the first pages, before the blocks


def find_early_check(plan: SessionPlan) -> Iterator[tuple[int, PlannedPart]]:
    """Yield the keyboard check of a plan from before plans had parts, with its position among the session's parts.

    Yield nothing if the plan has no keyboard check.
    """
    if plan.keyboard_check:
        yield _POSITION, PlannedPart("keyboard_check", "keyboard_check", KeyboardCheckPlan(plan.key_pool))
