"""The times at which the seats' inputs are due in a real-time team, by the server's clock.

There is no I/O here; times are passed in. Each page times its own ticks, so a page can send an input as early as it
likes. A partner counts as late only from the time when the partner's own input was due, which is one period for each
step after the partner's last input.
"""

from collections.abc import Iterable


class TickSchedule:
    """The due times of the seats' ticks in one episode.

    Args:
        began_s: the time at which all seats were ready; the first ticks are due one period later.
    """

    def __init__(self, began_s: float) -> None:
        self._began_s = began_s
        self._inputs: dict[int, tuple[int, float]] = {}  # by seat, the last step that it gave an input for, and when

    def record_input(self, seat: int, step: int, now_s: float) -> None:
        """Record the time of a seat's input for a step; a repeated request keeps the first time."""
        if step > self._inputs.get(seat, (0, 0.0))[0]:
            self._inputs[seat] = step, now_s

    def find_due_s(self, seats: Iterable[int], step: int, opened_s: float, period_s: float) -> float:
        """Return the time at which the last of several seats' inputs is due, which is never before the step was opened.

        A slow page keeps its partners waiting for one period at most.

        Args:
            seats: the seats whose input has not come.
            step: the step's number, from 1.
            opened_s: the time of the step's first input.
            period_s: the period of the ticks in seconds.
        """
        due_s = opened_s
        for seat in seats:
            last_step, last_s = self._inputs.get(seat, (0, self._began_s))
            due_s = max(due_s, last_s + (step - last_step) * period_s)
        return min(due_s, opened_s + period_s)
