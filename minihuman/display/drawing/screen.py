"""Compose every screen into one picture: a pure function of the screen's values and of the window's size.

Both toolkits only bring this picture to the display, so a study looks the same in either, and without a display. While
playing, only the world's picture changes; the rest is drawn once per episode and cached.
"""

from functools import lru_cache
from importlib import import_module

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.display.drawing import sheet
from minihuman.display.drawing.play_screens import (
    Box,
    PlayFrame,
    draw_mark,
    draw_steering,
    draw_surroundings,
    locate_picture,
    paint_picture,
    picture_size_px,
)
from minihuman.display.drawing.questions import draw_question
from minihuman.display.drawing.sheet import Sheet, Size
from minihuman.display.drawing.text_screens import draw_page, draw_text
from minihuman.experiment.machine.screens import (
    ActivityScreen,
    BlankScreen,
    PageScreen,
    PlayScreen,
    QuestionScreen,
    Screen,
    TextScreen,
)

__all__ = [
    "Box",
    "Size",
    "compose_screen",
    "find_spot",
    "locate_in_picture",
    "measure_along_spot",
    "picture_size_px",
    "repaint_screen",
]


def compose_screen(screen: Screen, size_px: Size) -> NDArray[np.uint8]:
    """Draw a screen, uint8[H, W, 3]; the array is the caller's own."""
    match screen:
        case PlayScreen():
            frame = _draw_play_frame(_play_frame(screen), size_px).copy()
            _paint(frame, screen)
            if screen.mark:
                _put(frame, draw_mark(screen, size_px))
            return frame
        case BlankScreen():
            return np.array(_blank(screen, size_px))
        case TextScreen():
            return np.array(_text(screen, size_px))
        case PageScreen() | QuestionScreen():
            return np.array(_sheet(screen, size_px).page)
        case ActivityScreen():
            module, _, function = screen.drawing.partition(":")
            return np.array(getattr(import_module(module), function)(screen, size_px).page)


def repaint_screen(frame: NDArray[np.uint8], previous: Screen | None, screen: Screen) -> Box:
    """Make a frame that shows one screen show the next one; the box is what changed, so only that need travel.

    Args:
        frame: uint8[H, W, 3], written to.
        previous: what it shows; None if nothing of use.
        screen: what it is to show.
    """
    height, width = frame.shape[:2]
    if isinstance(previous, PlayScreen) and isinstance(screen, PlayScreen) and not (previous.mark or screen.mark):
        same = previous.picture.shape == screen.picture.shape and _play_frame(previous) == _play_frame(screen)
        if same and bool(previous.controller) == bool(screen.controller):
            return _paint(frame, screen)
    frame[:] = compose_screen(screen, (width, height))
    return 0, 0, width, height


def find_spot(screen: Screen, size_px: Size, x: float, y: float) -> tuple[str, float]:
    """Find the spot at (x, y), 0..1 of the picture: its name, "" for none, and how far along it, 0..1."""
    if not isinstance(screen, PageScreen | QuestionScreen):
        return "", 0.0
    spot = next((spot for spot in _sheet(screen, size_px).spots if spot.holds(x * size_px[0], y * size_px[1])), None)
    if spot is None:
        return ("", 0.0)
    return (spot.name, spot.along(x * size_px[0]))


def locate_in_picture(screen: PlayScreen, size_px: Size, x: float, y: float) -> tuple[float, float] | None:
    """Return where (x, y), 0..1 of the screen, lies in the world's picture, 0..1 of it; None beside it."""
    left, top, width, height = locate_picture(screen.picture, size_px)
    inside = (x * size_px[0] - left) / width, (y * size_px[1] - top) / height
    if all(0 <= share < 1 for share in inside):
        return inside
    return None


def measure_along_spot(screen: Screen, size_px: Size, name: str, x: float) -> float:
    """Return how far along a named spot x is, 0..1; also beside it, for a pointer that was pressed in it and moved."""
    if not isinstance(screen, PageScreen | QuestionScreen):
        return 0.0
    for spot in _sheet(screen, size_px).spots:
        if spot.name == name:
            return spot.along(x * size_px[0])
    return 0.0


def _paint(frame: NDArray[np.uint8], screen: PlayScreen) -> Box:
    """Paint what changes while an episode is played: the world's picture, and who steers where an agent may."""
    box = paint_picture(frame, screen.picture)
    if screen.controller:
        return draw_steering(frame, screen, box)
    return box


def _put(frame: NDArray[np.uint8], layer: Image.Image) -> None:
    """Put a picture with transparency over a frame."""
    image = Image.fromarray(frame)
    image.paste(layer, (0, 0), layer)
    frame[:] = np.asarray(image)


def _play_frame(screen: PlayScreen) -> PlayFrame:
    """Return what of a play screen stays while an episode is played."""
    return PlayFrame(screen.mission, screen.progress, screen.legend, screen.labels, screen.locale)


@lru_cache(maxsize=4)
def _draw_play_frame(play_frame: PlayFrame, size_px: Size) -> NDArray[np.uint8]:
    return np.array(draw_surroundings(play_frame, size_px).page)


@lru_cache(maxsize=8)
def _text(screen: TextScreen, size_px: Size) -> Image.Image:
    return draw_text(screen, size_px).page


@lru_cache(maxsize=4)
def _sheet(screen: PageScreen | QuestionScreen, size_px: Size) -> Sheet:
    if isinstance(screen, PageScreen):
        return draw_page(screen, size_px)
    return draw_question(screen, size_px)


def _blank(screen: BlankScreen, size_px: Size) -> Image.Image:
    """Draw nothing, or a cross of a thirtieth of the height."""
    blank = sheet.Sheet(size_px, screen.locale)
    if screen.cross:
        width, height = size_px
        draw = blank.draw
        reach = height / 60
        stroke = max(2, round(height / 240))
        draw.line([(width / 2 - reach, height / 2), (width / 2 + reach, height / 2)], fill=sheet.INK, width=stroke)
        draw.line([(width / 2, height / 2 - reach), (width / 2, height / 2 + reach)], fill=sheet.INK, width=stroke)
    return blank.page
