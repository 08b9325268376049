"""The sequence of a block's episodes: the next episode, the last one's points, and the reason why no other follows."""

from minihuman.activities.play.design import BlockDesign
from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.play.tally import BlockTally
from minihuman.experiment.machine.activity import PartEnding, SessionContext
from minihuman.experiment.machine.events import EpisodesSkipped, Scored, SkipReason
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.session_plan import EpisodePlan, PlannedPart


class EpisodeSequence:
    """The sequence of one block's episodes; it counts episodes and does not play them.

    Args:
        number: the part's index in the plan.
        part: the part, with its kind, name and plan.
        context: the session, whose index of the next episode is advanced and which receives the events.
    """

    def __init__(self, number: int, part: PlannedPart, context: SessionContext) -> None:
        self._plan: PlayPlan = part.plan
        self._number = number
        self._part_name = part.name
        self._context = context
        self._tally = BlockTally(self._plan)
        self._design = BlockDesign(self._plan.design, number, part.name, context) if self._plan.design else None

    @property
    def has_next(self) -> bool:
        """Return whether another episode of the block follows."""
        return self._tally.has_next(self._context.next_episode)

    @property
    def next_plan(self) -> EpisodePlan:
        """Return the plan of the next episode, resolved by the block's design if it has one."""
        plan = self._context.plan.episodes[self._context.next_episode]
        if self._design is None:
            return plan
        return self._design.resolve(plan)

    @property
    def interval_ms(self) -> float:
        """Return how long the screen is empty before the next episode, in milliseconds."""
        intervals_ms = self._plan.trial.intervals_ms if self._plan.trial else ()
        episode_in_block = self._context.next_episode - self._plan.first
        if episode_in_block < len(intervals_ms):  # after the last episode there is no interval
            return intervals_ms[episode_in_block]
        return self._plan.interval_ms

    @property
    def last_points(self) -> float:
        """Return the points that the last episode earned."""
        return self._tally.scored

    def resume(self) -> None:
        """Take over the episodes that an earlier segment played, if the session resumes within this block."""
        standing = self._context.plan.standing
        if self._number == standing.part and self._context.next_episode == self._context.plan.first_episode:
            self._tally.outcomes += standing.outcomes
            if self._design is not None:
                self._design.history += standing.history or ()

    def add_episode(self, play: RunningEpisode) -> None:
        """Count a finished episode, log its points, and advance to the next."""
        context = self._context
        points = self._tally.add_episode(play)
        if points is not None:
            context.points += points
            context.emit(Scored(context.now_ns, play.plan.episode, points, context.points))
        context.next_episode += 1
        context.completed += 1
        if self._design is not None:
            self._design.add_episode(play)

    def decide(self, *, time_is_up: bool) -> None:
        """Decide whether another episode follows; a block's design decides on its options, or ends the block.

        ``time_is_up`` says that the block's playing time is used up.
        """
        self._tally.decide(time_is_up=time_is_up)
        if self._design is None:
            return
        was_completed_before = not self.has_next and not self._design.history
        if not was_completed_before and self._design.decide(goes_on=self.has_next):
            self.stop("design")

    def stop(self, reason: SkipReason) -> None:
        """End the sequence for a reason that is logged with the skipped episodes."""
        self._tally.skip = reason

    def end(self) -> PartEnding:
        """Log the episodes that were skipped and return how the block ended."""
        context = self._context
        end_episode = self._plan.first + self._plan.count  # the index after the block's last episode
        skip = self._tally.skip
        if skip is not None and context.next_episode < end_episode:
            n_skipped = end_episode - context.next_episode
            context.emit(EpisodesSkipped(context.now_ns, context.next_episode, n_skipped, skip))
            context.next_episode = end_episode
        if self._tally.failed:
            return PartEnding("failed", reason="screened_out", detail=f"{self._part_name}: criterion not reached")
        return PartEnding()
