"""Events of rated blocks."""

from dataclasses import dataclass

from minihuman.experiment.machine.events import ActivityEvent


@dataclass(frozen=True, slots=True)
class Rated(ActivityEvent):
    """A press for good or bad. Which step it refers to is left to the learner; ``FrameShown`` has the pictures."""

    episode: int
    step: int  # the world's when the session took the press
    value: float  # 1 good, -1 bad
    pressed_ns: int
