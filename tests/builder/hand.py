"""A hand at the builder's page: it clicks, drags and types, and counts what it does."""

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.warm_start import start_program
from tests.web.browser import PATIENCE_MS, browsing


@contextmanager
def open_desk(folder: Path) -> Iterator[str]:
    """Serve the desk of a folder; yields the address of the builder."""
    words = ("desk", str(folder), "--data", str(folder / "sessions"), "--no-browser")
    with start_program(*words) as desk:
        assert desk.stdout is not None
        line = desk.stdout.readline()
        address = re.search(r"http://\S+", line)
        assert address is not None, line
        try:
            yield f"{address[0]}builder/"
        finally:
            desk.terminate()


class Hand:
    """What a person does on the page.

    Args:
        page: the page of a browser.
    """

    def __init__(self, page: Any) -> None:
        self.page = page
        self.clicks = 0
        self.keys = 0

    def click(self, element: Any) -> None:
        """Click an element once."""
        element.click()
        self.clicks += 1

    def drag(self, element: Any, target: Any) -> None:
        """Drag an element onto another, which counts as a click."""
        element.drag_to(target)
        self.clicks += 1

    def stroke(self, area: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag across an area, from one share of its width and height to another, which counts as a click."""
        box = area.bounding_box()
        for number, (x, y) in enumerate((start, end)):
            self.page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"], steps=1 + 15 * number)
            if number == 0:
                self.page.mouse.down()
        self.page.mouse.up()
        self.clicks += 1

    def choose(self, element: Any, option: str) -> None:
        """Choose an option of a list: a click that opens it, and one on the option."""
        element.select_option(option)
        self.clicks += 2

    def type(self, element: Any, text: str) -> None:
        """Replace the text of a field, and leave it with Tab; no key may go elsewhere, such as into the preview."""
        element.click()
        element.press("Control+a")
        element.press_sequentially(text)
        assert element.input_value() == text
        element.press("Tab")
        self.clicks += 1
        self.keys += len(text) + 2

    def paste(self, element: Any, text: str) -> None:
        """Paste what a spreadsheet copied."""
        element.click()
        element.evaluate(
            """(element, text) => {
              const clipboardData = new DataTransfer();
              clipboardData.setData("text/plain", text);
              element.dispatchEvent(new ClipboardEvent("paste", { clipboardData, bubbles: true, cancelable: true }));
            }""",
            text,
        )
        self.clicks += 1
        self.keys += 2

    def button(self, name: str, *, exact: bool = True) -> Any:
        """Find a button by its name."""
        return self.page.get_by_role("button", name=name, exact=exact)

    def wait_for_preview(self, text: str) -> None:
        """Wait until the preview shows a text; each change replaces its frame."""
        until_s = time.monotonic() + PATIENCE_MS / 1000
        while not any(text in self.read_frame(frame) for frame in self.page.frames[1:]):
            assert time.monotonic() < until_s, f"the preview never shows {text!r}"
            self.page.wait_for_timeout(50)

    def read_frame(self, frame: Any) -> str:
        """Return the text of a frame; "" while it is replaced."""
        try:
            return str(frame.evaluate("document.body.innerText"))
        except pytest.importorskip("playwright.sync_api").Error:  # it is being replaced
            return ""

    def wait_until_saved(self) -> None:
        """Wait until the server has answered every edit."""
        self.page.get_by_role("status").filter(has_text=re.compile("^(Saved|[0-9]+ mistake)")).wait_for()


@contextmanager
def at_the_page(folder: Path, *, size: tuple[int, int] = (1440, 900)) -> Iterator[tuple[Hand, str]]:
    """Open the builder of a folder in a browser."""
    with open_desk(folder) as address, browsing(size=size) as sit_down:
        somebody = sit_down(address)
        yield Hand(somebody.page), address
        assert somebody.errors == []
