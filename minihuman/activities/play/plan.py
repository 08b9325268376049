"""Plans of blocks: the episodes, the screens around them, and the conditions under which a block ends."""

from collections.abc import Iterable, Sequence
from typing import Literal

import msgspec

from minihuman.experiment.machine.bindings import Bindings
from minihuman.experiment.plan.designs import DesignSpec
from minihuman.experiment.plan.session_plan import PartPlan


class CriterionSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The criterion that ends practice: a number of successes among the last episodes.

    A block's ``episodes`` is then the largest number of episodes.
    """

    successes: int
    of: int  # the last so many
    otherwise: Literal["go_on", "end"] = "go_on"  # what follows if it is never met

    def is_met(self, outcomes: Sequence[str]) -> bool:
        """Return whether enough of the last ``of`` outcomes, or of all if there are fewer, reached the goal."""
        return sum(outcome == "goal" for outcome in outcomes[-self.of :]) >= self.successes


class PointsSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The points that an episode earns."""

    goal: float = 0.0
    timeout: float = 0.0
    failure: float = 0.0
    per_step: float = 0.0
    per_reward: float = 0.0

    @property
    def needs_success(self) -> bool:
        """Return whether the points depend on how an episode ended."""
        return len({self.goal, self.timeout, self.failure}) > 1

    def compute(self, outcome: str, steps: int, reward: float) -> float:
        """Return the points of an episode; an episode that was abandoned or whose agent failed earns none.

        ``reward`` is the sum of the episode's rewards.
        """
        if outcome in ("abandoned", "agent_failed"):
            return 0.0
        outcome_points = {"goal": self.goal, "timeout": self.timeout, "failure": self.failure}
        return outcome_points.get(outcome, 0.0) + self.per_step * steps + self.per_reward * reward


ComputedBy = Literal["page", "server"]


class PlayPlan(PartPlan, frozen=True):
    """The plan of a block: its episodes and what surrounds them. Empty texts and times of 0 show nothing."""

    block: int  # the place among the session's blocks
    blocks: int  # how many the session has
    first: int  # index of its first episode
    count: int
    title: str = ""
    instruction: tuple[str, ...] = ()  # pages
    feedback: dict[str, str] = msgspec.field(default_factory=dict)  # by outcome
    rest: str = ""  # after the block
    rest_s: float = 0.0  # the shortest rest
    interval_ms: float = 0.0  # nothing on the screen before an episode
    fixation_ms: float = 0.0  # then a cross
    hold_ms: float = 0.0  # the last picture stays
    marks: bool = False  # with a mark for its outcome
    max_s: float = 0.0  # an episode's longest playing time; 0: none
    block_max_s: float = 0.0
    until: CriterionSpec | None = None
    points: PointsSpec | None = None
    show_points: bool = False  # the running total is on the screen
    mission: str = ""  # instead of the world's own words
    computed: ComputedBy | msgspec.UnsetType = msgspec.UNSET  # who steps and draws first in a browser; unset before
    trial: "TrialRules | msgspec.UnsetType" = msgspec.UNSET  # unset where episodes are no trials
    bindings: Bindings | msgspec.UnsetType = msgspec.UNSET  # unset where keys alone act
    motion_ms: float | msgspec.UnsetType = msgspec.UNSET  # from a step's picture to the next; unset: at once
    design: DesignSpec | msgspec.UnsetType = msgspec.UNSET  # that resolves each episode; unset where none does
    pagination: int | msgspec.UnsetType = msgspec.UNSET  # of the instruction: as PagePlan's

    @property
    def planned_episodes(self) -> range:
        """Return the indices of the block's episodes."""
        return range(self.first, self.first + self.count)

    def describe_trials(self, deadline_ms: float) -> Iterable[str]:
        """Return phrases that describe what a trial shows and when; empty, as a plain block has no time course.

        ``deadline_ms`` is the time for a response after the target's onset; 0 for no deadline.
        """
        return ()


ReadyPolicy = Literal["each", "first", "none"]


class TrialRules(msgspec.Struct, frozen=True):
    """The rules of trials, which follow each other by the clock; only the plans of blocks of trials have them."""

    ready: ReadyPolicy = "each"  # which episodes wait for Enter
    feedback_ms: float = 0.0  # the feedback goes by itself; 0: by Enter
    intervals_ms: tuple[float, ...] = ()  # before each episode, where they were drawn
