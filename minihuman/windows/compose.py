"""Every screen as one picture: a pure function of what is to be seen and of the window's size.

Both toolkits only bring this picture to the display, so a study looks the same in either, and without a display.
While playing, only the world's picture changes; the rest is drawn once an episode and kept.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from minihuman.study.screens import BlankScreen, KindScreen, PageScreen, PlayScreen, QuestionScreen, Screen, TextScreen
from minihuman.windows import theme
from minihuman.windows.draw_page import draw_page
from minihuman.windows.draw_play import Around, Box, draw_mark, draw_surroundings, paint, room_px
from minihuman.windows.draw_question import draw_question
from minihuman.windows.draw_steering import draw_steering
from minihuman.windows.draw_text import draw_text
from minihuman.windows.drawings import drawing_of
from minihuman.windows.sheet import Sheet, Size

__all__ = ["Box", "Size", "along_spot", "compose", "picture_size_px", "repaint", "spot_at"]


def compose(screen: Screen, size_px: Size) -> NDArray[np.uint8]:
    """Draw a screen, uint8[H, W, 3]; the array is the caller's own."""
    match screen:
        case PlayScreen():
            frame = _surroundings(_around(screen), size_px).copy()
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
        case KindScreen():
            drawing = drawing_of(type(screen))
            assert drawing is not None, f"no kind of activity says how a {type(screen).__name__} is drawn"
            return np.array(drawing.draw(screen, size_px).page)


def repaint(frame: NDArray[np.uint8], shown: Screen | None, screen: Screen) -> Box:
    """Make a frame that shows one screen show the next one; the box is what changed, so only that need travel.

    Args:
        frame: uint8[H, W, 3], written to.
        shown: what it shows; None if nothing of use.
        screen: what it is to show.
    """
    height, width = frame.shape[:2]
    if isinstance(shown, PlayScreen) and isinstance(screen, PlayScreen) and not (shown.mark or screen.mark):
        same = shown.picture.shape == screen.picture.shape and _around(shown) == _around(screen)
        if same and bool(shown.steers) == bool(screen.steers):
            return _paint(frame, screen)
    frame[:] = compose(screen, (width, height))
    return 0, 0, width, height


def picture_size_px(size_px: Size) -> Size:
    """The room for a world's picture in a window: the largest width and height it may have to be shown as it is.

    It is 4:3, the shape of what agents see: on a wide screen a person would see more of a 3D world than they do.
    """
    return room_px(size_px)


def spot_at(screen: Screen, size_px: Size, x: float, y: float) -> tuple[str, float]:
    """What lies at (x, y), 0..1 of the picture: the name of the spot, "" for none, and how far along it, 0..1."""
    if not isinstance(screen, PageScreen | QuestionScreen):
        return "", 0.0
    spot = next((spot for spot in _sheet(screen, size_px).spots if spot.holds(x * size_px[0], y * size_px[1])), None)
    return ("", 0.0) if spot is None else (spot.name, spot.along(x * size_px[0]))


def along_spot(screen: Screen, size_px: Size, name: str, x: float) -> float:
    """How far along a named spot x is, 0..1, also beside it: for a pointer that was pressed in it and has moved on."""
    for spot in _sheet(screen, size_px).spots if isinstance(screen, PageScreen | QuestionScreen) else ():
        if spot.name == name:
            return spot.along(x * size_px[0])
    return 0.0


def _paint(frame: NDArray[np.uint8], screen: PlayScreen) -> Box:
    """What changes while an episode is played: the world's picture, and who steers where an agent may."""
    box = paint(frame, screen.picture)
    return draw_steering(frame, screen, box) if screen.steers else box


def _put(frame: NDArray[np.uint8], layer: Image.Image) -> None:
    """Put a picture with transparency over a frame."""
    image = Image.fromarray(frame)
    image.paste(layer, (0, 0), layer)
    frame[:] = np.asarray(image)


def _around(screen: PlayScreen) -> Around:
    """What of a play screen stays while an episode is played."""
    return Around(screen.mission, screen.progress, screen.legend, screen.labels, screen.script)


@lru_cache(maxsize=4)
def _surroundings(around: Around, size_px: Size) -> NDArray[np.uint8]:
    return np.array(draw_surroundings(around, size_px).page)


@lru_cache(maxsize=8)
def _text(screen: TextScreen, size_px: Size) -> Image.Image:
    return draw_text(screen, size_px).page


@lru_cache(maxsize=4)
def _sheet(screen: PageScreen | QuestionScreen, size_px: Size) -> Sheet:
    if isinstance(screen, PageScreen):
        return draw_page(screen, size_px)
    return draw_question(screen, size_px)


def _blank(screen: BlankScreen, size_px: Size) -> Image.Image:
    """Nothing, or a cross of a thirtieth of the height."""
    page = Image.new("RGB", size_px, theme.BACKGROUND)
    if screen.cross:
        (width, height), draw = size_px, ImageDraw.Draw(page)
        reach, stroke = height / 60, max(2, round(height / 240))
        draw.line([(width / 2 - reach, height / 2), (width / 2 + reach, height / 2)], fill=theme.INK, width=stroke)
        draw.line([(width / 2, height / 2 - reach), (width / 2, height / 2 + reach)], fill=theme.INK, width=stroke)
    return page
