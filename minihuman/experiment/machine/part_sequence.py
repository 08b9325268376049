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
    """Return the parts of a plan in order; for a plan of an earlier version without parts, let the kinds find them."""
    if plan.parts:
        return plan.parts
    kinds = [find_kind(name) for name in list_built_in_kinds()]
    placed = [part for kind in kinds if kind.find_early_parts is not None for part in kind.find_early_parts(plan)]
    return tuple(part for _, part in sorted(placed, key=itemgetter(0)))


def list_remaining_parts(plan: SessionPlan, parts: Sequence[PlannedPart]) -> list[int]:
    """Return the indices of the parts still to do, in order; empty if all are done.

    A resumed session begins with the parts that every segment repeats, such as the keyboard check.
    """
    left = [number for number in range(len(parts)) if not _is_done(number, parts[number], plan)]
    new = [parts[number] for number in left if not _is_repeated(parts[number])]
    only_closing = all(_closes_session(part) for part in new)
    if only_closing and not (new and plan.standing.part):
        return []
    return left


def is_only_closing_left(parts: Sequence[PlannedPart], begin: int) -> bool:
    """Return whether all parts from an index on are closing pages."""
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
    """Return whether earlier segments of a session have completed a part."""
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
        """Return the index of the part that follows the part that has ended; None if the session ends.

        A part that ended with a jump back first puts the parts from there on into the sequence again.
        """
        ended = self.part.ended
        assert ended is not None
        if ended.reason is not None:
            return None
        if ended.back_to is not None:
            self._to_do = [*range(ended.back_to, len(self._parts))]
        if self._to_do:
            return self._to_do[0]
        return None

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
        """Log the end of the running part and return how it ended; None if it is still running."""
        ended = self.part.ended
        if ended is not None:
            following = self.next_part
            if self._context.plan.parts:
                past = len(self._parts) if following is None else following
                self._context.emit(PartEnded(self._context.now_ns, self.part.number, ended.end, past))
        return ended

    def stop(self) -> None:
        """Stop the running part, if one has begun, because the session ends."""
        if self.has_begun:
            self.part.stop()
