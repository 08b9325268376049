"""A play screen: the world's picture, with the mission above it, and the legend and the progress line below."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from minihuman.study.keycaps import label
from minihuman.study.screens import PlayScreen, Script
from minihuman.typeset.faces import faces_for
from minihuman.typeset.line import draw_line, width_px
from minihuman.windows import theme
from minihuman.windows.keycaps import draw_cap
from minihuman.windows.sheet import MARGIN, Sheet, Size

Box = tuple[int, int, int, int]  # left, top, width, height
_TOP = 0.10  # the mission's band, of the height
_BOTTOM = 0.16  # legend and progress
_MARKS = {"good": theme.GOOD, "bad": theme.BAD, "neutral": theme.QUIET}


@dataclass(frozen=True, slots=True)
class Around:
    """What of a play screen stays while an episode is played."""

    mission: str
    progress: str
    legend: tuple[tuple[str, str], ...]
    labels: tuple[tuple[str, str, str], ...]
    script: Script


def room_px(size_px: Size) -> Size:
    """The room for a world's picture."""
    width, height = size_px
    room_height = height - round(height * _TOP) - round(height * _BOTTOM)
    wide = min(width - 2 * round(height * MARGIN), room_height * 4 // 3)
    return wide, wide * 3 // 4


def paint(frame: NDArray[np.uint8], picture: NDArray[np.uint8]) -> Box:
    """Put a world's picture into its place."""
    size_px = frame.shape[1], frame.shape[0]
    picture = _fit(picture, *room_px(size_px))
    left, top, width, height = _place(picture.shape[1], picture.shape[0], size_px)
    frame[top : top + height, left : left + width] = picture
    return left, top, width, height


def _place(width: int, height: int, size_px: Size) -> Box:
    top, bottom = round(size_px[1] * _TOP), size_px[1] - round(size_px[1] * _BOTTOM)
    return (size_px[0] - width) // 2, top + (bottom - top - height) // 2, width, height


def _fit(picture: NDArray[np.uint8], room_width: int, room_height: int) -> NDArray[np.uint8]:
    """Enlarge by the largest whole number that fits; a picture too large for the room is averaged down into it."""
    height, width = picture.shape[:2]
    scale = min(room_width // width, room_height // height)
    if scale > 1:
        return picture.repeat(scale, axis=0).repeat(scale, axis=1)
    if scale == 1:
        return picture
    shrink = min(room_width / width, room_height / height)
    smaller = (max(1, int(width * shrink)), max(1, int(height * shrink)))
    return np.asarray(Image.fromarray(picture).resize(smaller, Image.Resampling.BOX))


def draw_surroundings(around: Around, size_px: Size) -> Sheet:
    """All of a play screen but the world."""
    width, height = size_px
    sheet = Sheet(size_px, around.script)
    wide = width - 2 * height * MARGIN
    mission = around.mission[:1].upper() + around.mission[1:]
    sheet.one_line((width / 2, height * _TOP / 2), mission, round(height / 24), wide, theme.INK)
    _legend(sheet, around)
    sheet.one_line((width / 2, height * 0.965), around.progress, round(height / 36), wide, theme.QUIET)
    return sheet


def draw_mark(screen: PlayScreen, size_px: Size) -> Image.Image:
    """A frame around the held picture in the outcome's colour, and its sign and sum in a corner; the rest clear."""
    height, width = screen.picture.shape[:2]
    shown = _fit(screen.picture, *room_px(size_px)) if width else screen.picture
    left, top, width, height = _place(shown.shape[1], shown.shape[0], size_px)
    layer = Image.new("RGBA", size_px, (0, 0, 0, 0))
    draw, colour = ImageDraw.Draw(layer), _MARKS[screen.mark]
    stroke = max(3, round(size_px[1] / 90))
    draw.rectangle((left, top, left + width - 1, top + height - 1), outline=colour, width=stroke)
    reach = size_px[1] * 0.045
    type_px = round(size_px[1] / 26)
    faces = faces_for(screen.script.language)
    said = width_px(screen.said, faces, type_px) + reach * 0.6 if screen.said else 0.0
    x, y = left + width / 2 - said / 2, top + reach * 1.6  # the agent itself is often at the bottom
    box = (x - reach * 1.3, y - reach, x + reach * 1.3 + said, y + reach)
    draw.rounded_rectangle(box, radius=reach * 0.4, fill=(*theme.BACKGROUND, 235), outline=colour, width=stroke // 2)
    _sign(draw, screen.mark, (x, y), reach * 0.55, colour, stroke)
    if screen.said:
        draw_line(draw, (x + reach, y), screen.said, faces=faces, size_px=type_px, colour=theme.INK)
    return layer


def _sign(
    draw: ImageDraw.ImageDraw, mark: str, place: tuple[float, float], reach: float, colour: theme.Colour, stroke: int
) -> None:
    """A tick, a cross or a bar: told apart without the colour."""
    x, y = place
    if mark == "good":
        draw.line([(x - reach, y), (x - reach * 0.2, y + reach * 0.7), (x + reach, y - reach * 0.8)], colour, stroke)
    elif mark == "bad":
        draw.line([(x - reach, y - reach), (x + reach, y + reach)], colour, stroke)
        draw.line([(x - reach, y + reach), (x + reach, y - reach)], colour, stroke)
    else:
        draw.line([(x - reach, y), (x + reach, y)], colour, stroke)


def _legend(sheet: Sheet, around: Around) -> None:
    """Keys and what they do, side by side in one centred line; smaller when there are many."""
    width, height = sheet.size_px
    words = [action.replace("_", " ") for _, action in around.legend]
    printed = {key: (cap, above) for key, cap, above in around.labels}
    caps = [printed.get(key, (label(key), "")) for key, _ in around.legend]
    for cap_px in range(round(height * 0.06), 8, -1):
        type_px = round(cap_px * 0.5)
        sizes = [cap_px if len(cap) == 1 else cap_px * 2 for cap, _ in caps]
        lengths = [size + cap_px * 0.3 + sheet.width_px(word, type_px) for size, word in zip(sizes, words, strict=True)]
        gap = cap_px * 0.7
        whole = sum(lengths) + gap * (len(lengths) - 1)
        if whole <= width - 2 * height * MARGIN:
            break
    x, middle = (width - whole) / 2, height * (1 - _BOTTOM + 0.065)
    for (cap, above), word, size, length in zip(caps, words, sizes, lengths, strict=True):
        place = (x, middle - cap_px / 2, x + size, middle + cap_px / 2)
        draw_cap(sheet.draw, cap, above, place, language=around.script.language)
        sheet.put((x + size + cap_px * 0.3, middle), word, type_px, theme.INK)
        x += length + gap
