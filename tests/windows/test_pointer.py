"""The mouse and typed text, made by the X server, on screens that want them and on those that do not."""

import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from minihuman.display.drawing.play_screens import locate_picture
from minihuman.display.drawing.screen import find_spot
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.inputs import (
    Input,
    KeyDown,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    TextEdited,
    TextInput,
)
from minihuman.experiment.machine.screens import (
    CanvasShape,
    OptionList,
    PlayScreen,
    QuestionScreen,
    Screen,
    ShapeCanvas,
    Slider,
    TextField,
    TextScreen,
)
from tests.window_host import HostedWindow
from tests.xserver import Typist

pytestmark = pytest.mark.program

SIZE_PX = (640, 360)
MS = 1_000_000
CHOICE = QuestionScreen("", "Which one?", OptionList(("this", "that"), (), 0), "")
COLOURS = tuple(
    CanvasShape(n / 2, 0, 0.4, 1, str(n + 1), f"option:{n}", fill=fill) for n, fill in enumerate(("#aa3311", "#2266cc"))
)
SWATCH = QuestionScreen("", "Which colour?", ShapeCanvas(COLOURS), "")
SLIDER = QuestionScreen("", "How much?", Slider("little", "much", None, "", 10), "")
ENTRY = QuestionScreen("", "What?", TextField("", 0, False), "")
PLAIN = TextScreen("Words", "to read", "Press Enter")


@pytest.fixture(scope="module", params=("pygame", "pyglet"))
def desk(request: pytest.FixtureRequest, display: str) -> Iterator[tuple[HostedWindow, Typist]]:
    typist, window = Typist(display), HostedWindow(request.param, display, size_px=SIZE_PX)
    window.show(PLAIN)
    typist.focus(TITLE)
    yield window, typist
    window.end()
    typist.close()


def hear(window: HostedWindow, quiet_ms: int = 300) -> list[Input]:
    heard: list[Input] = []
    while got := window.wait(time.monotonic_ns() + quiet_ms * MS):
        heard += got
    return heard


def middle_of(screen: Screen, name: str) -> tuple[float, float]:
    inside = [
        (x, y)
        for x, y in product(np.linspace(0, 1, 160), np.linspace(0, 1, 90))
        if find_spot(screen, SIZE_PX, float(x), float(y))[0] == name
    ]
    x, y = np.mean(inside, axis=0)
    return float(x), float(y)


@pytest.mark.parametrize("screen", [CHOICE, SWATCH])
def test_a_click_says_on_what(desk: tuple[HostedWindow, Typist], screen: Screen) -> None:
    window, typist = desk
    window.show(screen)
    typist.point(TITLE, *middle_of(screen, "option:1"))
    hear(window)
    typist.button(True)
    typist.button(False)
    pressed, released = hear(window)
    assert isinstance(pressed, PointerPressed)
    assert isinstance(released, PointerReleased)
    assert (pressed.target, released.target) == ("option:1", "option:1")


def test_a_slider_is_drawn_along_and_beyond(desk: tuple[HostedWindow, Typist]) -> None:
    window, typist = desk
    window.show(SLIDER)
    x, y = middle_of(SLIDER, "slider")
    typist.point(TITLE, x, y)
    hear(window)
    typist.button(True)
    for further in (x + 0.1, x + 0.2, 0.99):
        typist.point(TITLE, further, y)
    typist.button(False)
    heard = hear(window)
    assert isinstance(heard[0], PointerPressed)
    assert isinstance(heard[-1], PointerReleased)
    assert all(isinstance(one, PointerMoved) for one in heard[1:-1])
    alongs = [one.along for one in heard if isinstance(one, PointerPressed | PointerMoved | PointerReleased)]
    assert alongs == sorted(alongs)
    assert alongs[0] == pytest.approx(0.5, abs=0.05)
    assert alongs[-1] == 1.0
    assert {one.target for one in heard if not isinstance(one, KeyDown)} == {"slider"}


def test_text_is_told_of_where_it_is_wanted_beside_the_keys(desk: tuple[HostedWindow, Typist]) -> None:
    window, typist = desk
    window.show(ENTRY)
    hear(window)
    typist.tap("a", "7", "enter")
    heard = hear(window)
    assert "".join(one.text for one in heard if isinstance(one, TextInput)) == "a7"
    assert [one.key for one in heard if isinstance(one, KeyDown)] == ["a", "7", "enter"]


def test_elsewhere_neither_mouse_nor_text_is_told_of(desk: tuple[HostedWindow, Typist]) -> None:
    window, typist = desk
    window.show(PLAIN)
    hear(window)
    typist.point(TITLE, 0.4, 0.4)
    typist.button(True)
    typist.button(False)
    typist.tap("b")
    heard = hear(window)
    assert not [one for one in heard if isinstance(one, TextInput | PointerPressed | PointerMoved | PointerReleased)]
    assert [one.key for one in heard if isinstance(one, KeyDown)] == ["b"]


def test_a_click_while_the_window_is_busy_has_its_own_time(desk: tuple[HostedWindow, Typist]) -> None:
    window, typist = desk
    window.show(CHOICE)
    typist.point(TITLE, *middle_of(CHOICE, "option:1"))
    hear(window)
    sent = []
    for down in (True, False):
        before_ns = time.monotonic_ns()
        typist.button(down)
        sent.append((before_ns, time.monotonic_ns()))
        time.sleep(0.05)
    time.sleep(0.2)  # as a picture takes that long
    clicks = [one for one in hear(window) if isinstance(one, PointerPressed | PointerReleased)]
    assert len(clicks) == 2
    for click, (before_ns, after_ns) in zip(clicks, sent, strict=True):
        assert before_ns <= click.t_ns <= after_ns + 2 * MS


def test_a_press_that_led_to_a_world_leaves_it_open_to_the_next_click(desk: tuple[HostedWindow, Typist]) -> None:
    window, typist = desk
    window.show(CHOICE)
    typist.point(TITLE, *middle_of(CHOICE, "option:1"))
    hear(window)
    typist.button(True)
    hear(window)
    window.show(PlayScreen(np.full((100, 200, 3), 90, np.uint8), "", "", accepts_pointer=True))
    typist.point(TITLE, 0.5, 0.5)
    typist.button(False)
    typist.button(True)
    typist.button(False)
    clicks = [one for one in hear(window) if isinstance(one, PointerPressed)]
    assert [one.target for one in clicks] == ["picture"]


def test_a_click_in_the_worlds_picture_says_where_in_it(desk: tuple[HostedWindow, Typist]) -> None:
    window, typist = desk
    picture = np.full((100, 200, 3), 90, np.uint8)
    for takes_clicks in (False, True):
        window.show(PlayScreen(picture, "", "", accepts_pointer=takes_clicks))
        left, top, width, height = locate_picture(picture, SIZE_PX)
        typist.point(TITLE, (left + width * 0.25) / SIZE_PX[0], (top + height * 0.75) / SIZE_PX[1])
        typist.button(True)
        typist.button(False)
        typist.point(TITLE, (left + width * 0.5) / SIZE_PX[0], (top + height * 1.05) / SIZE_PX[1])
        typist.button(True)
        typist.button(False)
        clicks = [one for one in hear(window) if isinstance(one, PointerPressed)]
        assert [one.target for one in clicks] == ["picture"] * takes_clicks
    assert (clicks[0].x, clicks[0].y) == pytest.approx((0.25, 0.75), abs=0.01)


@pytest.mark.parametrize("is_long", [True, False])
def test_a_text_is_edited_by_keys_and_mouse_and_arrives_whole(desk: tuple[HostedWindow, Typist], is_long: bool) -> None:
    window, typist = desk
    window.show(PLAIN)
    window.show(replace(ENTRY, item=replace(ENTRY.item, long=is_long, native=True, name="what")))
    hear(window)
    typist.tap("a", "7", "a")
    typist.press("Shift_L")
    typist.tap("Left", "Left")
    typist.release("Shift_L")
    typist.tap("b")  # over what was selected
    typist.press("Control_L")
    typist.tap("a", "c")
    typist.release("Control_L")
    typist.tap("End")
    typist.press("Control_L")
    typist.tap("v", "z")
    typist.release("Control_L")
    typist.tap("Return" if is_long else "c")
    heard = hear(window, quiet_ms=900)
    [edited] = [one for one in heard if isinstance(one, TextEdited)]
    assert edited.text == ("ab\n" if is_long else "abc")
    assert set(edited.changes) == {"typed", "pasted", "undone"}
    assert not [one for one in heard if isinstance(one, KeyDown | TextInput)]
    typist.tap("Tab")
    assert [one.key for one in hear(window) if isinstance(one, KeyDown)] == ["tab"]
