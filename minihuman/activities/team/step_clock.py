"""The time of one step: how long it is open, and what that means for an input that has not come. Reads no clock."""

from typing import Literal

MS_PER_S = 1_000

# late: the tick closes without it; overdue: who is here has thought for too long
Delay = Literal["in_time", "late", "overdue"]


class StepClock:
    """Runs from the first input of a step.

    Args:
        late_ms: how long a tick waits for an input.
        thinking_wait_s: how long people wait for the input of a partner who is here.
    """

    def __init__(self, late_ms: float, thinking_wait_s: float) -> None:
        self._late_ms = late_ms
        self._thinking_wait_s = thinking_wait_s
        self.opened_s = 0.0  # when the step's first input came

    def open(self, now_s: float) -> None:
        """Begin a step."""
        self.opened_s = now_s

    def find_delay(self, now_s: float, due_s: float | None = None) -> Delay:
        """Find how late an input would be that came now.

        Args:
            now_s: the time.
            due_s: when the inputs that are missing were due; None: as soon as the step was opened.
        """
        if now_s - self.opened_s >= self._thinking_wait_s:
            return "overdue"
        late_s = now_s - (self.opened_s if due_s is None else due_s)
        if late_s * MS_PER_S >= self._late_ms:
            return "late"
        return "in_time"
