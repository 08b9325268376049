"""A page of a text: title, picture, running text broken as when the plan was made, buttons, which page it is."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.study.screens import PageScreen, Pointed
from minihuman.typeset import pages as page_shape
from minihuman.windows import theme
from minihuman.windows.sheet import LINE, TIGHT, Sheet, Size


def draw_page(screen: PageScreen, size_px: Size) -> Sheet:
    """Draw it. Lines are those of the reference, whatever the window's size: a smaller one only draws them smaller."""
    sheet = Sheet(size_px, screen.script)
    width, height = size_px
    high = sheet.high
    top = (height - high) / 2
    wide = page_shape.COLUMN * high
    left, right = (width - wide) / 2, (width + wide) / 2
    sheet.one_line((width / 2, top + high * 0.085), screen.title, round(high / 18), wide, theme.INK)
    y = top + high * page_shape.TEXT_TOP
    room = high * (page_shape.TEXT_BOTTOM - page_shape.TEXT_TOP)
    if screen.picture is not None:
        tall = high * (page_shape.PICTURE - 0.03) if screen.body else room
        _picture(sheet, screen.picture, screen.marks, (left, y, right, y + tall))
        y += high * page_shape.PICTURE
        room -= high * page_shape.PICTURE
    lines = page_shape.page_lines(screen.body, sheet.faces) if screen.body else []
    type_px = _type_px(sheet, lines, wide)
    if screen.pages == 1:  # a short text stands in the middle
        y += max(0.0, (room - len(lines) * type_px * LINE) / 2)
    if len(lines) <= 3 and screen.pages == 1:
        for line in lines:
            sheet.put((width / 2, y + type_px * LINE / 2), line, type_px, theme.INK, "m")
            y += type_px * LINE
    else:
        sheet.column(lines, left, right, y, type_px)
    sheet.buttons(screen.buttons, top + high * 0.872)
    sheet.one_line((width / 2, top + high * 0.925), screen.prompt, round(high / 36), wide, theme.QUIET)
    sheet.one_line((width / 2, top + high * 0.97), screen.progress, round(high / 36), wide, theme.QUIET)
    return sheet


def _type_px(sheet: Sheet, lines: list[str], wide: float) -> int:
    """The reference's type for this height; a pixel less where hinting would make a line too long."""
    type_px = max(8, round(sheet.high * page_shape.TYPE))
    while type_px > 8 and any(sheet.width_px(line, type_px) > wide * 1.03 for line in lines):
        type_px -= 1
    return type_px


def _picture(
    sheet: Sheet, picture: NDArray[np.uint8], marks: tuple[Pointed, ...], box: tuple[float, float, float, float]
) -> None:
    """A picture as large as the box lets it be, with words beside what they are about and a line to it."""
    left, top, right, bottom = box
    height, width = picture.shape[:2]
    scale = min((right - left) * (0.5 if marks else 1.0) / width, (bottom - top) / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    x0, y0 = (left + right - size[0]) / 2, (top + bottom - size[1]) / 2
    resampling = Image.Resampling.NEAREST if scale > 1 and scale == int(scale) else Image.Resampling.LANCZOS
    sheet.page.paste(Image.fromarray(picture).resize(size, resampling), (round(x0), round(y0)))
    type_px, reach = round(sheet.high / 36), sheet.high * 0.02
    for mark in sorted(marks, key=lambda mark: mark.y):
        x, y = x0 + mark.x * size[0], y0 + mark.y * size[1]
        on_right = mark.x >= 0.5
        end = x0 + size[0] + reach if on_right else x0 - reach
        stroke = max(2, round(sheet.high / 360))
        sheet.draw.line([(x, y), (end, y)], fill=theme.ACCENT, width=stroke)
        sheet.draw.ellipse((x - stroke * 2, y - stroke * 2, x + stroke * 2, y + stroke * 2), fill=theme.ACCENT)
        room = (right - end if on_right else end - left) - reach * 0.4
        size_px = type_px
        while size_px > sheet.smallest_px and sheet.width_px(mark.label, size_px) > room:
            size_px -= 1
        beside = end + reach * 0.4 if on_right else end - reach * 0.4
        lines = sheet.wrap(mark.label, size_px, room)
        for row, line in enumerate(lines):
            place = (beside, y + (row - (len(lines) - 1) / 2) * size_px * TIGHT)
            sheet.put(place, line, size_px, theme.ACCENT, "l" if on_right else "r")
