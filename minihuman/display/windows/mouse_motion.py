"""The motion of a captured mouse, added up so that a mouse with a high report rate does not fill the log.

The module depends on no toolkit and no clock.
"""

from minihuman.experiment.machine.inputs import AxisChanged, Input

PERIOD_NS = 15_000_000  # the shortest time between inputs of an axis, as in the page; mice report up to 1000 times a s


class MouseMotion:
    """Adds up the motion of the mouse, and reports it some 60 times a second."""

    def __init__(self) -> None:
        self._moved_px: dict[str, int] = {}  # by axis, not reported yet
        self._moved_ns = 0  # when the mouse moved last
        self._reported_ns: int | None = None  # when motion was reported last

    def add(self, motion_px: dict[str, int], t_ns: int) -> list[Input]:
        """Add a motion in pixels by axis; return the inputs of all motion so far, or [] if they are not due yet."""
        if not any(motion_px.values()):
            return []
        for axis, pixels in motion_px.items():
            self._moved_px[axis] = self._moved_px.get(axis, 0) + pixels
        self._moved_ns = t_ns
        return self.report(t_ns)

    @property
    def due_ns(self) -> int | None:
        """The time at which the motion that was not reported yet is due; None if there is no such motion."""
        if self._reported_ns is None or not any(self._moved_px.values()):
            return None
        return self._reported_ns + PERIOD_NS

    def report(self, now_ns: int, *, is_needed: bool = False) -> list[Input]:
        """Return an input for each axis that moved since the last report, with the time of the latest motion.

        Args:
            now_ns: the present time.
            is_needed: whether to report motion even if less than `PERIOD_NS` has passed since the last report.
        """
        has_waited = self._reported_ns is None or now_ns - self._reported_ns >= PERIOD_NS
        moved_px = {axis: pixels for axis, pixels in self._moved_px.items() if pixels}
        if not moved_px or not (has_waited or is_needed):
            return []
        self._moved_px.clear()
        self._reported_ns = now_ns
        return [AxisChanged(self._moved_ns, axis, float(pixels)) for axis, pixels in moved_px.items()]

    def forget(self) -> None:
        """Discard motion that was not reported, since the screen or the focus has changed."""
        self._moved_px.clear()
