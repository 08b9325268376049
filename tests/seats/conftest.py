"""A display and somebody at its keys."""

from collections.abc import Iterator

import pytest

from tests.xserver import Typist, xvfb

SMALL_SCREEN_PX = (640, 480)  # the window shrinks to it; a first-person picture costs by the pixel


@pytest.fixture
def typist_and_display() -> Iterator[tuple[Typist, str]]:
    with xvfb(SMALL_SCREEN_PX) as display:
        typist = Typist(display)
        yield typist, display
        typist.close()
