"""The clocks of a session in a browser: the session's time by the server's clock, and the page's compared with it.

No I/O: every time comes in as an argument.
"""

from minihuman.experiment.machine.events import Linked
from minihuman.web.messages import MessageError, RoundTripMessage

_AHEAD_NS = 5_000_000_000  # a page's clock may be so far before ours, and a thousandth more with time
_MAX_OUTAGE_NS = 86_400_000_000_000
_DRIFT_AFTER_NS = 60_000_000_000  # before, jitter hides the drift
_MAX_DRIFT_NS = 200_000_000  # of the page's clock against the server's: 2 % between two looks, which are 10 s apart
_NEVER_NS = 1 << 62


class SegmentClock:
    """A segment's time by the server's clock, which bounds the times that a page claims.

    Args:
        zero_ns: the server's monotonic time at the session's time 0.
    """

    def __init__(self, zero_ns: int) -> None:
        self._zero_ns = zero_ns

    def at(self, monotonic_ns: int) -> int:
        """Return the session's time at a monotonic time of the server's."""
        return monotonic_ns - self._zero_ns

    def catch_up(self, ahead_ns: int) -> None:
        """Go on from the time of a page whose clock ran on, by ``ahead_ns``, while there was no server."""
        if 0 < ahead_ns < _MAX_OUTAGE_NS:
            self._zero_ns -= ahead_ns

    def check(self, number: int, at_ns: int, now_ns: int) -> None:
        """Check the time that a page claims for a message.

        Raises:
            MessageError: if it is further ahead of the session's time ``now_ns`` than two clocks can be apart.
        """
        if at_ns > now_ns + _AHEAD_NS + now_ns // 1000:
            raise MessageError(
                f"message {number} has time {at_ns} ns, but the session is at {now_ns} ns; reload the page"
            )


class PageClock:
    """Compares the page's clock with the server's, by what the page measured and by when its messages came."""

    def __init__(self) -> None:
        self.rtt_ns: int | None = None  # of the quickest of the latest; None until one was measured
        self._first: tuple[int, int] | None = None  # time and offset of the first
        # of the quickest message: since the last look, before that one, and in the first minute
        self._lag_ns = _NEVER_NS
        self._last_lag_ns = _NEVER_NS
        self._least_lag_ns = _NEVER_NS

    def arrive(self, at_ns: int, arrival_ns: int) -> None:
        """Take the page's time of a message and the server's when it came: all but the quickest waited on the way."""
        self._lag_ns = min(self._lag_ns, arrival_ns - at_ns)

    def look(self, link: Linked) -> str:
        """Return how far the page's time has moved against the server's clock, if that is too far; "" if not."""
        lag_ns = min(self._lag_ns, self._last_lag_ns)
        self._last_lag_ns = self._lag_ns
        self._lag_ns = _NEVER_NS
        if link.drift_ppm is None:
            self._least_lag_ns = min(self._least_lag_ns, lag_ns)
        drift_ns = self._least_lag_ns - lag_ns
        if abs(drift_ns) <= _MAX_DRIFT_NS + link.error_ns:
            return ""
        self._least_lag_ns = lag_ns
        return f"the page's time moved by {drift_ns / 1e6:+.0f} ms against the times at which its messages came"

    def linked(self, at_ns: int, link: RoundTripMessage) -> Linked:
        """Return an event for the log.

        Args:
            at_ns: the session's time.
            link: the quickest of the page's latest messages there and back.
        """
        least_ns = max(0, (link.back - link.sent) - (link.answered - link.received))
        offset_ns = ((link.received - link.sent) + (link.answered - link.back)) // 2
        self.rtt_ns = least_ns
        if self._first is None:
            self._first = at_ns, offset_ns
        passed_ns = at_ns - self._first[0]
        drift_ppm = None
        if passed_ns >= _DRIFT_AFTER_NS:
            drift_ppm = (offset_ns - self._first[1]) / passed_ns * 1e6
        return Linked(at_ns, offset_ns, -(-least_ns // 2), link.latest, least_ns, drift_ppm)
