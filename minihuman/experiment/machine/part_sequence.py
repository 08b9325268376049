"""The sequence of a session's parts: the running part, the remaining ones, and the one that comes next.

Pauses and questions are handled elsewhere. No kind of part is known by name: a part's plan states what the session
needs to know about it.
"""

from collections.abc import Sequence
from operator import itemgetter

from minihuman.errors import AllocationError
from minihuman.experiment.machine.activity import (
    Activity,
    PartEnding,
    SessionContext,
    build_activity,
    find_kind,
    list_built_in_kinds,
)
from minihuman.experiment.machine.events import PartEnded, PartStarted
from minihuman.experiment.plan.session_plan import PartPlan, PlannedPart, SessionPlan


def list_parts(plan: SessionPlan) -> tuple[PlannedPart, ...]:
    """Return the parts of a plan in order.

    A plan of an earlier version has no parts; they are derived by the built-in kinds from the plan's older fields.
    """
    if plan.parts:
        return plan.parts
    positioned_parts: list[tuple[int, PlannedPart]] = []
    for name in list_built_in_kinds():
        find_early_parts = find_kind(name).find_early_parts
        if find_early_parts is not None:
            positioned_parts += find_early_parts(plan)
    return tuple(part for _, part in sorted(positioned_parts, key=itemgetter(0)))


def list_remaining_parts(plan: SessionPlan, parts: Sequence[PlannedPart]) -> list[int]:
    """Return the indices of the parts still to do, in order; empty if all are done.

    A resumed session begins with the parts that every segment repeats, such as the keyboard check. If nothing but the
    closing text would follow them, the session counts as done, unless it was interrupted at the closing text.
    """
    remaining = [number for number in range(len(parts)) if not _is_done(number, parts[number], plan)]
    not_repeated = [parts[number] for number in remaining if not _is_repeated(parts[number])]
    has_only_closing = all(_closes_session(part) for part in not_repeated)
    if has_only_closing and not (not_repeated and plan.standing.part):
        return []
    return remaining


def is_only_closing_left(parts: Sequence[PlannedPart], begin: int) -> bool:
    """Return whether all parts from index ``begin`` on are closing texts; True if there is no part."""
    return all(_closes_session(part) for part in parts[begin:])


def asks_consent_before_play(plan: SessionPlan) -> bool:
    """Return whether a session asks for consent before any play; a resumed session does not."""
    if plan.segment > 1:
        return False
    parts = list_parts(plan)
    for number in list_remaining_parts(plan, parts):
        part_plan = parts[number].plan
        if not isinstance(part_plan, PartPlan):
            continue
        if part_plan.planned_episodes is not None:
            return False
        if part_plan.asks_consent:
            return True
    return False


def _is_done(number: int, part: PlannedPart, plan: SessionPlan) -> bool:
    """Return whether earlier segments of a session have completed a part; ``number`` is its index.

    Parts before ``plan.standing.part`` are done; if that is 0, ``plan.first_episode`` shows which parts are done.
    """
    if _is_repeated(part):
        return False
    if number < plan.standing.part:
        return True
    if not isinstance(part.plan, PartPlan):
        return False
    if part.plan.planned_episodes is not None:
        return plan.first_episode >= part.plan.planned_episodes.stop
    return plan.first_episode > 0 and not plan.standing.part and part.plan.asks_consent


def _is_repeated(part: PlannedPart) -> bool:
    return isinstance(part.plan, PartPlan) and part.plan.is_repeated_on_resume


def _closes_session(part: PlannedPart) -> bool:
    return isinstance(part.plan, PartPlan) and part.plan.closes_session


class PartSequence:
    """The running part and the parts that remain.

    Args:
        context: the session's context, which receives the events.

    Raises:
        AllocationError: if the plan has no part left.
    """

    def __init__(self, context: SessionContext) -> None:
        plan = context.plan
        self._context = context
        self._parts = list_parts(plan)
        self._to_do = list_remaining_parts(plan, self._parts)
        self.has_begun = False  # whether any part has begun
        self.part: Activity  # the running part; not set before the first part has begun
        if not self._to_do:
            raise AllocationError(
                f"{plan.participant.id} has completed all {len(plan.episodes)} episodes of session {plan.session}; "
                "choose another session or participant"
            )

    @property
    def next_part(self) -> int | None:
        """Return the index of the part that follows the part that has ended; None if the session ends."""
        part_ending = self.part.ended
        assert part_ending is not None
        if part_ending.reason is not None or not self._to_do:
            return None
        return self._to_do[0]

    def begin(self) -> None:
        """Start the next part, which may end at once."""
        number = self._to_do.pop(0)
        part = self._parts[number]
        if self._context.plan.parts:  # older logs have no parts
            self._context.emit(PartStarted(self._context.now_ns, number, part.kind, part.name))
        self.has_begun = True
        self.part = build_activity(number, part, self._context)
        self.part.begin()

    def finish_part(self) -> PartEnding | None:
        """Log the end of the running part and return how it ended; None if it is still running.

        If the part ended with a jump back, the parts from there on are put into the sequence again.
        """
        part_ending = self.part.ended
        if part_ending is None:
            return None
        if part_ending.reason is None and part_ending.back_to is not None:
            self._to_do = list(range(part_ending.back_to, len(self._parts)))
        if self._context.plan.parts:  # older logs have no parts
            next_part = len(self._parts) if self.next_part is None else self.next_part
            self._context.emit(PartEnded(self._context.now_ns, self.part.number, part_ending.end, next_part))
        return part_ending

    def stop(self) -> None:
        """Stop the running part, if one has begun, because the session ends."""
        if self.has_begun:
            self.part.stop()
