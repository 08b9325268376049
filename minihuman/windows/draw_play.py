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
_Key = tuple[str, str]  # what is printed on it, what it does
_TOP = 0.10  # the mission's band, of the height
_BOTTOM = 0.16  # legend and progress
_MOST_ROWS = 3  # of the legend, in type that can be read
_GAP = 1.4  # between a key's word and the next key, of the type size
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
    faces = faces_for(screen.script.language, fonts=screen.script.fonts)
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
    """Keys and what they do, side by side in one centred line; smaller when there are many, then in several."""
    width, height = sheet.size_px
    printed = {key: f"{above} {cap}".strip() for key, cap, above in around.labels}
    keys = [(printed.get(key, label(key)), action.replace("_", " ")) for key, action in around.legend]
    wide = width - 2 * height * MARGIN
    type_px = round(height * 0.03)
    while type_px > sheet.smallest_px and _length(sheet, keys, type_px) > wide:
        type_px -= 1
    while len(rows := _rows(sheet, keys, type_px, wide)) > _MOST_ROWS and type_px > 8:
        type_px -= 1
    tall = type_px * (2.0 if len(rows) == 1 else 1.3)
    above_px = height * 0.004 * (len(rows) - 1)  # the progress line is right below
    for number, row in enumerate(rows):
        x = (width - _length(sheet, row, type_px)) / 2
        middle = height * (1 - _BOTTOM + 0.068) + (number - (len(rows) - 1) / 2) * type_px * 1.4 - above_px
        for cap, word in row:
            size = _cap_px(sheet, cap, type_px)
            place = (x, middle - tall / 2, x + size, middle + tall / 2)
            draw_cap(sheet.draw, cap, "", place, language=around.script.language, least_px=sheet.smallest_px)
            sheet.put((x + size + type_px * 0.6, middle), word, type_px, theme.INK)
            x += _length(sheet, [(cap, word)], type_px) + type_px * _GAP


def _rows(sheet: Sheet, keys: list[_Key], type_px: int, wide: float) -> list[list[_Key]]:
    """Keys in lines that are no longer than ``wide``."""
    rows: list[list[_Key]] = [[]]
    for key in keys:
        if rows[-1] and _length(sheet, [*rows[-1], key], type_px) > wide:
            rows.append([])
        rows[-1].append(key)
    return rows


def _cap_px(sheet: Sheet, cap: str, type_px: int) -> float:
    """How wide a key is drawn."""
    return max(type_px * 2.0, (sheet.width_px(cap, type_px) + type_px) * 1.1)


def _length(sheet: Sheet, keys: list[_Key], type_px: int) -> float:
    """How long a line of the legend is."""
    lengths = [_cap_px(sheet, cap, type_px) + type_px * 0.6 + sheet.width_px(word, type_px) for cap, word in keys]
    return sum(lengths) + type_px * _GAP * (len(keys) - 1)
