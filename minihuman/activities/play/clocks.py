"""The clocks of a block: limits of playing time, and the durations of timed phases."""

from collections.abc import Callable
from enum import StrEnum

from minihuman.activities.play.episode_sequence import EpisodeSequence
from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.machine.events import EndCause
from minihuman.experiment.machine.running_episode import NS_PER_MS
from minihuman.experiment.machine.transitions import Phase

NS_PER_S = 1_000_000_000


class BlockTimeLimits:
    """The time limits of the episode and of the block, which count only while an episode is played; 0 s is no limit."""

    def __init__(self, episode_s: float, block_s: float) -> None:
        self._episode_ns = round(episode_s * NS_PER_S)
        self._block_ns = round(block_s * NS_PER_S)
        self._played_ns = 0  # of the episode, when the clock last stood
        self._block_played_ns = 0
        self._running_since_ns: int | None = None

    def begin(self, now_ns: int) -> None:
        """Start the clocks for an episode."""
        self._played_ns = 0
        self._running_since_ns = now_ns

    def resume(self, now_ns: int) -> None:
        """Restart the clocks after a pause."""
        self._running_since_ns = now_ns

    def stop(self, now_ns: int) -> None:
        """Stop the clocks for a pause or at the end of an episode."""
        if self._running_since_ns is not None:
            elapsed_ns = now_ns - self._running_since_ns
            self._played_ns += elapsed_ns
            self._block_played_ns += elapsed_ns
            self._running_since_ns = None

    @property
    def due_ns(self) -> int | None:
        """Return the time at which the next limit is reached; None if there is no limit or the clocks are stopped."""
        if self._running_since_ns is None or not (self._episode_ns or self._block_ns):
            return None
        remaining_ns = []
        if self._episode_ns:
            remaining_ns.append(self._episode_ns - self._played_ns)
        if self._block_ns:
            remaining_ns.append(self._block_ns - self._block_played_ns)
        return self._running_since_ns + max(0, min(remaining_ns))

    def find_reached_limit(self, now_ns: int) -> EndCause:
        """Return the limit that has been reached, as the cause of the episode's end; "" for none."""
        due_ns = self.due_ns
        if due_ns is None or now_ns < due_ns:
            return ""
        if self.is_block_over(now_ns):
            return "block_max_s"
        return "max_s"

    def is_block_over(self, now_ns: int) -> bool:
        """Return whether the block's playing time is used up; False for a block without a limit."""
        if self._running_since_ns is None:
            running_ns = 0
        else:
            running_ns = now_ns - self._running_since_ns
        return bool(self._block_ns) and self._block_played_ns + running_ns >= self._block_ns


_TIMED = (Phase.INTERVAL, Phase.FIXATION, Phase.HOLD, Phase.LEARNING)  # time ends them, no key


class PhaseTimer:
    """The timer of the present phase; it does nothing in phases that time does not end.

    Args:
        plan: the block's plan.
        sequence: the block's episodes, which know the interval before the next one.
        learning_s: returns the longest wait of the next episode for an agent that learns, in seconds.
    """

    def __init__(self, plan: PlayPlan, sequence: EpisodeSequence, learning_s: Callable[[], float]) -> None:
        self._plan = plan
        self._sequence = sequence
        self._learning_s = learning_s
        self._feedback_ms = plan.trial.feedback_ms if plan.trial else 0.0
        self._timed: tuple[StrEnum, ...] = (*_TIMED, Phase.FEEDBACK) if self._feedback_ms else _TIMED
        self._until_ns: int | None = None

    def begin(self, phase: StrEnum, now_ns: int) -> None:
        """Start the timer of a phase that ends by time, or of a rest, at a session time; ignore any other phase."""
        if phase in self._timed:
            self._until_ns = now_ns + self._find_duration_ns(phase)
        elif phase is Phase.REST:
            self._until_ns = now_ns + round(self._plan.rest_s * NS_PER_S)

    def note_seen(self, phase: StrEnum, flip_ns: int) -> None:
        """Restart the phase's time from when its screen reached the display, except in the learning phase."""
        if phase in self._timed and phase is not Phase.LEARNING and self._until_ns is not None:
            self._until_ns = flip_ns + self._find_duration_ns(phase)

    def suspend(self, phase: StrEnum) -> None:
        """Stop the phase's time while another screen covers it; a rest keeps counting."""
        if phase in self._timed:
            self._until_ns = None

    def resume(self, phase: StrEnum, now_ns: int) -> None:
        """Restart the phase's time from the beginning."""
        if phase in self._timed:
            self._until_ns = now_ns + self._find_duration_ns(phase)

    def is_over(self, phase: StrEnum, now_ns: int) -> bool:
        """Return whether a timed phase has lasted its full time."""
        return phase in self._timed and self._until_ns is not None and now_ns >= self._until_ns

    def is_timed(self, phase: StrEnum) -> bool:
        """Return whether a phase ends by time rather than by a key."""
        return phase in self._timed

    def find_due_ns(self, phase: StrEnum, now_ns: int) -> int | None:
        """Return the time of the phase's next change: its end, or the next second of a rest; None if there is none."""
        if self._until_ns is None or now_ns >= self._until_ns:
            return None
        if phase is Phase.REST:
            return self._until_ns - (self.find_remaining_s(now_ns) - 1) * NS_PER_S
        return self._until_ns

    def find_remaining_s(self, now_ns: int) -> int:
        """Return the seconds that remain of the present phase, rounded up; 0 if no timer runs."""
        if self._until_ns is None or now_ns >= self._until_ns:
            return 0
        remaining_ns = self._until_ns - now_ns
        return (remaining_ns + NS_PER_S - 1) // NS_PER_S  # rounded up

    def _find_duration_ns(self, phase: StrEnum) -> int:
        """Return the duration of a timed phase in nanoseconds."""
        durations_ms: dict[StrEnum, float] = {
            Phase.INTERVAL: self._sequence.interval_ms,
            Phase.FEEDBACK: self._feedback_ms,
            Phase.FIXATION: self._plan.fixation_ms,
            Phase.HOLD: self._plan.hold_ms,
            Phase.LEARNING: self._learning_s() * 1_000,
        }
        return round(durations_ms[phase] * NS_PER_MS)
