"""The position in a text with pages, shared by every activity that shows one."""

from minihuman.experiment.machine.activity import ENTER_KEYS
from minihuman.experiment.machine.events import PageShown
from minihuman.experiment.machine.inputs import ScreenShown

FORWARD_KEYS = (*ENTER_KEYS, "right", "page_down", "space")
BACK_KEYS = ("left", "page_up", "backspace")


class PageReader:
    """The open page of a text of ``pages`` pages, and the furthest page that was open, both counted from 0."""

    def __init__(self, pages: int) -> None:
        self.pages = max(1, pages)
        self.page = 0
        self.furthest = 0

    @property
    def at_end(self) -> bool:
        """Return whether the text's last page is open."""
        return self.page == self.pages - 1

    def turn(self, n_pages: int) -> bool:
        """Open the page that is ``n_pages`` further on, -1 for the previous page; return False if there is none."""
        page = self.page + n_pages
        if not 0 <= page < self.pages:
            return False
        self.page = page
        self.furthest = max(self.furthest, page)
        return True


def build_page_shown(part: int, reader: PageReader, screen_shown: ScreenShown) -> PageShown:
    """Build the event that the open page of the part with index ``part`` reached the display."""
    return PageShown(
        screen_shown.t_ns, part, reader.page + 1, reader.pages, screen_shown.submit_ns, screen_shown.flip_ns
    )
