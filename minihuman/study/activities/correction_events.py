"""What a correction after the fact hears from outside and says: which episode is looked at, and what was shown instead.

Steps are the episode's own, 0 for its reset: a correction goes on counting where it leaves the episode.
"""

from dataclasses import dataclass
from typing import Literal

from minihuman.study.activities.pair_events import Stretch
from minihuman.study.activities.port import Want
from minihuman.study.events import KindEvent

CorrectionOutcome = Literal["goal", "failure", "timeout", "stopped"]


@dataclass(frozen=True, slots=True)
class WantsEpisode(Want):
    """An episode to look at; the answer is an ``Offered`` of all of it, or of None where there is no further one."""

    part: int
    source: str  # the block whose episodes are looked at
    number: int  # 0 for the first
    count: int  # how many are looked at: the latest


@dataclass(frozen=True, slots=True)
class EpisodeLookedAt(KindEvent):
    """An episode of the session is looked at once more, made again from seed and actions."""

    part: int
    number: int
    episode: int
    attempt: int
    world: str
    options: str  # JSON
    seed: int
    actions: tuple[int, ...]
    last_hash: int

    @property
    def stretch(self) -> Stretch:
        """All of it."""
        return Stretch(self.episode, self.attempt, 0, self.world, self.options, self.seed, self.actions)


@dataclass(frozen=True, slots=True)
class NothingToCorrect(KindEvent):
    """There is no further episode to look at."""

    part: int
    number: int


@dataclass(frozen=True, slots=True)
class CorrectionSeen(KindEvent):
    """A picture of the episode, or of what is shown instead, reached the display."""

    part: int
    number: int
    step: int
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class CorrectionBegun(KindEvent):
    """From here on somebody shows what should have been done."""

    part: int
    correction: int  # 0 for the part's first
    episode: int
    attempt: int
    step: int  # after which it begins
    state_hash: int
    pressed_ns: int


@dataclass(frozen=True, slots=True)
class CorrectionStepped(KindEvent):
    """A step of what should have been done."""

    part: int
    correction: int
    episode: int
    step: int
    action: int
    key: str
    key_t_ns: int
    reward: float
    terminated: bool
    truncated: bool
    state_hash: int


@dataclass(frozen=True, slots=True)
class CorrectionEnded(KindEvent):
    """That was what should have been done."""

    part: int
    correction: int
    episode: int
    outcome: CorrectionOutcome
