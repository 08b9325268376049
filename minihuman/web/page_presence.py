"""Whether a page is here: which of its sockets counts, and when it and its participant were last heard of. No I/O."""

from minihuman.experiment.machine.life_signs import LifeSigns
from minihuman.experiment.plan.session_plan import SessionPlan

MAX_SIGN_INTERVAL_S = 4.5  # between two pings, where no other participant waits
_GOING_AWAY = 1001  # a browser closes a socket with this code when its page is closed or gives way to another


class PagePresence:
    """Tracks a connection's newest socket, and when its page was last heard of. Times are monotonic, s.

    Args:
        now_s: the present time.
        signs: of life, for those who wait for this participant.
    """

    def __init__(self, now_s: float, signs: LifeSigns | None = None) -> None:
        if signs is None:
            signs = LifeSigns()
        self.signs = signs
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
        self.signs.open_page(now_s)
        return self._sockets

    def close_socket(self, number: int, now_s: float, code: int = 0) -> None:
        """Take note that a socket is closed; the page is gone if it was the newest.

        Args:
            number: the socket's.
            now_s: the present time.
            code: that the page closed it with; 0: none, as the connection broke.
        """
        self._seen_s = now_s
        if self.is_newest(number):
            self.is_here = False
            if self.signs.page == "open":
                if code == _GOING_AWAY:
                    self.signs.lose_page("closed", now_s)
                else:
                    self.signs.lose_page("offline", now_s)

    def hear(self, now_s: float) -> None:
        """Take note that something came from the page."""
        self.signs.hear(now_s)

    def bid_farewell(self, now_s: float, *, is_left: bool) -> None:
        """Take note that the page says that it goes: closed, or left for another in its place."""
        if is_left:
            self.signs.lose_page("left", now_s)
        else:
            self.signs.lose_page("closed", now_s)

    def turn_focus(self, now_s: float, *, has_focus: bool) -> None:
        """Take note that the page lost the keyboard, or has it again."""
        self.signs.turn_focus(now_s, has_focus=has_focus)

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
        self.signs.act(now_s)

    def absence_s(self, now_s: float) -> float:
        """Return for how long there has been no page; 0 while it is here."""
        if self.is_here:
            return 0.0
        return now_s - self._seen_s

    def inactivity_s(self, now_s: float) -> float:
        """Return for how long the participant has done nothing."""
        return now_s - self._acted_s


def find_sign_interval_ms(plan: SessionPlan) -> int:
    """Find the longest time in which a session's page may send nothing, as its parts ask for signs of life."""
    asked_s: list[float] = [getattr(part.plan, "sign_interval_s", 0.0) for part in plan.parts]  # not of every kind
    return round(1_000 * min([MAX_SIGN_INTERVAL_S, *filter(None, asked_s)]))
