"""What a comparison hears from outside and says: two stretches of episodes, and which one was said to be better."""

from dataclasses import dataclass
from typing import Literal

from minihuman.study.activities.port import Want
from minihuman.study.events import KindEvent
from minihuman.study.inputs import ForPart

Side = Literal["left", "right"]
Pairing = Literal["random", "disagreement"]  # any pair, or one that an ensemble of reward models disagrees on
Verdict = Literal["left", "right", "equal", "cannot_tell"]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Some steps of an episode, by what makes it again: the world, its seed and every action up to its last step."""

    episode: int  # of the session it was played in, 0 for the first
    attempt: int  # 1, or more where the episode was begun again
    first: int  # the step whose picture is the first; 0 is the reset
    world: str
    options: str  # JSON
    seed: int
    actions: tuple[int, ...]  # the world's, from the reset to the stretch's last step

    @property
    def last(self) -> int:
        """The step whose picture is the last."""
        return len(self.actions)


@dataclass(frozen=True, slots=True)
class WantsStretch(Want):
    """A stretch to compare: two are asked for, one after the other."""

    part: int
    source: str  # the block whose episodes are compared
    pair: int  # 0 for the first
    place: int  # 0, then 1
    steps: int
    again: Stretch | None  # what the first of the pair is
    pairing: Pairing = "random"
    wait_s: float = 0.0  # how long a pair that is disagreed on may be waited for


@dataclass(frozen=True, slots=True)
class Offered(ForPart):
    """A stretch; None where there are no two that differ."""

    stretch: Stretch | None


@dataclass(frozen=True, slots=True)
class StretchShown(KindEvent):
    """A stretch is one side of a pair. Both sides of a pair are told of before it is seen."""

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
    def stretch(self) -> Stretch:
        """What was shown."""
        return Stretch(self.episode, self.attempt, self.first, self.world, self.options, self.seed, self.actions)


@dataclass(frozen=True, slots=True)
class NothingToCompare(KindEvent):
    """There are no two stretches that differ: the part is over."""

    part: int
    pair: int


@dataclass(frozen=True, slots=True)
class PairSeen(KindEvent):
    """A pair's pictures reached the display."""

    part: int
    pair: int
    step: int  # 0 for the first picture of both
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class Preferred(KindEvent):
    """What was said of a pair."""

    part: int
    pair: int
    answer: Verdict
    shown_ns: int  # when its first picture reached the display; 0 if nobody said
    replays: int  # how often it was asked for again
    pressed_ns: int
