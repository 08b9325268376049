"""The course of a session: its parts in their order, the one that runs, the one that follows. No pause or question."""

from minihuman.errors import AllocationError
from minihuman.study.activities.port import Activity, Ended
from minihuman.study.activities.registry import activity_of
from minihuman.study.events import PartEnded, PartStarted
from minihuman.study.parts import first_part, parts_of
from minihuman.study.stage import Stage


class Course:
    """Which part runs, and which are still to be done.

    Args:
        stage: the session around the parts; what begins and ends is said there.

    Raises:
        AllocationError: if the plan has no part left.
    """

    def __init__(self, stage: Stage) -> None:
        plan = stage.plan
        self._stage = stage
        self._parts = parts_of(plan)
        self._to_do = first_part(plan, self._parts)
        self._running: Activity | None = None
        if not self._to_do:
            raise AllocationError(
                f"{plan.participant.id} has played all {len(plan.episodes)} episodes of session {plan.session}; "
                "nothing is left to play"
            )

    @property
    def part(self) -> Activity:
        """The part that runs."""
        assert self._running is not None, "the session has not begun"
        return self._running

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
        if self._stage.plan.parts:  # older logs have no word of parts
            self._stage.say(PartStarted(self._stage.now_ns, number, part.kind, part.name))
        self._running = activity_of(number, part, self._stage)
        self._running.begin()

    def leave(self) -> Ended | None:
        """How the part ended, which is said; None while it goes on."""
        ended = self.part.ended
        if ended is not None:
            following = self.next_part
            if self._stage.plan.parts:
                past = len(self._parts) if following is None else following
                self._stage.say(PartEnded(self._stage.now_ns, self.part.number, ended.end, past))
        return ended

    def stop(self) -> None:
        """The session ends in the middle of a part, or before the first."""
        if self._running is not None:
            self._running.stop()
