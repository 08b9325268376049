"""Events of corrections."""

from dataclasses import dataclass
from typing import Literal

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.experiment.machine.events import ActivityEvent, EpisodeBeginning, EpisodeEnding, EpisodeStep

CorrectionOutcome = Literal["goal", "failure", "timeout", "stopped", "ended"]


@dataclass(frozen=True, slots=True)
class EpisodeLookedAt(ActivityEvent):
    """The review of an episode began; the episode is recreated from its seed and actions."""

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
    def stretch(self) -> EpisodeClip:
        """Return the whole episode as a clip."""
        return EpisodeClip(self.episode, self.attempt, 0, self.world, self.options, self.seed, self.actions)


@dataclass(frozen=True, slots=True)
class NothingToCorrect(ActivityEvent):
    """Records that no other episode was available for review."""

    part: int
    number: int


@dataclass(frozen=True, slots=True)
class CorrectionSeen(ActivityEvent):
    """A picture of the reviewed episode, or of its correction, reached the display."""

    part: int
    number: int
    step: int
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class CorrectionBegun(ActivityEvent, EpisodeBeginning):
    """A correction began."""

    part: int
    correction: int  # 0 for the part's first
    episode: int
    attempt: int
    step: int  # the step after which the correction begins, 0 for the reset
    state_hash: int
    pressed_ns: int

    @property
    def begins_at(self) -> tuple[int, int]:
        """Return the index of the corrected episode, and the step after which the correction begins."""
        return self.episode, self.step


@dataclass(frozen=True, slots=True)
class CorrectionStepped(ActivityEvent, EpisodeStep):
    """A correction made a step."""

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
class CorrectionEnded(ActivityEvent, EpisodeEnding):
    """A correction ended with an outcome."""

    part: int
    correction: int
    episode: int
    outcome: CorrectionOutcome
