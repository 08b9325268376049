"""One picture of an episode with the keys to go through it below, and how far along it is."""

from minihuman.study.screens import FilmScreen
from minihuman.windows import theme
from minihuman.windows.draw_pair import paste
from minihuman.windows.drawings import Drawing
from minihuman.windows.sheet import MARGIN, Sheet, Size


def draw_film(screen: FilmScreen, size_px: Size) -> Sheet:
    """Draw it."""
    sheet = Sheet(size_px, screen.script)
    width, height = size_px
    margin = height * MARGIN
    wide = width - 2 * margin
    paste(sheet, screen.pictures[screen.step], (margin, height * 0.05, width - margin, height * 0.82))
    y, thick, left, right = height * 0.85, max(3, round(height / 180)), width * 0.2, width * 0.8
    along = left + (right - left) * screen.step / max(1, len(screen.pictures) - 1)
    sheet.draw.rectangle((left, y, right, y + thick), fill=theme.SURFACE)
    sheet.draw.rectangle((left, y, along, y + thick), fill=theme.LIT)
    sheet.one_line((width / 2, height * 0.905), screen.prompt, round(height / 30), wide, theme.INK)
    sheet.one_line((width / 2, height * 0.96), screen.progress, round(height / 36), wide, theme.QUIET)
    return sheet


DRAWINGS = (Drawing(FilmScreen, draw_film),)
