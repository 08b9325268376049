"""Keys are stamped when they move, not when a window that was busy comes round to them."""

import time
from collections.abc import Iterator

import pytest

from minihuman.display.windows.blocking_window import TITLE
from minihuman.display.windows.x11_input import convert_server_time
from minihuman.experiment.machine.inputs import KeyDown, KeyUp
from minihuman.experiment.machine.screens import TextScreen
from tests.window_host import HostedWindow
from tests.xserver import Typist

pytestmark = pytest.mark.program
MS = 1_000_000


@pytest.fixture(params=("pygame", "pyglet"))
def window(request: pytest.FixtureRequest, display: str) -> Iterator[tuple[HostedWindow, Typist]]:
    typist, window = Typist(display), HostedWindow(request.param, display, size_px=(640, 360))
    window.show(TextScreen("One", "two", "three"))
    typist.focus(TITLE)
    while window.wait(time.monotonic_ns() + 50 * MS):
        pass
    yield window, typist
    window.end()
    typist.close()


def test_keys_that_come_while_nobody_waits_have_each_their_own_time(window: tuple[HostedWindow, Typist]) -> None:
    told, typist = window
    sent = []
    for key in ("1", "2", "1", "3"):
        for act in (typist.press, typist.release):
            before_ns = time.monotonic_ns()
            act(key)
            sent.append((before_ns, time.monotonic_ns()))
            time.sleep(0.02)
    time.sleep(0.3)  # as a picture takes that long
    heard = []
    while len(heard) < len(sent):
        heard += [one for one in told.wait(time.monotonic_ns() + 500 * MS) if isinstance(one, KeyDown | KeyUp)]
    assert [one.key for one in heard] == ["1", "1", "2", "2", "1", "1", "3", "3"]
    for one, (before_ns, after_ns) in zip(heard, sent, strict=True):
        assert before_ns <= one.t_ns <= after_ns + 2 * MS
    assert len({one.t_ns for one in heard}) == len(heard)


def test_what_is_typed_elsewhere_is_not_taken_for_what_is_typed_here(window: tuple[HostedWindow, Typist]) -> None:
    told, typist = window
    typist.unfocus()
    typist.tap("1", "2", "1")
    time.sleep(0.1)
    typist.focus(TITLE)
    before_ns = time.monotonic_ns()
    typist.tap("1")
    heard = []
    while len(heard) < 2:
        heard += [one for one in told.wait(time.monotonic_ns() + 500 * MS) if isinstance(one, KeyDown | KeyUp)]
    assert [one.key for one in heard] == ["1", "1"]
    assert all(one.t_ns >= before_ns for one in heard)


def test_the_windows_say_where_the_times_are_from(window: tuple[HostedWindow, Typist]) -> None:
    assert window[0].facts()["key_times"].startswith("X server")


def test_a_stamp_that_cannot_be_true_gives_the_time_now() -> None:
    now_ns = time.monotonic_ns()
    ahead = (now_ns // MS + 5_000) % 2**32
    assert convert_server_time(ahead, time.monotonic_ns) >= now_ns
    assert convert_server_time((now_ns // MS - 120_000) % 2**32, time.monotonic_ns) >= now_ns


def test_a_stamp_is_late_by_a_millisecond_at_most_also_when_the_servers_count_begins_again() -> None:
    now_ns = time.monotonic_ns()
    for age_ms in (0, 1, 250):
        happened_ns = now_ns - age_ms * MS
        stamp_ns = convert_server_time((happened_ns // MS) % 2**32, time.monotonic_ns)
        assert happened_ns <= stamp_ns <= happened_ns + MS
