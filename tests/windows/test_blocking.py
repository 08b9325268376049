"""A window on a real display draws while the log is written, and flips when it is."""

import numpy as np
import pytest
from numpy.typing import NDArray

from minihuman.activities.trials.screens import TrialScreen
from minihuman.display.drawing.play_screens import Box
from minihuman.display.drawing.screen import compose_screen
from minihuman.display.drawing.sheet import Size
from minihuman.display.windows.blocking_window import BlockingWindow
from minihuman.display.windows.window import Clock
from minihuman.errors import LogError
from minihuman.experiment.machine.inputs import Input, KeyDown
from minihuman.experiment.machine.screens import Motion, PlayScreen, TextScreen
from tests.activities.trials.test_timelines import plan_of
from tests.study.sessions import MS, Desk

SIZE_PX = (320, 240)


BLACK = np.zeros((60, 80, 3), np.uint8)


class Steady:
    """A clock that goes on by 4 ms whenever it is looked at."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        self.now_ns += 4_000_000
        return self.now_ns


class Kept(BlockingWindow):
    """Keeps what its display shows."""

    def __init__(self, clock: Clock = lambda: 0) -> None:
        super().__init__(clock)
        self.coming: list[Input] = []
        self.display = np.zeros((SIZE_PX[1], SIZE_PX[0], 3), np.uint8)
        self.flips = 0

    @property
    def size_px(self) -> Size:
        return SIZE_PX

    def _flip(self, frame: NDArray[np.uint8], changed: Box) -> None:
        left, top, width, height = changed
        there = np.s_[top : top + height, left : left + width]
        self.display[there] = frame[there]
        self.flips += 1

    def _arrived(self, timeout_ns: int | None) -> list[Input]:
        arrived, self.coming = self.coming, []
        return arrived

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


def test_a_view_that_moves_is_drawn_frame_by_frame_while_the_window_waits_and_ends_as_it_is() -> None:
    clock = Steady()
    window, whole = Kept(clock), np.full((60, 80, 3), 250, np.uint8)
    shares: list[float] = []

    def draw(share: float) -> NDArray[np.uint8]:
        shares.append(share)
        return np.full((60, 80, 3), round(share * 200), np.uint8)

    screen = PlayScreen(whole, "find it", "1 of 2", motion=Motion(100_000_000, draw))
    shown = window.show(screen)
    assert shown.flip_ns < 20_000_000  # counts from its first frame
    assert window.flips == 1
    window.wait(clock() + 1_000_000_000)
    assert shares == sorted(shares)
    assert len(shares) == 4
    assert window.flips == 5  # and the picture itself
    np.testing.assert_array_equal(window.display, compose_screen(screen, SIZE_PX))


def test_an_input_comes_through_a_view_that_moves_and_the_next_screen_ends_it() -> None:
    clock = Steady()
    window = Kept(clock)
    window.show(PlayScreen(np.zeros((60, 80, 3), np.uint8), "", "", motion=Motion(10**9, lambda share: BLACK)))
    window.coming = [KeyDown(5, "1")]
    assert window.wait(clock() + 1_000_000_000) == [KeyDown(5, "1")]
    assert window.flips == 1
    window.show(TextScreen("one", "words", ""))
    window.wait(clock() + 100_000_000)
    assert window.flips == 2


class Refreshing(Kept):
    """A window whose flips wait for a display of 60 Hz."""

    def facts(self) -> dict[str, str]:
        return {"vsync": "on", "refresh_hz_reported": "60"}


def find_trial_screen() -> TrialScreen:
    desk = Desk(plan_of())
    desk.show()
    due_ns = desk.session.next_tick_ns
    assert due_ns is not None
    desk.pass_ms((due_ns - desk.now_ns) / MS)
    screen = desk.session.screen
    assert isinstance(screen, TrialScreen)
    return screen


@pytest.mark.parametrize(("kind", "before_ms"), [(Kept, 0.0), (Refreshing, 1000 / 60 / 2)])
def test_a_trials_picture_is_handed_over_when_it_is_due_or_half_a_refresh_before(kind, before_ms) -> None:
    screen = find_trial_screen()
    assert screen.due_ns is not None
    clock = Steady()
    clock.now_ns = screen.due_ns - 40 * MS
    shown = kind(clock).show(screen)
    assert 0 <= shown.submit_ns - (screen.due_ns - before_ms * MS) < 12 * MS  # the clock goes on by 4 ms a look


def test_a_key_that_comes_while_a_picture_waits_for_its_time_is_not_lost() -> None:
    screen = find_trial_screen()
    clock = Steady()
    window = Kept(clock)
    assert screen.due_ns is not None
    clock.now_ns = screen.due_ns - 40 * MS
    window.coming = [KeyDown(5, "1")]
    window.show(screen)
    assert window.wait(clock() + 1) == [KeyDown(5, "1")]
