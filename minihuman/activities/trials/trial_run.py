"""A trial while it runs: which picture is due, which responses are taken, and when it ends. No clock and no I/O."""

from dataclasses import dataclass

from minihuman.activities.trials.schedule import NS_PER_MS, ScheduledStimulus, TrialSchedule

PREPARATION_NS = 40 * NS_PER_MS  # a picture is handed over so long before it is due, to be drawn
_BEFORE_FIRST = -1  # the screen is empty until the first picture is due


@dataclass(frozen=True, slots=True)
class ResponseRecord:
    """A response that was taken."""

    key: str
    action: int
    pressed_ns: int


class TrialRun:
    """The state of a running trial.

    Pictures are numbered from 0 as the schedule changes them, and none is left out. After a response that removes
    stimuli, the same numbers show what remains.

    Args:
        schedule: the trial's schedule.
        start_ns: when its first picture is due in a block with a rhythm; None: at once.
    """

    def __init__(self, schedule: TrialSchedule, start_ns: int | None = None) -> None:
        self.schedule = schedule
        self.changes_ns = schedule.changes_ns
        self.frame = 0 if start_ns is None else _BEFORE_FIRST
        self.responses: list[ResponseRecord] = []
        self.first_flip_ns: int | None = None
        self.target_flip_ns: int | None = None
        self._start_ns = start_ns
        self._seen_frame = _BEFORE_FIRST

    @property
    def has_response(self) -> bool:
        """Whether a response has been taken."""
        return bool(self.responses)

    @property
    def is_seen(self) -> bool:
        """Whether the present picture, or one of the same number, has reached the display."""
        return self._seen_frame == self.frame

    @property
    def visible(self) -> tuple[ScheduledStimulus, ...]:
        """The stimuli of the present picture."""
        return self.find_visible(self.frame, has_response=self.has_response)

    def find_visible(self, frame: int, *, has_response: bool) -> tuple[ScheduledStimulus, ...]:
        """Return the stimuli of a picture; none before the first."""
        if frame < 0:
            return ()
        return self.schedule.find_visible(self.changes_ns[frame], has_response=has_response)

    def find_due_ns(self, frame: int) -> int | None:
        """Return when a picture is due in session time; None if it is due at once, or not known yet."""
        if frame <= 0:
            return self._start_ns
        if self.first_flip_ns is None:
            return None
        return self.first_flip_ns + self.changes_ns[frame]

    @property
    def end_ns(self) -> int | None:
        """When the trial ends by the clock, in session time; None if it does not, or has not begun."""
        if self.first_flip_ns is None or self.schedule.end_ns is None:
            return None
        return self.first_flip_ns + self.schedule.end_ns

    @property
    def next_tick_ns(self) -> int | None:
        """When the next picture has to be prepared or the trial ends; None while nothing is due by the clock."""
        times_ns = (self._next_preparation_ns, self.end_ns)
        return min((t_ns for t_ns in times_ns if t_ns is not None), default=None)

    @property
    def _next_preparation_ns(self) -> int | None:
        if not self.is_seen or self.frame + 1 >= len(self.changes_ns):
            return None
        due_ns = self.find_due_ns(self.frame + 1)
        assert due_ns is not None  # of the first picture after an empty screen, or of one after the first
        return due_ns - PREPARATION_NS

    def pass_time(self, now_ns: int) -> None:
        """Go on to the next picture if it has to be prepared by now and the present one was seen."""
        preparation_ns = self._next_preparation_ns
        if preparation_ns is not None and now_ns >= preparation_ns:
            self.frame += 1

    def is_over(self, now_ns: int) -> bool:
        """Tell whether the trial has ended, by the clock or by its last response."""
        if self.schedule.ends_at_response and len(self.responses) >= self.schedule.responses:
            return True
        return self.end_ns is not None and now_ns >= self.end_ns

    def record_flip(self, flip_ns: int, frame: int | None = None) -> int | None:
        """Record that a picture reached the display, None for the present one; return when it was due, if it was."""
        if frame is not None and self.frame < frame < len(self.changes_ns):
            self.frame = frame
        if self.frame < 0:
            return None
        due_ns = None if self.is_seen else self.find_due_ns(self.frame)
        if self.first_flip_ns is None:
            self.first_flip_ns = flip_ns
        if self.changes_ns[self.frame] == self.schedule.target_ns and self.target_flip_ns is None:
            self.target_flip_ns = flip_ns
        self._seen_frame = self.frame
        return due_ns

    def takes(self, pressed_ns: int) -> bool:
        """Tell whether a key pressed at a time is a response."""
        if self.first_flip_ns is None or self.target_flip_ns is None:
            return False
        if len(self.responses) >= self.schedule.responses:
            return False
        opens_ns = self.target_flip_ns + self.schedule.opens_ns - self.schedule.target_ns
        closes_ns = self.schedule.closes_ns
        return pressed_ns >= opens_ns and (closes_ns is None or pressed_ns < self.first_flip_ns + closes_ns)
