"""The sequence of parts of a session: which part runs, which are left and which comes next. No pauses or questions.

Plans recorded before there were parts are read as consent, keyboard check, blocks and closing.
"""

from collections.abc import Sequence

from minihuman.activities.keyboard_check.plan import KeyboardCheckPlan
from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import PlayPlan
from minihuman.errors import AllocationError
from minihuman.experiment.machine.activity import Activity, PartEnding, SessionContext, build_activity
from minihuman.experiment.machine.events import PartEnded, PartStarted
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan
from minihuman.experiment.words import InterfaceWords

OUTCOMES = ("goal", "timeout", "failure", "abandoned")


def list_parts(plan: SessionPlan) -> tuple[PlannedPart, ...]:
    """The parts in order; those that a plan without any means: consent, keyboard check, block after block, closing."""
    if plan.parts:
        return plan.parts
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    parts: list[PlannedPart] = []
    if plan.consent_text and plan.segment == 1:
        text = plan.consent_text.strip()
        page = PagePlan(words["consent.title"], (text,), agree=True, sha256=plan.consent_sha256)
        parts.append(PlannedPart("page", "consent", page))
    if plan.keyboard_check:
        parts.append(PlannedPart("keyboard_check", "keyboard_check", KeyboardCheckPlan(plan.key_pool)))
    parts += _blocks(plan, words)
    if plan.closing_text:
        page = PagePlan(words["closing.title"], (plan.closing_text.strip(),), closing=True)
        parts.append(PlannedPart("page", "closing", page))
    return tuple(parts)


def _blocks(plan: SessionPlan, words: InterfaceWords) -> list[PlannedPart]:
    count = len(plan.texts)
    parts = []
    for number, text in enumerate(plan.texts):
        its = [episode for episode in plan.episodes if episode.block == number]
        last = number + 1 == count
        play = PlayPlan(
            block=number,
            blocks=count,
            first=its[0].episode,
            count=len(its),
            title="" if count < 2 else words.fill("progress.part", part=number + 1, parts=count),
            instruction=(text.instruction.strip(),) if text.instruction else (),
            feedback=dict.fromkeys(OUTCOMES, text.feedback) if text.feedback else {},
            rest="" if last else text.rest,
            rest_s=0.0 if last else text.rest_s,
        )
        parts.append(PlannedPart("play", its[0].block_name, play))
    return parts


def list_remaining_parts(plan: SessionPlan, parts: Sequence[PlannedPart]) -> list[int]:
    """The parts still to do, in order; empty if all are done.

    A resumed session begins with the keyboard check again: the keyboard may be another.
    """
    left = [number for number in range(len(parts)) if not _done(number, parts[number], plan)]
    worth = [number for number in left if parts[number].kind != "keyboard_check"]
    only_closing = all(_is_closing(parts[number]) for number in worth)
    return [] if only_closing and not (worth and plan.standing.part) else left


def is_only_closing_left(parts: Sequence[PlannedPart], begin: int) -> bool:
    """Whether only closing pages are left from a part on."""
    return all(_is_closing(part) for part in parts[begin:])


def asks_consent_before_play(plan: SessionPlan) -> bool:
    """Whether a session asks for consent before any play; a resumed one has it already."""
    if plan.segment > 1:
        return False
    parts = list_parts(plan)
    for number in list_remaining_parts(plan, parts):
        its = parts[number].plan
        if isinstance(its, PlayPlan):
            return False
        if isinstance(its, PagePlan) and its.agree:
            return True
    return False


def _done(number: int, part: PlannedPart, plan: SessionPlan) -> bool:
    if part.kind == "keyboard_check":
        return False
    if number < plan.standing.part:
        return True
    if isinstance(part.plan, PlayPlan):
        return plan.first_episode >= part.plan.first + part.plan.count
    return plan.first_episode > 0 and not plan.standing.part and isinstance(part.plan, PagePlan) and part.plan.agree


def _is_closing(part: PlannedPart) -> bool:
    return isinstance(part.plan, PagePlan) and part.plan.closing


class PartSequence:
    """Which part runs, and which are still to be done.

    Args:
        context: the session, which takes the events.

    Raises:
        AllocationError: if the plan has no part left.
    """

    def __init__(self, context: SessionContext) -> None:
        plan = context.plan
        self._context = context
        self._parts = list_parts(plan)
        self._to_do = list_remaining_parts(plan, self._parts)
        self.begun = False  # whether a part has
        self.part: Activity  # that runs, once one has begun
        if not self._to_do:
            raise AllocationError(
                f"{plan.participant.id} has completed all {len(plan.episodes)} episodes of session {plan.session}; "
                "choose another session or participant"
            )

    @property
    def next_part(self) -> int | None:
        """Index of the part that follows the one that has ended; None where none does."""
        ended = self.part.ended
        assert ended is not None
        if ended.reason is not None:
            return None
        if ended.back_to is not None:
            self._to_do = [*range(ended.back_to, len(self._parts))]
        return self._to_do[0] if self._to_do else None

    def begin(self) -> None:
        """Start the next part; it may be over at once."""
        number = self._to_do.pop(0)
        part = self._parts[number]
        if self._context.plan.parts:  # older logs have no parts
            self._context.emit(PartStarted(self._context.now_ns, number, part.kind, part.name))
        self.begun, self.part = True, build_activity(number, part, self._context)
        self.part.begin()

    def finish_part(self) -> PartEnding | None:
        """How the part ended, after emitting it; None while it runs."""
        ended = self.part.ended
        if ended is not None:
            following = self.next_part
            if self._context.plan.parts:
                past = len(self._parts) if following is None else following
                self._context.emit(PartEnded(self._context.now_ns, self.part.number, ended.end, past))
        return ended

    def stop(self) -> None:
        """The session ends in the middle of a part, or before the first."""
        if self.begun:
            self.part.stop()
