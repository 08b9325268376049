"""Events of comparisons of clips."""

from dataclasses import dataclass
from typing import Literal

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.experiment.machine.events import ActivityEvent

Side = Literal["left", "right"]
PairAnswer = Literal["left", "right", "equal", "cannot_tell"]


@dataclass(frozen=True, slots=True)
class StretchShown(ActivityEvent):
    """A clip was assigned to one side of a pair. Both sides are logged before the pair is shown."""

    part: int
    pair: int
    side: Side
    episode: int
    attempt: int
    first: int
    world: str
    options: str
    seed: int
    actions: tuple[int, ...]
    first_hash: int  # of the world's state at the first picture and at the last
    last_hash: int

    @property
    def stretch(self) -> EpisodeClip:
        """Return the clip on this side of the pair."""
        return EpisodeClip(self.episode, self.attempt, self.first, self.world, self.options, self.seed, self.actions)


@dataclass(frozen=True, slots=True)
class NothingToCompare(ActivityEvent):
    """Records that no two different clips were available, so the part ends."""

    part: int
    pair: int


@dataclass(frozen=True, slots=True)
class PairSeen(ActivityEvent):
    """The pictures of a pair reached the display."""

    part: int
    pair: int
    step: int  # 0 for the first picture of both
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class Preferred(ActivityEvent):
    """The participant answered a pair."""

    part: int
    pair: int
    answer: PairAnswer
    shown_ns: int  # when its first picture reached the display; 0 if unknown
    replays: int  # how often the participant replayed it
    pressed_ns: int
