"""How long a step is open, and the delay of an input that has not come. Reads no clock."""

from typing import Literal

MS_PER_S = 1_000

# late: a tick of the clock closes without the input; overdue: a present person has thought for too long
Delay = Literal["in_time", "late", "overdue"]


class StepClock:
    """The time since the first input of a step.

    Args:
        late_ms: how long a tick waits for an input at most, in milliseconds.
        thinking_wait_s: how long people wait for the input of a partner who is here at most, in seconds.
    """

    def __init__(self, late_ms: float, thinking_wait_s: float) -> None:
        self._late_ms = late_ms
        self._thinking_wait_s = thinking_wait_s
        self.opened_s = 0.0  # when the step's first input came

    def open(self, now_s: float) -> None:
        """Record the time of a step's first input."""
        self.opened_s = now_s

    def find_delay(self, now_s: float, due_s: float | None = None) -> Delay:
        """Return whether the inputs that are missing now are still in time, late or overdue.

        Args:
            now_s: the present time in seconds.
            due_s: the time at which the missing inputs were due; None means as soon as the step was opened.
        """
        if now_s - self.opened_s >= self._thinking_wait_s:
            return "overdue"
        late_s = now_s - (self.opened_s if due_s is None else due_s)
        if late_s * MS_PER_S >= self._late_ms:
            return "late"
        return "in_time"
