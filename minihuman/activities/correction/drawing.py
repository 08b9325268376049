"""Drawing of the screen of an episode under review."""

from minihuman.activities.correction.screens import FilmScreen
from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.play_screens import paste_picture
from minihuman.display.drawing.sheet import MARGIN, Sheet, Size

# shares of the screen's height
_FILM_TOP = 0.05
_FILM_BOTTOM = 0.82
_BAR_AT = 0.85
_PROMPT_AT = 0.905
_PROGRESS_AT = 0.96
# shares of the screen's width
_BAR_LEFT = 0.2
_BAR_RIGHT = 0.8
# how many times the size goes into the screen's height
_PROMPTS_HIGH = 30
_PROGRESS_LINES_HIGH = 36
_BARS_HIGH = 180
_LEAST_BAR_PX = 3


def draw_film(screen: FilmScreen, size_px: Size) -> Sheet:
    """Draw the screen of an episode under review: the present picture, a bar of the position, and the texts."""
    sheet = Sheet(size_px, screen.locale)
    width, height = size_px
    margin = height * MARGIN
    text_width = width - 2 * margin
    middle = width / 2
    film_box = (margin, height * _FILM_TOP, width - margin, height * _FILM_BOTTOM)
    paste_picture(sheet, screen.pictures[screen.step], film_box)
    bar_top = height * _BAR_AT
    bar_left = width * _BAR_LEFT
    bar_right = width * _BAR_RIGHT
    bar_position = bar_left + (bar_right - bar_left) * screen.step / max(1, len(screen.pictures) - 1)
    thickness = max(_LEAST_BAR_PX, round(height / _BARS_HIGH))
    sheet.draw.rectangle((bar_left, bar_top, bar_right, bar_top + thickness), fill=theme.SURFACE)
    sheet.draw.rectangle((bar_left, bar_top, bar_position, bar_top + thickness), fill=theme.HIGHLIGHT)
    sheet.put_line((middle, height * _PROMPT_AT), screen.prompt, round(height / _PROMPTS_HIGH), text_width, theme.INK)
    progress_px = round(height / _PROGRESS_LINES_HIGH)
    sheet.put_line((middle, height * _PROGRESS_AT), screen.progress, progress_px, text_width, theme.MUTED_INK)
    return sheet
