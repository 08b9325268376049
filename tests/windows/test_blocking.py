"""A window on a real display draws while the log is written, and flips when it is."""

import numpy as np
import pytest
from numpy.typing import NDArray

from minihuman.display.drawing.play_screens import Box
from minihuman.display.drawing.screen import compose_screen
from minihuman.display.drawing.sheet import Size
from minihuman.display.windows.blocking_window import BlockingWindow
from minihuman.errors import LogError
from minihuman.experiment.machine.inputs import Input
from minihuman.experiment.machine.screens import TextScreen

SIZE_PX = (320, 240)


class Kept(BlockingWindow):
    """Keeps what its display shows."""

    def __init__(self) -> None:
        super().__init__(lambda: 0)
        self.display = np.zeros((SIZE_PX[1], SIZE_PX[0], 3), np.uint8)
        self.flips = 0

    @property
    def size_px(self) -> Size:
        return SIZE_PX

    def _flip(self, frame: NDArray[np.uint8], changed: Box) -> None:
        left, top, right, bottom = changed
        self.display[top:bottom, left:right] = frame[top:bottom, left:right]
        self.flips += 1

    def _arrived(self, timeout_ns: int | None) -> list[Input]:
        return []

    def _want(self, *, text: bool, pointer: bool) -> None:
        pass

    def post_key(self, key: str) -> None:
        pass

    def facts(self) -> dict[str, str]:
        return {}

    def close(self) -> None:
        pass


def test_a_screen_is_flipped_when_its_log_is_written() -> None:
    window, flips = Kept(), []
    window.show_after(TextScreen("one", "words", ""), lambda: flips.append(window.flips))
    assert (flips, window.flips) == ([0], 1)


def test_what_was_drawn_and_could_not_be_written_leaves_no_trace() -> None:
    window = Kept()
    window.show(TextScreen("one", "words", ""))
    before = window.display.copy()

    def full() -> None:
        raise LogError("no space left")

    with pytest.raises(LogError):
        window.show_after(TextScreen("two", "words", ""), full)
    assert np.array_equal(window.display, before)
    said = TextScreen("one", "no room", "")
    window.show(said)
    assert np.array_equal(window.display, compose_screen(said, SIZE_PX))


def test_no_two_keys_have_one_time_even_where_the_toolkit_gives_them_one() -> None:
    window = Kept()
    heard = [window._key(True, "a", "a", 50), window._key(True, "b", "b", 50), window._key(False, "a", "a", 49)]
    assert [event.t_ns for (event,) in heard] == [50, 51, 52]
