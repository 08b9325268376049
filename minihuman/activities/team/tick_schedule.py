"""When the inputs of a real-time team's seats are due, by the server's clock. No I/O; times come in as arguments.

Each page keeps the time of its own ticks, so a page can send one as early as it likes. Its partner counts as late only
from when the partner's own input was due: a period for each step after the last one that came.
"""

from collections.abc import Iterable


class TickSchedule:
    """The seats' ticks of one episode.

    Args:
        began_s: when all seats were ready; the first ticks are due a period later.
    """

    def __init__(self, began_s: float) -> None:
        self._began_s = began_s
        self._inputs: dict[int, tuple[int, float]] = {}  # by seat, the last step that it gave an input for, and when

    def record_input(self, seat: int, step: int, now_s: float) -> None:
        """Take note that a seat's input for a step came; one that is asked for again came at the first time."""
        if step > self._inputs.get(seat, (0, 0.0))[0]:
            self._inputs[seat] = step, now_s

    def find_due_s(self, seats: Iterable[int], step: int, opened_s: float, period_s: float) -> float:
        """Return when the last of some seats' inputs is due: no earlier than the step was opened.

        A page that is slow keeps its partners waiting for a period at most.

        Args:
            seats: those whose input has not come.
            step: from 1 on.
            opened_s: when the first input of the step came.
            period_s: of the ticks.
        """
        due_s = opened_s
        for seat in seats:
            last_step, last_s = self._inputs.get(seat, (0, self._began_s))
            due_s = max(due_s, last_s + (step - last_step) * period_s)
        return min(due_s, opened_s + period_s)
