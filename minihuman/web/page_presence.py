"""Whether a page is here: which of its sockets counts, and when it and its participant were last heard of. No I/O."""


class PagePresence:
    """The newest socket of a connection, and when the page was here last. Times are monotonic, s.

    Args:
        now_s: the present time.
    """

    def __init__(self, now_s: float) -> None:
        self.is_here = False  # the newest socket is open
        self.dismissal_code = 0  # with this code the page was sent away: another server has the session
        self._sockets = 0  # how many there have been; the newest counts
        self._seen_s = now_s
        self._acted_s = now_s

    def open_socket(self, now_s: float) -> int:
        """Let a new socket count from here on, and return its number."""
        self._sockets += 1
        self.is_here = True
        self._seen_s = now_s
        return self._sockets

    def close_socket(self, number: int, now_s: float) -> None:
        """Take note that a socket is closed; the page is gone if it was the newest."""
        self._seen_s = now_s
        if self.is_newest(number):
            self.is_here = False

    def is_newest(self, number: int) -> bool:
        """Whether a socket is the one that counts."""
        return number == self._sockets

    def dismiss(self, code: int) -> None:
        """Send the page away, whichever socket it is on."""
        self.dismissal_code = code
        self.is_here = False
        self._sockets += 1

    def record_act(self, now_s: float) -> None:
        """Take note that the participant pressed, pointed at or typed something."""
        self._acted_s = now_s

    def absence_s(self, now_s: float) -> float:
        """Return for how long there has been no page; 0 while it is here."""
        return 0.0 if self.is_here else now_s - self._seen_s

    def inactivity_s(self, now_s: float) -> float:
        """Return for how long the participant has done nothing."""
        return now_s - self._acted_s
