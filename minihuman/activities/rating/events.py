"""Events of rated blocks."""

from dataclasses import dataclass

from minihuman.experiment.machine.events import ActivityEvent


@dataclass(frozen=True, slots=True)
class Rated(ActivityEvent):
    """The person pressed the key that rates a step as good or as bad.

    The learner decides which step the rating refers to; ``FrameShown`` events hold the pictures' times.
    """

    episode: int
    step: int  # the world's when the session took the press
    value: float  # 1 good, -1 bad
    pressed_ns: int
