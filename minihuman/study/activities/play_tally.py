"""How a block's episodes went: their outcomes, what the last was worth, and whether another one is played."""

from collections.abc import Iterable

from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.events import SkipReason
from minihuman.study.play import Play


class Tally:
    """Counts a block's episodes that are over.

    Args:
        plan: the block's.
    """

    def __init__(self, plan: PlayPlan) -> None:
        self._plan = plan
        self._outcomes: list[str] = []  # in order
        self.scored = 0.0  # by the last one
        self.skip: SkipReason | None = None  # why no other episode is played

    def go_on_from(self, outcomes: Iterable[str]) -> None:
        """So they went in segments before this one."""
        self._outcomes = list(outcomes)

    def take(self, play: Play) -> float | None:
        """An episode is over; what it was worth, None in a block without points."""
        assert play.outcome is not None
        self._outcomes.append(play.outcome)
        if self._plan.points is None:
            return None
        self.scored = self._plan.points.of(play.outcome, play.steps, play.return_)
        return self.scored

    def decide(self, *, time_is_up: bool) -> None:
        """Settle whether the block is over before its last episode."""
        until = self._plan.until
        if until is not None and until.met(self._outcomes):
            self.skip = "criterion"
        elif time_is_up:
            self.skip = "time"

    def another(self, next_episode: int) -> bool:
        """Whether the block goes on with that episode."""
        return self.skip is None and next_episode < self._plan.first + self._plan.count

    @property
    def failed(self) -> bool:
        """Whether the block ends the session: its criterion was not reached, and the protocol says so."""
        until = self._plan.until
        return until is not None and not until.met(self._outcomes) and until.otherwise == "end"
