"""What every window promises: pygame, pyglet (both majors) and the scripted one, through the same tests.

Real windows run under Xvfb and are typed into by the X server itself (XTEST).
"""

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from minihuman.display.drawing.screen import compose_screen
from minihuman.display.windows.blocking_window import TITLE
from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.experiment.keys import KEY_NAMES
from minihuman.experiment.machine.inputs import FocusChanged, KeyDown, KeyUp, Stop
from minihuman.experiment.machine.screens import PlayScreen
from minihuman.testing.device_contract import CHECKS, MS, SCREENS, SECOND, TypedWindow, list_strokes
from tests.machine import needs
from tests.window_host import HostedWindow
from tests.xserver import Typist, xvfb

pytestmark = pytest.mark.program

SIZE_PX = (640, 360)
OTHER_PYGLET = "MINIHUMAN_OTHER_PYGLET"  # a folder made by `pip install --target FOLDER "pyglet>=2,<3"`


class ScriptedDesk(TypedWindow):
    def __init__(self) -> None:
        self._clock = VirtualClock()
        self.window = ScriptedWindow((Stop(3600 * SECOND, "signal"),), self._clock, frame_ns=16 * MS)

    def type(self, strokes: Sequence[tuple[str, bool]]) -> None:
        t_ns = self._clock()
        script = [KeyDown(t_ns, key) if down else KeyUp(t_ns, key) for key, down in strokes]
        self.window = ScriptedWindow([*script, Stop(3600 * SECOND, "signal")], self._clock, frame_ns=16 * MS)

    def now_ns(self) -> int:
        return self._clock()


class RealDesk(TypedWindow):
    def __init__(self, kind: str, display: str, python_path: str = "") -> None:
        self.typist = Typist(display)
        self.window: HostedWindow = HostedWindow(kind, display, size_px=SIZE_PX, python_path=python_path)
        self.window.show(SCREENS[0])
        self.typist.focus(TITLE)
        self.settle()

    def type(self, strokes: Sequence[tuple[str, bool]]) -> None:
        for key, down in strokes:
            if down:
                self.typist.press(key)
            else:
                self.typist.release(key)

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def settle(self) -> None:
        """Throw away what an earlier test or the window's opening left."""
        while self.window.wait(time.monotonic_ns() + 30 * MS):
            pass

    def end(self) -> None:
        self.window.end()
        self.typist.close()


class Desks:
    """Real desks by kind of window, each set up once, on a display of its own."""

    KINDS = ("pygame", "pyglet", "other pyglet") if OTHER_PYGLET in os.environ else ("pygame", "pyglet")

    def __init__(self) -> None:
        self._open: dict[str, RealDesk] = {}
        self._to_close = ExitStack()

    def ready(self, kind: str) -> RealDesk:
        """The desk with that window, with the keyboard in it and nothing left to hear."""
        if kind not in self._open:
            folder = os.environ.get(OTHER_PYGLET, "")
            display = self._to_close.enter_context(xvfb())
            desk = RealDesk("pyglet", display, folder) if kind == "other pyglet" else RealDesk(kind, display)
            self._to_close.callback(desk.end)
            self._open[kind] = desk
        desk = self._open[kind]
        desk.typist.focus(TITLE)
        desk.settle()
        return desk

    def close(self) -> None:
        self._to_close.close()


@pytest.fixture(scope="module")
def desks() -> Iterator[Desks]:
    desks = Desks()
    yield desks
    desks.close()


REAL = [pytest.param(kind, marks=needs("xvfb")) for kind in Desks.KINDS]


@pytest.fixture(params=REAL)
def real_desk(request: pytest.FixtureRequest, desks: Desks) -> RealDesk:
    return desks.ready(request.param)


@pytest.fixture(params=["scripted", *REAL])
def desk(request: pytest.FixtureRequest, desks: Desks) -> TypedWindow:
    return ScriptedDesk() if request.param == "scripted" else desks.ready(request.param)


@needs("other pyglet")
def test_both_majors_of_pyglet_take_part(desks: Desks) -> None:
    versions = {desks.ready(kind).window.facts()["window_version"][:8] for kind in ("pyglet", "other pyglet")}
    assert versions == {"pyglet 1", "pyglet 2"}


@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_every_window_keeps_what_windows_promise(desk: TypedWindow, check: Callable[[TypedWindow], None]) -> None:
    check(desk)


def test_without_a_deadline_it_sleeps_until_a_key_comes(real_desk: RealDesk) -> None:
    later = threading.Timer(0.2, real_desk.typist.tap, ("7",))
    later.start()
    heard = real_desk.window.wait(None)
    later.join()
    heard += real_desk.hear(2 - len(heard))
    assert list_strokes(heard) == [("7", True), ("7", False)]


def test_a_held_key_repeats_and_says_so(real_desk: RealDesk) -> None:
    real_desk.typist.press("8")
    heard = real_desk.hear(4)
    real_desk.typist.release("8")
    heard += real_desk.hear(1)
    assert [getattr(happened, "repeat", None) for happened in heard[:4]] == [False, True, True, True]
    assert {happened.key for happened in heard} == {"8"}
    assert sum(isinstance(happened, KeyUp) for happened in heard) == 1


def test_every_key_is_called_by_its_place(real_desk: RealDesk) -> None:
    there = sorted(key for key in KEY_NAMES - {"caps_lock", "num_lock"} if real_desk.typist.keycode(key))
    assert len(there) > 80
    real_desk.typist.tap(*there)
    assert list_strokes(real_desk.hear(2 * len(there))) == [(key, down) for key in there for down in (True, False)]


@needs("setxkbmap")
def test_on_a_french_keyboard_the_keys_keep_their_names_and_tell_the_layouts(real_desk: RealDesk) -> None:
    real_desk.typist.set_layout("fr")
    try:
        real_desk.settle()
        real_desk.typist.tap_place("1")
        real_desk.typist.tap_place("q")
        heard = [happened for happened in real_desk.hear(4) if isinstance(happened, KeyDown)]
    finally:
        real_desk.typist.set_layout("us")
        real_desk.settle()
    assert [happened.key for happened in heard] == ["1", "q"]
    assert heard[0].symbol in ("1", "ampersand")  # SDL calls the digit row by its digits, also where they need Shift
    assert heard[1].symbol.lower() == "a"


def test_what_is_on_the_display_is_what_was_composed(real_desk: RealDesk) -> None:
    played = SCREENS[3]
    assert isinstance(played, PlayScreen)
    steps = [replace(played, picture=np.full((56, 56, 3), shade, np.uint8)) for shade in (30, 60, 90)]
    for screen in (*SCREENS, *steps, replace(steps[0], progress="episode 2 of 2"), SCREENS[0]):
        real_desk.window.show(screen)
        assert np.array_equal(real_desk.typist.picture(TITLE), compose_screen(screen, SIZE_PX))


def test_losing_and_finding_the_keyboard_are_told(real_desk: RealDesk) -> None:
    real_desk.typist.unfocus()
    (lost,) = [happened for happened in real_desk.hear(1) if isinstance(happened, FocusChanged)]
    real_desk.typist.focus(TITLE)
    (found,) = [happened for happened in real_desk.hear(1) if isinstance(happened, FocusChanged)]
    assert (lost.focused, found.focused) == (False, True)


def test_a_key_held_while_the_keyboard_goes_does_not_repeat(real_desk: RealDesk) -> None:
    real_desk.typist.press("9")
    real_desk.hear(1)
    real_desk.typist.unfocus()
    real_desk.hear(1)
    until_ns = real_desk.now_ns() + 700 * MS
    heard = []
    while real_desk.now_ns() < until_ns:
        heard += real_desk.window.wait(until_ns)
    real_desk.typist.release("9")
    assert not [happened for happened in heard if isinstance(happened, KeyDown)]


def test_a_picture_of_the_stated_size_is_shown_as_it_is(real_desk: RealDesk) -> None:
    width, height = real_desk.window.picture_px or (0, 0)
    picture = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
    real_desk.window.show(PlayScreen(picture, "", ""))
    shown = real_desk.typist.picture(TITLE)
    left = (SIZE_PX[0] - width) // 2
    tops = [
        top for top in range(SIZE_PX[1] - height + 1) if np.array_equal(shown[top, left : left + width], picture[0])
    ]
    assert len(tops) == 1
    assert np.array_equal(shown[tops[0] : tops[0] + height, left : left + width], picture)


def test_clicking_the_cross_is_an_input_and_closes_nothing(real_desk: RealDesk) -> None:
    real_desk.typist.ask_to_close(TITLE)
    (stop,) = real_desk.hear(1)
    assert isinstance(stop, Stop)
    assert stop.reason == "window_closed"
    real_desk.window.show(SCREENS[0])


@pytest.mark.parametrize("kind", ["pygame", "pyglet"])
def test_closing_twice_is_closing_once(kind: str, display: str) -> None:
    window = HostedWindow(kind, display, size_px=SIZE_PX)
    window.close()
    window.close()
    window.end()
