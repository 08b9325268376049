"""The mouse as an axis at the desk: motion that the X server makes, while an episode plays and at no other time."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.inputs import AxisChanged, Input
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from tests.window_host import HostedWindow
from tests.xserver import Typist

pytestmark = pytest.mark.program

SIZE_PX = (640, 360)
MS = 1_000_000
PLAIN = TextScreen("Words", "to read", "Press Enter")
PLAY = PlayScreen(np.full((60, 80, 3), 150, np.uint8), "", "", axes=("mouse_x", "mouse_y"))


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


def sum_motion(heard: list[Input]) -> tuple[float, float]:
    """The pixels to the right and down in all inputs."""
    moved = [one for one in heard if isinstance(one, AxisChanged)]
    x, y = (sum(one.value for one in moved if one.axis == axis) for axis in ("mouse_x", "mouse_y"))
    return x, y


def move(desk: tuple[HostedWindow, Typist], screen: Screen, motions_px: list[tuple[int, int]]) -> list[Input]:
    window, typist = desk
    window.show(screen)
    hear(window)
    heard: list[Input] = []
    for right_px, down_px in motions_px:
        typist.move(right_px, down_px)
        heard += window.wait(time.monotonic_ns() + 20 * MS)
    return [*heard, *hear(window)]


def test_the_mouse_moves_axes_while_an_episode_plays(desk: tuple[HostedWindow, Typist]) -> None:
    desk[1].point(TITLE, 0.5, 0.5)
    motions = [(40, 0), (0, 12), (-7, -3)] + [(60, 0)] * 20  # further than the screen's edge
    assert sum_motion(move(desk, PLAY, motions)) == (1233.0, 9.0)
    assert move(desk, PLAIN, [(30, 5)]) == [], "a text gives the mouse back"
    assert sum_motion(move(desk, PLAY, [(-25, 0)])) == (-25.0, 0.0), "nothing of before the screen came counts"


def test_a_window_without_the_focus_hears_no_motion(desk: tuple[HostedWindow, Typist]) -> None:
    window, typist = desk
    window.show(PLAY)
    typist.unfocus()
    hear(window)
    assert sum_motion(move(desk, PLAY, [(30, 5)])) == (0.0, 0.0)
