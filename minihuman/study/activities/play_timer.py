"""How long a block's screens stand: interval, fixation, hold and learning by the clock, a rest at least so long."""

from collections.abc import Callable
from enum import StrEnum

from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.phases import Phase

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000
_TIMED = (Phase.INTERVAL, Phase.FIXATION, Phase.HOLD, Phase.LEARNING)  # time ends them, no key


class Timer:
    """The time of the phase that stands; phases without a length leave it alone.

    Args:
        plan: the block's.
        learning_s: how long the next episode may wait for an agent that learns.
    """

    def __init__(self, plan: PlayPlan, learning_s: Callable[[], float]) -> None:
        self._plan = plan
        self._learning_s = learning_s
        self._until_ns: int | None = None

    def begin(self, phase: StrEnum, now_ns: int) -> None:
        """A phase begins."""
        if phase in _TIMED:
            self._until_ns = now_ns + self._lasts_ns(phase)
        elif phase is Phase.REST:
            self._until_ns = now_ns + round(self._plan.rest_s * NS_PER_S)

    def seen(self, phase: StrEnum, flip_ns: int) -> None:
        """Its screen reached the display: it stands from then on. Learning lasts however late it was seen."""
        if phase in _TIMED and phase is not Phase.LEARNING and self._until_ns is not None:
            self._until_ns = flip_ns + self._lasts_ns(phase)

    def suspend(self, phase: StrEnum) -> None:
        """Something is in front; a rest goes on even so."""
        if phase in _TIMED:
            self._until_ns = None

    def resume(self, phase: StrEnum, now_ns: int) -> None:
        """It stands again, for its whole time."""
        if phase in _TIMED:
            self._until_ns = now_ns + self._lasts_ns(phase)

    def over(self, phase: StrEnum, now_ns: int) -> bool:
        """Whether a phase that time ends has stood long enough."""
        return phase in _TIMED and self._until_ns is not None and now_ns >= self._until_ns

    def due_ns(self, phase: StrEnum, now_ns: int) -> int | None:
        """When something changes by itself, a rest's next second too; None: never."""
        if self._until_ns is None or now_ns >= self._until_ns:
            return None
        if phase is Phase.REST:
            return self._until_ns - (self.left_s(now_ns) - 1) * NS_PER_S
        return self._until_ns

    def left_s(self, now_ns: int) -> int:
        """Seconds that are left, begun ones counted whole."""
        return max(0, -(-((self._until_ns or 0) - now_ns) // NS_PER_S))

    def _lasts_ns(self, phase: StrEnum) -> int:
        ms: dict[StrEnum, float] = {
            Phase.INTERVAL: self._plan.interval_ms,
            Phase.FIXATION: self._plan.fixation_ms,
            Phase.HOLD: self._plan.hold_ms,
            Phase.LEARNING: self._learning_s() * 1_000,
        }
        return round(ms[phase] * NS_PER_MS)
