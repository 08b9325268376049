"""Whether a page is connected, which of its sockets is current, and when the page and its participant were last active.

No I/O.
"""

from minihuman.experiment.machine.life_signs import LifeSigns
from minihuman.experiment.plan.session_plan import SessionPlan

MAX_SIGN_INTERVAL_S = 4.5  # between two pings, where no other participant waits
_GOING_AWAY = 1001  # a browser closes a socket with this code when its page is closed or gives way to another


class PagePresence:
    """Tracks a connection's newest socket and its page's last signs of life. Times are monotonic, in seconds.

    Args:
        now_s: the present time.
        signs: the signs of life that other participants of a team wait for.
    """

    def __init__(self, now_s: float, signs: LifeSigns | None = None) -> None:
        if signs is None:
            signs = LifeSigns()
        self.signs = signs
        self.is_here = False  # whether the newest socket is open
        self.dismissal_code = 0  # the closing code for a page whose session another server has; 0 if none has it
        self._sockets = 0  # the number of sockets so far, which is the newest one's number
        self._seen_s = now_s
        self._acted_s = now_s

    def open_socket(self, now_s: float) -> int:
        """Make a new socket the current one, and return its number."""
        self._sockets += 1
        self.is_here = True
        self._seen_s = now_s
        self.signs.open_page(now_s)
        return self._sockets

    def close_socket(self, number: int, now_s: float, code: int = 0) -> None:
        """Record that a socket was closed; the page is gone if it was the newest one.

        Args:
            number: the socket's number.
            now_s: the present time.
            code: the code with which the page closed the socket; 0 if the connection broke.
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
        """Record that a message arrived from the page."""
        self.signs.hear(now_s)

    def bid_farewell(self, now_s: float, *, is_left: bool) -> None:
        """Record the page's announcement that it is being closed or replaced by another page."""
        if is_left:
            self.signs.lose_page("left", now_s)
        else:
            self.signs.lose_page("closed", now_s)

    def turn_focus(self, now_s: float, *, has_focus: bool) -> None:
        """Record that the page lost or regained the keyboard focus."""
        self.signs.turn_focus(now_s, has_focus=has_focus)

    def is_newest(self, number: int) -> bool:
        """Return whether a socket is the current one."""
        return number == self._sockets

    def dismiss(self, code: int) -> None:
        """Record that the page is to be disconnected, with a closing code, and accept none of its present sockets."""
        self.dismissal_code = code
        self.is_here = False
        self._sockets += 1

    def record_act(self, now_s: float) -> None:
        """Record that the participant pressed a key, used the pointer or typed."""
        self._acted_s = now_s
        self.signs.act(now_s)

    def compute_absence_s(self, now_s: float) -> float:
        """Return the time, in seconds, for which no page has been connected; 0 while a page is connected."""
        if self.is_here:
            return 0.0
        return now_s - self._seen_s

    def compute_inactivity_s(self, now_s: float) -> float:
        """Return the time since the participant's last act, in seconds."""
        return now_s - self._acted_s


def find_sign_interval_ms(plan: SessionPlan) -> int:
    """Return the longest time, in milliseconds, for which a session's page may send nothing.

    The parts of the plan may require signs of life at shorter intervals than the default.
    """
    part_intervals_s: list[float] = [getattr(part.plan, "sign_interval_s", 0.0) for part in plan.parts]  # 0: none
    return round(1_000 * min([MAX_SIGN_INTERVAL_S, *filter(None, part_intervals_s)]))
