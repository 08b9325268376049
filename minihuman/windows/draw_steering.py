"""Who steers: a frame around the world's picture and a line below it. An agent's frame is dashed, a person's whole.

Drawn with every step, so by copying: a frame in NumPy, the line from a picture that is set once.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from minihuman.study.screens import PlayScreen
from minihuman.typeset.faces import faces_for
from minihuman.typeset.line import draw_line, width_px
from minihuman.windows import theme
from minihuman.windows.sheet import SMALLEST

Box = tuple[int, int, int, int]  # left, top, width, height
_COLOURS = {"agent": theme.LIT, "person": theme.ACCENT}
_FLASHES = {"good": theme.GOOD, "bad": theme.BAD}
_SIGNS = {"good": "+", "bad": "\N{MINUS SIGN}"}
_LINE = 0.03  # the line's height, of the window's
_DASH = 4  # of the frame's thickness


def draw_steering(frame: NDArray[np.uint8], screen: PlayScreen, picture: Box) -> Box:
    """Draw it into a frame around the place of the picture; returns what may have changed, the picture included."""
    height, width = frame.shape[:2]
    stroke = max(3, height // 144)
    left, top, wide, high = picture
    box = (left - stroke, top - stroke, wide + 2 * stroke, high + 2 * stroke)
    colour = _FLASHES.get(screen.flash) or _COLOURS[screen.steers]
    _edges(frame, box, stroke, colour, dashed=screen.steers == "agent" and not screen.flash)
    said = _SIGNS.get(screen.flash, screen.steers_said)
    line = _line(said, screen.script.language, colour, box[2], round(height * _LINE))
    below, start = box[1] + box[3], (width - line.shape[1]) // 2
    rows = min(len(line), height - below)
    frame[below : below + rows, start : start + line.shape[1]] = line[:rows]
    left = min(start, box[0])
    return left, box[1], width - 2 * left, box[3] + rows


def _edges(frame: NDArray[np.uint8], box: Box, stroke: int, colour: theme.Colour, *, dashed: bool) -> None:
    left, top, width, height = box
    along_x, along_y = _dashes(width, stroke, colour, dashed), _dashes(height, stroke, colour, dashed)
    frame[top : top + stroke, left : left + width] = along_x
    frame[top + height - stroke : top + height, left : left + width] = along_x
    frame[top : top + height, left : left + stroke] = along_y[:, None]
    frame[top : top + height, left + width - stroke : left + width] = along_y[:, None]


@lru_cache(maxsize=16)
def _dashes(length: int, stroke: int, colour: theme.Colour, dashed: bool) -> NDArray[np.uint8]:
    """A side of the frame, uint8[length, 3]: it begins and ends with a dash, so that corners are whole."""
    side = np.full((length, 3), colour, np.uint8)
    if dashed:
        dash = stroke * _DASH
        gaps = max(1, round((length / dash - 1) / 2))
        side[np.floor(np.arange(length) / length * (2 * gaps + 1)) % 2 == 1] = theme.BACKGROUND
    return side


@lru_cache(maxsize=16)
def _line(said: str, language: str, colour: theme.Colour, width: int, height: int) -> NDArray[np.uint8]:
    """The line, uint8[height, width or more, 3]."""
    faces = faces_for(language)
    size_px = max(8, round(height / _LINE * SMALLEST))
    width = max(width, 2 * round(width_px(said, faces, size_px) / 2 + size_px))
    image = Image.new("RGB", (width, height), theme.BACKGROUND)
    start = (width - width_px(said, faces, size_px)) / 2
    draw_line(ImageDraw.Draw(image), (start, height / 2), said, faces=faces, size_px=size_px, colour=colour)
    return np.asarray(image)
