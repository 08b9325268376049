"""Requests of comparisons and corrections to the session host for clips of the session's own episodes."""

from dataclasses import dataclass
from typing import ClassVar

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.activities.preferences.plan import PairingPolicy
from minihuman.experiment.machine.activity import ActivityRequest


@dataclass(frozen=True, slots=True)
class ClipRequest(ActivityRequest):
    """A request for one clip to compare; a comparison makes two, one after the other."""

    awaits_others: ClassVar[bool] = True
    part: int
    source: str  # the block whose episodes are compared
    pair: int  # 0 for the first
    place: int  # 0 for the pair's first clip, 1 for its second
    steps: int
    again: EpisodeClip | None  # the pair's first clip; None if that clip is requested
    pairing: PairingPolicy = "random"
    wait_s: float = 0.0  # the longest wait for a pair by disagreement; then any pair is taken


@dataclass(frozen=True, slots=True)
class EpisodeRequest(ActivityRequest):
    """A request for an episode to review.

    The answer is a ``ClipOffered`` with the whole episode, or with None if there is no other.
    """

    part: int
    source: str  # the block whose episodes are looked at
    number: int  # 0 for the first
    count: int  # how many are looked at: the latest
