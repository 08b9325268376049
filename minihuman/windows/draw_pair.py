"""Two pictures side by side, with the keys to answer by below them and how far they have come between the two."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.study.screens import PairScreen
from minihuman.windows import theme
from minihuman.windows.drawings import Drawing
from minihuman.windows.sheet import MARGIN, Sheet, Size

Box = tuple[float, float, float, float]  # left, top, right, bottom


def draw_pair(screen: PairScreen, size_px: Size) -> Sheet:
    """Draw it: both sides alike, so that nothing but what they show tells them apart."""
    sheet = Sheet(size_px, screen.script)
    width, height = size_px
    margin = height * MARGIN
    wide = width - 2 * margin
    sheet.one_line((width / 2, height * 0.07), screen.title, round(height / 20), wide, theme.INK)
    top, bottom, gap = height * 0.14, height * 0.80, margin
    paste(sheet, screen.left, (margin, top, width / 2 - gap, bottom))
    paste(sheet, screen.right, (width / 2 + gap, top, width - margin, bottom))
    y, thick = height * 0.835, max(3, round(height / 180))
    left, right = width * 0.3, width * 0.7
    sheet.draw.rectangle((left, y, right, y + thick), fill=theme.SURFACE)
    sheet.draw.rectangle((left, y, left + (right - left) * screen.along, y + thick), fill=theme.LIT)
    sheet.one_line((width / 2, height * 0.895), screen.prompt, round(height / 30), wide, theme.INK)
    sheet.one_line((width / 2, height * 0.955), screen.progress, round(height / 36), wide, theme.QUIET)
    return sheet


def paste(sheet: Sheet, picture: NDArray[np.uint8], box: Box) -> None:
    """A picture as large as its half lets it be, a thin line round it."""
    left, top, right, bottom = box
    height, width = picture.shape[:2]
    if not height or not width:
        return
    scale = min((right - left) / width, (bottom - top) / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    x, y = round((left + right - size[0]) / 2), round((top + bottom - size[1]) / 2)
    resampling = Image.Resampling.BOX if scale < 1 else Image.Resampling.NEAREST
    sheet.page.paste(Image.fromarray(picture).resize(size, resampling), (x, y))
    sheet.draw.rectangle((x - 2, y - 2, x + size[0] + 1, y + size[1] + 1), outline=theme.EDGE, width=2)


DRAWINGS = (Drawing(PairScreen, draw_pair),)
