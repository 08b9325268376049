from dataclasses import dataclass

from minihuman.experiment.machine.events import ActivityEvent


@dataclass(frozen=True, slots=True)
class Tapped(ActivityEvent):
    part: int
    tap: int  # 1 for the first
