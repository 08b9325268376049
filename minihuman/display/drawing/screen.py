"""The composition of every screen into one picture, as a pure function of the screen and the window's size.

Window toolkits only bring this picture to the display, so a study looks the same in each of them, and without a
display. While an episode is played, only the world's picture changes; the rest is drawn once per episode and cached.
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
from minihuman.display.drawing.questions import draw_question, field_type_px
from minihuman.display.drawing.sheet import Sheet, Size
from minihuman.display.drawing.text_fields import lay_out_field
from minihuman.display.drawing.text_screens import draw_page, draw_text
from minihuman.experiment.machine.screens import (
    ActivityScreen,
    BlankScreen,
    PageScreen,
    PlayScreen,
    QuestionScreen,
    Screen,
    TextField,
    TextScreen,
)

__all__ = [
    "Box",
    "Size",
    "compose_screen",
    "find_spot",
    "locate_in_field",
    "locate_in_picture",
    "measure_along_spot",
    "picture_size_px",
    "repaint_screen",
]


def compose_screen(screen: Screen, size_px: Size) -> NDArray[np.uint8]:
    """Return the picture of a screen as uint8[H, W, 3]; the caller may change the array."""
    match screen:
        case PlayScreen():
            frame = _draw_play_frame(_play_frame(screen), size_px).copy()
            _paint_play(frame, screen)
            if screen.mark:
                _paste_layer(frame, draw_mark(screen, size_px))
            return frame
        case BlankScreen():
            return np.array(_draw_blank(screen, size_px))
        case TextScreen():
            return np.array(_draw_text_screen(screen, size_px))
        case PageScreen() | QuestionScreen():
            return np.array(_draw_sheet(screen, size_px).page)
        case ActivityScreen():  # drawn by a function of the activity, "module:function"
            module, _, function = screen.drawing.partition(":")
            return np.array(getattr(import_module(module), function)(screen, size_px).page)


def repaint_screen(frame: NDArray[np.uint8], previous: Screen | None, screen: Screen) -> Box:
    """Change a frame that shows one screen into the next one; return the box outside which nothing changed.

    Args:
        frame: the picture uint8[H, W, 3], which is changed in place
        previous: the screen that the frame shows; None if its content is unknown
        screen: the screen that the frame is to show
    """
    if isinstance(previous, PlayScreen) and isinstance(screen, PlayScreen) and _share_surroundings(previous, screen):
        return _paint_play(frame, screen)
    height, width = frame.shape[:2]
    frame[:] = compose_screen(screen, (width, height))
    return 0, 0, width, height


def _share_surroundings(previous: PlayScreen, screen: PlayScreen) -> bool:
    """Return whether one play screen becomes the other if only the picture and the signs of control are painted.

    For this, neither has an outcome's mark, their pictures have the same size, and both or neither show who is in
    control.
    """
    if previous.mark or screen.mark:
        return False
    if previous.picture.shape != screen.picture.shape or _play_frame(previous) != _play_frame(screen):
        return False
    had_steering = previous.controller != ""
    has_steering = screen.controller != ""
    return had_steering == has_steering


def find_spot(screen: Screen, size_px: Size, x: float, y: float) -> tuple[str, float]:
    """Return the name of the spot at (x, y), and the position along the spot from 0 to 1; ("", 0.0) if there is none.

    Coordinates are shares of the screen's width and height. Only pages and questions have spots.
    """
    if isinstance(screen, PageScreen | QuestionScreen):
        width, height = size_px
        x_px = x * width
        y_px = y * height
        for spot in _draw_sheet(screen, size_px).spots:
            if spot.holds(x_px, y_px):
                return spot.name, spot.along(x_px)
    return "", 0.0


def locate_in_field(screen: QuestionScreen, size_px: Size, x: float, y: float) -> int:
    """Return the position in the text of a question's field, in characters, that is nearest to the point (x, y).

    The coordinates of the point are shares of the screen's width and height. The question must have a text field.
    """
    page = _draw_sheet(screen, size_px)
    field = next(spot for spot in page.spots if spot.name == "field")
    assert isinstance(screen.item, TextField)
    layout = lay_out_field(page, screen.item, (field.left, field.top, field.right, field.bottom), field_type_px(page))
    return layout.locate(page, screen.item.text, x * size_px[0], y * size_px[1])


def locate_in_picture(screen: PlayScreen, size_px: Size, x: float, y: float) -> tuple[float, float] | None:
    """Return the position of a point within the world's picture; None if the point lies outside the picture.

    The point (x, y) is given in shares of the screen's width and height, and returned in shares of the picture's.
    """
    left, top, width, height = locate_picture(screen.picture, size_px)
    position = (x * size_px[0] - left) / width, (y * size_px[1] - top) / height
    if all(0 <= share < 1 for share in position):
        return position
    return None


def measure_along_spot(screen: Screen, size_px: Size, name: str, x: float) -> float:
    """Return how far along a named spot an x lies, from 0 to 1; 0 if the screen has no spot of the name.

    The x is a share of the screen's width. It can lie outside the spot if the pointer was moved after it was pressed.
    """
    if not isinstance(screen, PageScreen | QuestionScreen):
        return 0.0
    for spot in _draw_sheet(screen, size_px).spots:
        if spot.name == name:
            return spot.along(x * size_px[0])
    return 0.0


def _paint_play(frame: NDArray[np.uint8], screen: PlayScreen) -> Box:
    """Paint the parts of a play screen that change during an episode; return the box that may have changed.

    These are the world's picture and, in shared control, the signs of who is in control.
    """
    box = paint_picture(frame, screen.picture)
    if screen.controller:
        return draw_steering(frame, screen, box)
    return box


def _paste_layer(frame: NDArray[np.uint8], layer: Image.Image) -> None:
    """Paste a picture with transparency onto a frame of the same size, in place."""
    image = Image.fromarray(frame)
    image.paste(layer, (0, 0), layer)
    frame[:] = np.asarray(image)


def _play_frame(screen: PlayScreen) -> PlayFrame:
    """Return the parts of a play screen that do not change during an episode."""
    height, width = screen.picture.shape[:2]
    return PlayFrame(screen.mission, screen.progress, screen.legend, screen.labels, screen.locale, (width, height))


@lru_cache(maxsize=4)
def _draw_play_frame(play_frame: PlayFrame, size_px: Size) -> NDArray[np.uint8]:
    return np.array(draw_surroundings(play_frame, size_px).page)


@lru_cache(maxsize=8)
def _draw_text_screen(screen: TextScreen, size_px: Size) -> Image.Image:
    return draw_text(screen, size_px).page


@lru_cache(maxsize=4)
def _draw_sheet(screen: PageScreen | QuestionScreen, size_px: Size) -> Sheet:
    if isinstance(screen, PageScreen):
        return draw_page(screen, size_px)
    return draw_question(screen, size_px)


def _draw_blank(screen: BlankScreen, size_px: Size) -> Image.Image:
    """Draw a screen that is empty or has a fixation cross, whose width is a thirtieth of the window's height."""
    blank = sheet.Sheet(size_px, screen.locale)
    if screen.cross:
        width, height = size_px
        draw = blank.draw
        reach = height / 60
        stroke = max(2, round(height / 240))
        draw.line([(width / 2 - reach, height / 2), (width / 2 + reach, height / 2)], fill=sheet.INK, width=stroke)
        draw.line([(width / 2, height / 2 - reach), (width / 2, height / 2 + reach)], fill=sheet.INK, width=stroke)
    return blank.page
