"""What corrections ask of the session host."""

from dataclasses import dataclass

from minihuman.experiment.machine.activity import ActivityRequest


@dataclass(frozen=True, slots=True)
class EpisodeRequest(ActivityRequest):
    """An episode to review; the answer is a ``ClipOffered`` of the whole episode, or of None if there is no other."""

    part: int
    source: str  # the block whose episodes are looked at
    number: int  # 0 for the first
    count: int  # how many are looked at: the latest
