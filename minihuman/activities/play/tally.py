"""The tally of a block's episodes: their outcomes, their points, and whether another follows."""

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.machine.events import SkipReason
from minihuman.experiment.machine.running_episode import RunningEpisode


class BlockTally:
    """The outcomes and points of a block's finished episodes.

    Args:
        plan: the block's plan.
    """

    def __init__(self, plan: PlayPlan) -> None:
        self._plan = plan
        self.outcomes: list[str] = []  # in order, those of earlier segments first
        self.scored = 0.0  # by the last one
        self.skip: SkipReason | None = None  # why no other episode is played

    def add_episode(self, play: RunningEpisode) -> float | None:
        """Count a finished episode and return its points, or None in a block without points."""
        assert play.outcome is not None
        self.outcomes.append(play.outcome)
        if self._plan.points is None:
            return None
        self.scored = self._plan.points.compute(play.outcome, play.steps, play.return_)
        return self.scored

    def decide(self, *, time_is_up: bool) -> None:
        """Record that the block ends early, if its criterion is met or its playing time is used up (``time_is_up``)."""
        until = self._plan.until
        if until is not None and until.is_met(self.outcomes):
            self.skip = "criterion"
        elif time_is_up:
            self.skip = "time"

    def has_next(self, next_episode: int) -> bool:
        """Return whether the block continues with the episode of the given index."""
        return self.skip is None and next_episode < self._plan.first + self._plan.count

    @property
    def failed(self) -> bool:
        """Return whether the block ends the session because its criterion was not reached."""
        until = self._plan.until
        return until is not None and not until.is_met(self.outcomes) and until.otherwise == "end"
