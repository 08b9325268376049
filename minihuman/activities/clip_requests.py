"""What comparisons and corrections ask of the session host: clips of the session's own episodes."""

from dataclasses import dataclass
from typing import ClassVar

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.activities.preferences.plan import PairingPolicy
from minihuman.experiment.machine.activity import ActivityRequest


@dataclass(frozen=True, slots=True)
class ClipRequest(ActivityRequest):
    """A clip to compare; two are requested, one after the other."""

    awaits_others: ClassVar[bool] = True
    part: int
    source: str  # the block whose episodes are compared
    pair: int  # 0 for the first
    place: int  # 0, then 1
    steps: int
    again: EpisodeClip | None  # what the first of the pair is
    pairing: PairingPolicy = "random"
    wait_s: float = 0.0  # how long a pair that is disagreed on may be waited for


@dataclass(frozen=True, slots=True)
class EpisodeRequest(ActivityRequest):
    """An episode to review; the answer is a ``ClipOffered`` of the whole episode, or of None if there is no other."""

    part: int
    source: str  # the block whose episodes are looked at
    number: int  # 0 for the first
    count: int  # how many are looked at: the latest
