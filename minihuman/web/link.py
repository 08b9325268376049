"""How the page's clock lies to the server's: by the message that was quickest there and back. No I/O, no clock."""

from minihuman.study.events import Linked
from minihuman.web.wire import Link

_DRIFT_AFTER_NS = 60_000_000_000  # before, drift drowns in the line's own unrest


class LinkClock:
    """Takes what the page measured, and says it for the log."""

    def __init__(self) -> None:
        self.rtt_ns: int | None = None  # of the quickest of the latest; None until one was measured
        self._first: tuple[int, int] | None = None  # time and offset of the first

    def linked(self, at_ns: int, link: Link) -> Linked:
        """An event for the log.

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
        drift = (offset_ns - self._first[1]) / passed_ns * 1e6 if passed_ns >= _DRIFT_AFTER_NS else None
        return Linked(at_ns, offset_ns, -(-least_ns // 2), link.latest, least_ns, drift)
