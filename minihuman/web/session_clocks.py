"""The clocks of a session in a browser: the session's time, and the page's clock compared with the server's.

No I/O: all times are passed in as arguments.
"""

from minihuman.experiment.machine.events import CLOCK_NOTE, Linked
from minihuman.web.messages import MessageError, RoundTripMessage

_AHEAD_NS = 5_000_000_000  # that a page's clock may be ahead of the server's, besides a thousandth of the time
_NOTED_AHEAD_NS = 1_000_000_000  # a page that is further ahead is noted, and again for each further second
_DRIFT_AFTER_NS = 60_000_000_000  # from the first measurement; over less time jitter hides the drift
_MAX_DRIFT_NS = 200_000_000  # of the page's clock against the server's: 2 % of the 10 s between two measurements
_LOOK_INTERVAL_NS = 30_000_000_000  # without a measurement, after which the messages' arrival times are compared
_UNMEASURED_ERROR_NS = 800_000_000  # of that comparison: the time that a single message may be delayed
_NEVER_NS = 1 << 62
_NS_PER_S = 1e9


class SegmentClock:
    """Keeps a segment's time by the server's clock, which bounds the times that a page claims.

    Args:
        zero_ns: the server's monotonic time at the session's time 0.
        wall_ns: the wall clock at ``monotonic_ns``; unlike the monotonic clock it advances while the machine sleeps.
        monotonic_ns: the present monotonic time.
        outage_ns: the longest time without a server that the wall clock does not account for.
    """

    def __init__(self, zero_ns: int, *, wall_ns: int = 0, monotonic_ns: int = 0, outage_ns: int = 0) -> None:
        self._zero_ns = zero_ns
        self._wall_zero_ns = wall_ns - monotonic_ns
        self._outage_ns = outage_ns
        self._caught_up_ns = 0
        self._noted_ns = _NOTED_AHEAD_NS
        self._claimed_ns = _NOTED_AHEAD_NS

    def at(self, monotonic_ns: int) -> int:
        """Return the session's time, in nanoseconds, at a monotonic time of the server."""
        return monotonic_ns - self._zero_ns

    def catch_up(self, ahead_ns: int, *, wall_ns: int, monotonic_ns: int) -> str:
        """Advance to the time of a page whose clock ran on, by ``ahead_ns``, while there was no server.

        The page's claim counts only up to the time for which this server or the previous one was away, and only once.

        Returns:
            A note if the page claims more than a second, and more than twice its previous claim; otherwise "".
        """
        asleep_ns = max(0, wall_ns - monotonic_ns - self._wall_zero_ns)
        known_ns = max(0, self._outage_ns + asleep_ns - self._caught_up_ns)
        counted_ns = max(0, min(ahead_ns, known_ns))
        self._zero_ns -= counted_ns
        self._caught_up_ns += counted_ns
        if ahead_ns <= self._claimed_ns:
            return ""
        self._claimed_ns = 2 * ahead_ns
        ahead_s = ahead_ns / _NS_PER_S
        counted_s = counted_ns / _NS_PER_S
        return f"{CLOCK_NOTE} was claimed to be {ahead_s:.3f} s ahead of the server's; {counted_s:.3f} s count"

    def allows(self, at_ns: int, now_ns: int) -> bool:
        """Return whether it is plausible that a page's clock reads ``at_ns`` when the session's time is ``now_ns``."""
        return at_ns <= now_ns + _AHEAD_NS + now_ns // 1000

    def check(self, number: int, at_ns: int, now_ns: int) -> str:
        """Check the time that a page claims for a message.

        Returns:
            A note if the time is more than a second ahead, or a second more than noted before; otherwise "".

        Raises:
            MessageError: if the time is further ahead of the session's time ``now_ns`` than two clocks can differ.
        """
        if not self.allows(at_ns, now_ns):
            raise MessageError(
                f"message {number} has time {at_ns} ns, but the session is at {now_ns} ns; reload the page"
            )
        ahead_ns = at_ns - now_ns
        if ahead_ns <= self._noted_ns:
            return ""
        self._noted_ns = ahead_ns + _NOTED_AHEAD_NS
        ahead_s = ahead_ns / _NS_PER_S
        return f"{CLOCK_NOTE} is {ahead_s:.3f} s ahead of the server's"


class PageClock:
    """Compares the page's clock with the server's, by measured round trips and by the arrival of messages."""

    def __init__(self) -> None:
        self.rtt_ns: int | None = None  # the latest measured round trip; None before the first
        self._first: tuple[int, int] | None = None  # time and offset of the first measurement
        self._began_ns: int | None = None  # arrival of the first message
        self._looked_ns = 0  # time of the last comparison
        # lag of the fastest message: since the last comparison, between the last two, and in the first minute
        self._lag_ns = _NEVER_NS
        self._last_lag_ns = _NEVER_NS
        self._least_lag_ns = _NEVER_NS

    def arrive(self, at_ns: int, arrival_ns: int) -> str:
        """Compare a message's time with its time of arrival; only the fastest messages are informative.

        Args:
            at_ns: the message's time by the page's clock, in nanoseconds.
            arrival_ns: the time of arrival by the server's clock, in nanoseconds.

        Returns:
            A note if a page that measures nothing moved its time; otherwise "".
        """
        if self._began_ns is None:
            self._began_ns = arrival_ns
            self._looked_ns = arrival_ns
        self._lag_ns = min(self._lag_ns, arrival_ns - at_ns)
        if arrival_ns - self._looked_ns < _LOOK_INTERVAL_NS:
            return ""
        is_early = arrival_ns - self._began_ns < _DRIFT_AFTER_NS
        return self._note_drift(arrival_ns, error_ns=_UNMEASURED_ERROR_NS, is_early=is_early)

    def look(self, link: Linked, arrival_ns: int) -> str:
        """Compare the clocks after a measured round trip; return a note if the page's moved too far, otherwise ""."""
        return self._note_drift(arrival_ns, error_ns=link.error_ns, is_early=link.drift_ppm is None)

    def _note_drift(self, arrival_ns: int, *, error_ns: int, is_early: bool) -> str:
        """Return a note if the page's clock has drifted against the server's, otherwise ""; begin the next comparison.

        A message's lag is its delay on the way plus the difference of the clocks. The least lag of the last two
        intervals, that of a message without delay, is compared with the least of the session's beginning.

        Args:
            arrival_ns: the time now, by the server's clock.
            error_ns: by how much a lag may be wrong.
            is_early: whether the session is still at its beginning.
        """
        self._looked_ns = arrival_ns
        lag_ns = min(self._lag_ns, self._last_lag_ns)
        self._last_lag_ns = self._lag_ns
        self._lag_ns = _NEVER_NS
        if is_early:
            self._least_lag_ns = min(self._least_lag_ns, lag_ns)
        drift_ns = self._least_lag_ns - lag_ns
        if abs(drift_ns) <= _MAX_DRIFT_NS + error_ns:
            return ""
        self._least_lag_ns = lag_ns
        drift_ms = drift_ns / 1e6
        return f"{CLOCK_NOTE} moved by {drift_ms:+.0f} ms against the times at which its messages came"

    def linked(self, at_ns: int, link: RoundTripMessage) -> Linked:
        """Record a measured round trip, and return its log event.

        Args:
            at_ns: the session's time in nanoseconds.
            link: the fastest of the page's latest round trips.
        """
        by_page_ns = link.back - link.sent
        in_server_ns = link.answered - link.received
        rtt_ns = max(0, by_page_ns - in_server_ns)
        error_ns = (rtt_ns + 1) // 2
        offset_ns = ((link.received - link.sent) + (link.answered - link.back)) // 2
        self.rtt_ns = rtt_ns
        if self._first is None:
            self._first = (at_ns, offset_ns)
        first_at_ns, first_offset_ns = self._first
        passed_ns = at_ns - first_at_ns
        drift_ppm = None
        if passed_ns >= _DRIFT_AFTER_NS:
            drift_ppm = (offset_ns - first_offset_ns) / passed_ns * 1e6
        return Linked(at_ns, offset_ns, error_ns, link.latest, rtt_ns, drift_ppm)
