"""Signs of life: when a seat's page and the person before it last gave one, and what is known of the page. No clock.

A page gives one with whatever it sends, a ping included; a person gives one with a key, a click, a touch, a text and a
change of focus. An open page is not a person, and a person who thinks is not absent.
"""

from dataclasses import dataclass
from typing import Literal

# open: its socket is; closed, left: it said so when it was closed, or gave way to another page; offline: its socket
# broke without a word
PageState = Literal["open", "closed", "left", "offline"]
# silent: the socket is open, but nothing comes: the machine sleeps, or the network swallows
SeatState = Literal["here", "idle", "unfocused", "silent", "closed", "left", "offline"]


@dataclass(slots=True)
class LifeSigns:
    """The last signs of life at one seat. Times are monotonic, s; None: there has been none."""

    page: PageState = "open"
    page_s: float | None = None  # of the page
    person_s: float | None = None  # of the person
    has_focus: bool = True  # the page has
    tells_acts: bool = False  # the page tells of each thing that the person does; else only their inputs are known

    def hear(self, now_s: float) -> None:
        """Take note that something came from the page."""
        self.page_s = now_s

    def open_page(self, now_s: float) -> None:
        """Take note that a page is here."""
        self.page = "open"
        self.hear(now_s)

    def lose_page(self, state: PageState, now_s: float) -> None:
        """Take note that the page is gone; one that says so gives a sign of life with it, a broken socket does not."""
        self.page = state
        if state != "offline":
            self.hear(now_s)

    def act(self, now_s: float) -> None:
        """Take note that the person did something."""
        self.person_s = now_s
        self.hear(now_s)

    def turn_focus(self, now_s: float, *, has_focus: bool) -> None:
        """Take note that the person went to another window, or came back."""
        self.has_focus = has_focus
        self.act(now_s)
