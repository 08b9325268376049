"""The clocks of a session in a browser: the session's time, and the page's clock compared with the server's.

No I/O: all times are passed in as arguments.
"""

from minihuman.experiment.machine.events import CLOCK_NOTE, Linked
from minihuman.web.messages import MessageError, RoundTripMessage

_AHEAD_NS = 5_000_000_000  # that a page's clock may be ahead of the server's, and a thousandth of the session's time
_NOTED_AHEAD_NS = 1_000_000_000  # a note is made of a page that is further ahead, and again for each further second
_DRIFT_AFTER_NS = 60_000_000_000  # from the first measurement; over less time jitter hides the drift
_MAX_DRIFT_NS = 200_000_000  # of the page's clock against the server's: 2 % of the 10 s between two measurements
_COMPARISON_INTERVAL_NS = 30_000_000_000  # between comparisons of the messages' arrival times without a measurement
_UNMEASURED_ERROR_NS = 800_000_000  # of such a comparison: the time by which a single message may be delayed
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
        self._caught_up_ns = 0  # by which ``catch_up`` has advanced the session's time
        self._noted_ns = _NOTED_AHEAD_NS  # a message that is further ahead is noted
        self._claimed_ns = _NOTED_AHEAD_NS  # a claim of more time is noted

    def at(self, monotonic_ns: int) -> int:
        """Return the session's time, in nanoseconds, at a monotonic time of the server."""
        return monotonic_ns - self._zero_ns

    def catch_up(self, ahead_ns: int, *, wall_ns: int, monotonic_ns: int) -> str:
        """Advance to the time of a page whose clock ran on, by ``ahead_ns``, while there was no server.

        The page's claim is accepted only up to the time for which this server or the previous one was away, and each
        such time only once.

        Args:
            ahead_ns: the time by which the page's clock is ahead of the session's, in nanoseconds.
            wall_ns: the present time of the wall clock.
            monotonic_ns: the present monotonic time.

        Returns:
            A note if the page claims more than a second, and more than twice its previous claim; otherwise "".
        """
        asleep_ns = max(0, wall_ns - monotonic_ns - self._wall_zero_ns)
        away_ns = max(0, self._outage_ns + asleep_ns - self._caught_up_ns)
        accepted_ns = max(0, min(ahead_ns, away_ns))
        self._zero_ns -= accepted_ns
        self._caught_up_ns += accepted_ns
        if ahead_ns <= self._claimed_ns:
            return ""
        self._claimed_ns = 2 * ahead_ns
        ahead_s = ahead_ns / _NS_PER_S
        accepted_s = accepted_ns / _NS_PER_S
        return f"{CLOCK_NOTE} was claimed to be {ahead_s:.3f} s ahead of the server's; {accepted_s:.3f} s count"

    def allows(self, at_ns: int, now_ns: int) -> bool:
        """Return whether it is plausible that a page's clock reads ``at_ns`` when the session's time is ``now_ns``."""
        return at_ns <= now_ns + _AHEAD_NS + now_ns // 1000

    def check(self, number: int, at_ns: int, now_ns: int) -> str:
        """Check the time that a page claims for a message.

        Args:
            number: the message's number, for the error.
            at_ns: the claimed time, in nanoseconds of the session's time.
            now_ns: the session's time by the server's clock.

        Returns:
            A note if the time is more than a second ahead, or a second more than noted before; otherwise "".

        Raises:
            MessageError: if the time is further ahead of ``now_ns`` than two clocks can differ.
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
        self._compared_ns = 0  # time of the last comparison
        # a message's lag is its time of arrival minus its own time; these are the smallest lags of a period
        self._lag_ns = _NEVER_NS  # since the last comparison
        self._previous_lag_ns = _NEVER_NS  # between the last two comparisons
        self._reference_lag_ns = _NEVER_NS  # in the first minute, or at the last drift that was noted

    def compare_arrival(self, at_ns: int, arrival_ns: int) -> str:
        """Compare a message's time with its time of arrival; only the fastest messages are informative.

        Args:
            at_ns: the message's time by the page's clock, in nanoseconds.
            arrival_ns: the time of arrival by the server's clock, in nanoseconds.

        Returns:
            A note if the clock of a page that measures no round trips has moved; otherwise "".
        """
        if self._began_ns is None:
            self._began_ns = arrival_ns
            self._compared_ns = arrival_ns
        self._lag_ns = min(self._lag_ns, arrival_ns - at_ns)
        if arrival_ns - self._compared_ns < _COMPARISON_INTERVAL_NS:
            return ""
        is_early = arrival_ns - self._began_ns < _DRIFT_AFTER_NS
        return self._note_drift(arrival_ns, error_ns=_UNMEASURED_ERROR_NS, is_early=is_early)

    def compare_round_trip(self, link: Linked, arrival_ns: int) -> str:
        """Compare the clocks after a measured round trip; return a note if the page's clock drifted, otherwise ""."""
        return self._note_drift(arrival_ns, error_ns=link.error_ns, is_early=link.drift_ppm is None)

    def _note_drift(self, arrival_ns: int, *, error_ns: int, is_early: bool) -> str:
        """Return a note if the page's clock has drifted against the server's, otherwise ""; begin the next comparison.

        A message's lag is the sum of its delay in the network and the difference between the two clocks. The fastest
        messages have almost no delay, so the smallest lag of a period shows the difference between the clocks. The
        smallest lag of the last two periods is compared with that of the beginning of the session.

        Args:
            arrival_ns: the present time by the server's clock.
            error_ns: the largest error of a lag.
            is_early: whether this is the beginning of the session.
        """
        self._compared_ns = arrival_ns
        lag_ns = min(self._lag_ns, self._previous_lag_ns)
        self._previous_lag_ns = self._lag_ns
        self._lag_ns = _NEVER_NS
        if is_early:
            self._reference_lag_ns = min(self._reference_lag_ns, lag_ns)
        drift_ns = self._reference_lag_ns - lag_ns
        if abs(drift_ns) <= _MAX_DRIFT_NS + error_ns:
            return ""
        self._reference_lag_ns = lag_ns
        drift_ms = drift_ns / 1e6
        return f"{CLOCK_NOTE} moved by {drift_ms:+.0f} ms against the times at which its messages came"

    def record_round_trip(self, at_ns: int, link: RoundTripMessage) -> Linked:
        """Record a measured round trip; return its event, with the offset and drift of the clocks.

        Args:
            at_ns: the session's time in nanoseconds.
            link: the fastest of the page's latest round trips.
        """
        by_page_ns = link.back - link.sent
        in_server_ns = link.answered - link.received
        rtt_ns = max(0, by_page_ns - in_server_ns)
        error_ns = (rtt_ns + 1) // 2  # half of it, rounded up
        # the mean over both directions, in which the network's delays cancel each other if they are equal
        offset_ns = ((link.received - link.sent) + (link.answered - link.back)) // 2
        self.rtt_ns = rtt_ns
        if self._first is None:
            self._first = (at_ns, offset_ns)
        first_at_ns, first_offset_ns = self._first
        passed_ns = at_ns - first_at_ns
        drift_ppm = None
        if passed_ns >= _DRIFT_AFTER_NS:
            drift_ppm = (offset_ns - first_offset_ns) / passed_ns * 1e6
        return Linked(at_ns, offset_ns, error_ns, rtt_ns=link.latest, least_rtt_ns=rtt_ns, drift_ppm=drift_ppm)
