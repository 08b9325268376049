"""What was said of pairs of stretches, gathered from a session's events."""

from collections.abc import Iterable
from dataclasses import dataclass

from minihuman.study.activities.pair_events import Preferred, Stretch, StretchShown


@dataclass(frozen=True, slots=True)
class Compared:
    """A pair and what was said of it. Times are session time."""

    part: int  # index into the plan's parts
    pair: int  # 0 for the first
    left: Stretch
    right: Stretch
    said: Preferred

    @property
    def answer_ms(self) -> float:
        """From the first picture on the display to the key; NaN where nobody said when it was there."""
        return (self.said.pressed_ns - self.said.shown_ns) / 1e6 if self.said.shown_ns else float("nan")


def comparisons(events: Iterable[object]) -> tuple[Compared, ...]:
    """Every pair of a session that was answered, in order; a pair that was shown again after an interruption once."""
    shown: dict[tuple[int, int, str], Stretch] = {}
    found = []
    for event in events:
        match event:
            case StretchShown():
                shown[event.part, event.pair, event.side] = event.stretch
            case Preferred():
                left, right = (shown.get((event.part, event.pair, side)) for side in ("left", "right"))
                if left is not None and right is not None:
                    found.append(Compared(event.part, event.pair, left, right, event))
    return tuple(found)
