"""Drawing of a comparison: two films side by side."""

from minihuman.activities.preferences.screens import PairScreen
from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.play_screens import paste_picture
from minihuman.display.drawing.sheet import MARGIN, Sheet, Size


def draw_pair(screen: PairScreen, size_px: Size) -> Sheet:
    """Draw both films alike, so that they differ in nothing but their content."""
    sheet = Sheet(size_px, screen.locale)
    width, height = size_px
    margin = height * MARGIN
    wide = width - 2 * margin
    sheet.put_line((width / 2, height * 0.07), screen.title, round(height / 20), wide, theme.INK)
    top = height * 0.14
    bottom = height * 0.80
    gap = margin
    paste_picture(sheet, screen.left, (margin, top, width / 2 - gap, bottom))
    paste_picture(sheet, screen.right, (width / 2 + gap, top, width - margin, bottom))
    y = height * 0.835
    thick = max(3, round(height / 180))
    left = width * 0.3
    right = width * 0.7
    sheet.draw.rectangle((left, y, right, y + thick), fill=theme.SURFACE)
    sheet.draw.rectangle((left, y, left + (right - left) * screen.along, y + thick), fill=theme.HIGHLIGHT)
    sheet.put_line((width / 2, height * 0.895), screen.prompt, round(height / 30), wide, theme.INK)
    sheet.put_line((width / 2, height * 0.955), screen.progress, round(height / 36), wide, theme.MUTED_INK)
    return sheet
