"""Signs of life of one seat's page and person, and the state of the page. Reads no clock.

Whatever a page sends is a sign of life of the page, a ping included. A key, a click, a touch, text and a change of
focus are signs of life of the person. An open page does not imply that a person is present, and a person who is
thinking is not absent.
"""

from dataclasses import dataclass
from typing import Literal

# open: the page's socket is open; closed, left: the page announced that it was closed, or gave way to another page;
# offline: the socket broke without an announcement
PageState = Literal["open", "closed", "left", "offline"]
# silent: the socket is open, but nothing arrives, as when the machine sleeps
SeatState = Literal["here", "idle", "unfocused", "silent", "closed", "left", "offline"]


@dataclass(slots=True)
class LifeSigns:
    """The last signs of life at one seat. Times are monotonic, in seconds; None if there has been no sign."""

    page: PageState = "open"
    page_s: float | None = None  # the page's last sign of life
    person_s: float | None = None  # the person's last sign of life
    has_focus: bool = True  # whether the page has the keyboard focus
    tells_acts: bool = False  # whether the page reports everything that the person does; otherwise only inputs

    def hear(self, now_s: float) -> None:
        """Record that the page sent something."""
        self.page_s = now_s

    def open_page(self, now_s: float) -> None:
        """Record that the page is open."""
        self.page = "open"
        self.hear(now_s)

    def lose_page(self, state: PageState, now_s: float) -> None:
        """Record that the page is gone; ``state`` says how.

        A page that was closed or gave way to another gives a last sign of life; a broken connection does not.
        """
        self.page = state
        if state != "offline":
            self.hear(now_s)

    def act(self, now_s: float) -> None:
        """Record that the person did something."""
        self.person_s = now_s
        self.hear(now_s)

    def turn_focus(self, now_s: float, *, has_focus: bool) -> None:
        """Record that the person switched to another window or, if ``has_focus``, returned to the page."""
        self.has_focus = has_focus
        self.act(now_s)
