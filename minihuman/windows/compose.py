"""Every screen as one picture: a pure function of what is to be seen and of the window's size.

Both toolkits only bring this picture to the display, so a study looks the same in either, and without a display.
While playing, only the world's picture changes; the rest is drawn once an episode and kept.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from minihuman.study.screens import PlayScreen, Screen, TextScreen
from minihuman.windows import theme
from minihuman.windows.keycaps import arrange, draw_cap, label

Size = tuple[int, int]  # width, height
Box = tuple[int, int, int, int]  # left, top, width, height

_MARGIN = 0.03  # of the height, and so are all lengths below
_TOP = 0.10  # the mission's band
_BOTTOM = 0.16  # legend and progress
_LINE = 1.45  # line height, of the type size
_BODY = 1 / 26  # type size of running text: 3.5 mm tall capitals on a 24-inch display
_SMALLEST_BODY = 1 / 60
_MEASURE = 1.25  # longest line of running text


def compose(screen: Screen, size_px: Size) -> NDArray[np.uint8]:
    """Draw a screen, uint8[H, W, 3]; the array is the caller's own."""
    match screen:
        case PlayScreen():
            return _play(screen, size_px)
        case TextScreen():
            return np.array(_text(screen, size_px))


def repaint(frame: NDArray[np.uint8], shown: Screen | None, screen: Screen) -> Box:
    """Make a frame that shows one screen show the next one; the box is what changed, so only that need travel.

    Args:
        frame: uint8[H, W, 3], written to.
        shown: what it shows; None if nothing of use.
        screen: what it is to show.
    """
    height, width = frame.shape[:2]
    if isinstance(shown, PlayScreen) and isinstance(screen, PlayScreen) and _around(shown) == _around(screen):
        return _paint(frame, screen.picture)
    frame[:] = compose(screen, (width, height))
    return 0, 0, width, height


def picture_size_px(size_px: Size) -> Size:
    """The room for a world's picture in a window: the largest width and height it may have to be shown as it is.

    It is 4:3, the shape of what agents see: on a wide screen a person would see more of a 3D world than they do.
    """
    width, height = size_px
    room_height = height - round(height * _TOP) - round(height * _BOTTOM)
    wide = min(width - 2 * round(height * _MARGIN), room_height * 4 // 3)
    return wide, wide * 3 // 4


def _play(screen: PlayScreen, size_px: Size) -> NDArray[np.uint8]:
    frame = _surroundings(screen.mission, screen.progress, screen.legend, size_px).copy()
    _paint(frame, screen.picture)
    return frame


def _around(screen: PlayScreen) -> tuple[object, ...]:
    """What of a play screen stays while an episode is played."""
    return screen.mission, screen.progress, screen.legend, screen.picture.shape


def _paint(frame: NDArray[np.uint8], picture: NDArray[np.uint8]) -> Box:
    """Put a world's picture into its place."""
    size_px = frame.shape[1], frame.shape[0]
    picture = _fit(picture, *picture_size_px(size_px))
    height, width = picture.shape[:2]
    top, bottom = round(size_px[1] * _TOP), size_px[1] - round(size_px[1] * _BOTTOM)
    top += (bottom - top - height) // 2
    left = (size_px[0] - width) // 2
    frame[top : top + height, left : left + width] = picture
    return left, top, width, height


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


@lru_cache(maxsize=4)
def _surroundings(mission: str, progress: str, legend: tuple[tuple[str, str], ...], size_px: Size) -> NDArray[np.uint8]:
    """All of a play screen but the world."""
    width, height = size_px
    page = Image.new("RGB", size_px, theme.BACKGROUND)
    draw = ImageDraw.Draw(page)
    wide = width - 2 * height * _MARGIN
    _one_line(draw, (width / 2, height * _TOP / 2), mission.capitalize(), round(height / 24), wide, theme.INK)
    _legend(draw, legend, size_px)
    _one_line(draw, (width / 2, height * 0.965), progress, round(height / 36), wide, theme.QUIET)
    return np.array(page)


def _one_line(
    draw: ImageDraw.ImageDraw, place: tuple[float, float], words: str, type_px: int, wide: float, colour: theme.Colour
) -> None:
    """Centre one line on a place, in smaller type if it would be too long."""
    while type_px > 8 and theme.font(type_px).getlength(words) > wide:
        type_px -= 1
    draw.text(place, words, fill=colour, font=theme.font(type_px), anchor="mm")


def _legend(draw: ImageDraw.ImageDraw, legend: tuple[tuple[str, str], ...], size_px: Size) -> None:
    """Keys and what they do, side by side in one centred line; smaller when there are many."""
    width, height = size_px
    words = [action.replace("_", " ") for _, action in legend]
    for cap_px in range(round(height * 0.06), 8, -1):
        face = theme.font(round(cap_px * 0.5))
        caps = [cap_px if len(label(key)) == 1 else cap_px * 2 for key, _ in legend]
        lengths = [cap + cap_px * 0.3 + face.getlength(word) for cap, word in zip(caps, words, strict=True)]
        gap = cap_px * 0.7
        whole = sum(lengths) + gap * (len(lengths) - 1)
        if whole <= width - 2 * height * _MARGIN:
            break
    x, middle = (width - whole) / 2, height * (1 - _BOTTOM + 0.065)
    for (key, _), word, cap, length in zip(legend, words, caps, lengths, strict=True):
        draw_cap(draw, key, (x, middle - cap_px / 2, x + cap, middle + cap_px / 2))
        draw.text((x + cap + cap_px * 0.3, middle), word, fill=theme.INK, font=face, anchor="lm")
        x += length + gap


@lru_cache(maxsize=8)
def _text(screen: TextScreen, size_px: Size) -> Image.Image:
    width, height = size_px
    page = Image.new("RGB", size_px, theme.BACKGROUND)
    draw = ImageDraw.Draw(page)
    wide = min(width - 4 * height * _MARGIN, height * _MEASURE)
    top, bottom = height * (0.20 if screen.title else 0.08), height * 0.80
    _one_line(draw, (width / 2, height * 0.115), screen.title, round(height / 15), wide, theme.INK)
    if screen.keys:
        _keyboard(draw, screen.keys, (width / 2 - wide / 2, height * 0.42, width / 2 + wide / 2, bottom))
        bottom = height * 0.40
    _paragraphs(draw, screen.body, (width / 2 - wide / 2, top, width / 2 + wide / 2, bottom), height)
    _one_line(draw, (width / 2, height * 0.87), screen.prompt, round(height * _BODY), wide, theme.ACCENT)
    _one_line(draw, (width / 2, height * 0.965), screen.progress, round(height / 36), wide, theme.QUIET)
    return page


def _paragraphs(draw: ImageDraw.ImageDraw, body: str, box: tuple[float, float, float, float], height: int) -> None:
    """Set running text in the largest type that fits the box, in its middle; three lines or fewer are centred."""
    left, top, right, bottom = box
    smallest_px = max(8, round(height * _SMALLEST_BODY))
    for type_px in range(round(height * _BODY), smallest_px - 1, -1):
        lines = _wrap(body, type_px, right - left)
        if len(lines) * type_px * _LINE <= bottom - top:
            break
    face = theme.font(type_px)
    lines = _wrap(body, type_px, _narrowest(body, type_px, right - left, len(lines)))
    longest = max((face.getlength(line) for line in lines), default=0.0)
    y = top + max(0.0, (bottom - top - len(lines) * type_px * _LINE) / 2)
    for line in lines:
        indent = (longest - face.getlength(line)) / 2 if len(lines) <= 3 else 0.0
        draw.text(((left + right - longest) / 2 + indent, y), line, fill=theme.INK, font=face)
        y += type_px * _LINE


def _narrowest(body: str, type_px: int, wide: float, lines: int) -> float:
    """The narrowest column, to a letter or so, that needs no more lines: no last word left alone."""
    if lines > 3:
        return wide
    while len(_wrap(body, type_px, wide - type_px)) <= lines and wide > 12 * type_px:
        wide -= type_px
    return wide


def _wrap(body: str, type_px: int, wide: float) -> list[str]:
    """Break text into lines no longer than ``wide``; its own line breaks stay, a word too long is broken anywhere."""
    face = theme.font(type_px)
    lines: list[str] = []
    for paragraph in body.strip("\n").split("\n"):
        line = ""
        for word in paragraph.split(" "):
            longer = f"{line} {word}" if line else word
            if face.getlength(longer) <= wide:
                line = longer
                continue
            if line:
                lines.append(line)
            while face.getlength(word) > wide and len(word) > 1:
                cut = next(n for n in range(len(word) - 1, 0, -1) if n == 1 or face.getlength(word[:n]) <= wide)
                lines.append(word[:cut])
                word = word[cut:]
            line = word
        lines.append(line)
    return lines


def _keyboard(
    draw: ImageDraw.ImageDraw, keys: tuple[tuple[str, bool], ...], box: tuple[float, float, float, float]
) -> None:
    """The keys to be checked, where they lie to each other; pressed ones lit."""
    left, top, right, bottom = box
    pressed = dict(keys)
    caps, wide, high = arrange(tuple(pressed))
    unit = min((right - left) / wide, (bottom - top) / high, (bottom - top) / 2.5)
    x0, y0 = (left + right - wide * unit) / 2, (top + bottom - high * unit) / 2
    gap = unit * 0.05
    for cap in caps:
        x, y = x0 + cap.x * unit, y0 + cap.y * unit
        place = (x + gap, y + gap, x + cap.width * unit - gap, y + unit - gap)
        draw_cap(draw, cap.key, place, pressed=pressed[cap.key])
