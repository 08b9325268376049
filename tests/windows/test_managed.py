"""What a window manager does to a window, and what is on the screen afterwards."""

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from minihuman.display.drawing.screen import compose_screen
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from tests.counts import PATIENCE_S
from tests.desktop import Desktop, desktop
from tests.machine import needs
from tests.window_host import HostedWindow

pytestmark = [pytest.mark.program, needs("openbox", "xvfb")]

SIZE_PX = (640, 360)
PLAY = PlayScreen(np.full((56, 56, 3), 200, np.uint8), "reach the green goal", "episode 1 of 2", (("1", "left"),))
WORDS = TextScreen("Consent", "Words to read. " * 20, "Press Enter if you agree", "episode 1 of 2")


class Managed:
    """A window with a manager, that shows a screen."""

    def __init__(self, desk: Desktop, window: HostedWindow) -> None:
        self.desk, self.window = desk, window

    def looks_as_it_should(self, screen: Screen, *, patience_s: float = PATIENCE_S) -> bool:
        """Whether, before long and waiting as a session does, the screen is all there at its present size."""
        until_s = time.monotonic() + patience_s
        while time.monotonic() < until_s:
            self.window.wait(time.monotonic_ns() + 50_000_000)
            seen = self.desk.inside(TITLE)
            if seen.size and np.array_equal(seen, compose_screen(screen, (seen.shape[1], seen.shape[0]))):
                return True
        return False


@pytest.fixture(scope="module")
def desk() -> Iterator[Desktop]:
    with desktop() as one:
        yield one


@pytest.fixture(params=[(kind, full) for kind in ("pygame", "pyglet") for full in (False, True)], scope="module")
def managed(request: pytest.FixtureRequest, desk: Desktop) -> Iterator[Managed]:
    kind, fullscreen = request.param
    window = HostedWindow(kind, desk.name, size_px=SIZE_PX, fullscreen=fullscreen)
    yield Managed(desk, window)
    window.end()


def _minimise(desk: Desktop, window: HostedWindow) -> None:
    desk.minimise(TITLE)
    window.wait(time.monotonic_ns() + 200_000_000)
    desk.restore(TITLE)


def _cover(desk: Desktop, window: HostedWindow) -> None:
    with desk.covered():
        window.wait(time.monotonic_ns() + 100_000_000)


def _move(desk: Desktop, window: HostedWindow) -> None:
    for x in (300, 40):
        desk.move(TITLE, x, 50)
        window.wait(time.monotonic_ns() + 100_000_000)


def _resize(desk: Desktop, window: HostedWindow) -> None:
    for size_px in ((800, 500), SIZE_PX):
        desk.resize(TITLE, *size_px)
        window.wait(time.monotonic_ns() + 100_000_000)


def _full_screen_and_back(desk: Desktop, window: HostedWindow) -> None:
    was = desk.inside(TITLE).shape == desk.picture().shape
    for wanted in (not was, was):
        desk.full_screen(TITLE, wanted)
        window.wait(time.monotonic_ns() + 200_000_000)


@pytest.mark.nightly(
    by_day=[f"managed{number}-play-{act}" for number in range(4) for act in ("_minimise", "_full_screen_and_back")]
)
@pytest.mark.parametrize("done", [_minimise, _cover, _move, _resize, _full_screen_and_back])
@pytest.mark.parametrize("screen", [WORDS, PLAY], ids=("text", "play"))
def test_the_screen_is_as_bright_afterwards_as_before(
    managed: Managed, screen: Screen, done: Callable[[Desktop, HostedWindow], None]
) -> None:
    managed.window.show(screen)
    assert managed.looks_as_it_should(screen)
    before = managed.desk.picture().mean()
    done(managed.desk, managed.window)
    assert managed.looks_as_it_should(screen)
    assert managed.desk.picture().mean() == pytest.approx(before, abs=0.01)


def test_made_full_screen_by_the_manager_it_fills_the_screen_and_what_comes_next_does_too(managed: Managed) -> None:
    managed.window.show(WORDS)
    managed.desk.full_screen(TITLE, True)
    assert managed.looks_as_it_should(WORDS)
    assert managed.desk.inside(TITLE).shape == managed.desk.picture().shape
    managed.window.show(PLAY)
    assert managed.looks_as_it_should(PLAY)
