"""Drawing of the screen of an episode under review."""

from minihuman.activities.correction.screens import FilmScreen
from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.play_screens import paste_picture
from minihuman.display.drawing.sheet import MARGIN, Sheet, Size


def draw_film(screen: FilmScreen, size_px: Size) -> Sheet:
    """Draw the episode's present picture and the keys."""
    sheet = Sheet(size_px, screen.locale)
    width, height = size_px
    margin = height * MARGIN
    wide = width - 2 * margin
    paste_picture(sheet, screen.pictures[screen.step], (margin, height * 0.05, width - margin, height * 0.82))
    y = height * 0.85
    thick = max(3, round(height / 180))
    left = width * 0.2
    right = width * 0.8
    along = left + (right - left) * screen.step / max(1, len(screen.pictures) - 1)
    sheet.draw.rectangle((left, y, right, y + thick), fill=theme.SURFACE)
    sheet.draw.rectangle((left, y, along, y + thick), fill=theme.HIGHLIGHT)
    sheet.put_line((width / 2, height * 0.905), screen.prompt, round(height / 30), wide, theme.INK)
    sheet.put_line((width / 2, height * 0.96), screen.progress, round(height / 36), wide, theme.MUTED_INK)
    return sheet
