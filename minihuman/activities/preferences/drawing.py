"""Drawing of a comparison: two films side by side."""

from minihuman.activities.preferences.screens import PairScreen
from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.play_screens import paste_picture
from minihuman.display.drawing.sheet import MARGIN, Sheet, Size

# shares of the screen's height
_TITLE_AT = 0.07
_FILMS_TOP = 0.14
_FILMS_BOTTOM = 0.80
_BAR_AT = 0.835
_PROMPT_AT = 0.895
_PROGRESS_AT = 0.955
# shares of the screen's width
_BAR_LEFT = 0.3
_BAR_RIGHT = 0.7
# how many times the size goes into the screen's height
_TITLES_HIGH = 20
_PROMPTS_HIGH = 30
_PROGRESS_LINES_HIGH = 36
_BARS_HIGH = 180
_LEAST_BAR_PX = 3


def draw_pair(screen: PairScreen, size_px: Size) -> Sheet:
    """Draw a comparison: both films in boxes of the same size, the films' progress bar, and the texts."""
    sheet = Sheet(size_px, screen.locale)
    width, height = size_px
    margin = height * MARGIN
    text_width = width - 2 * margin
    middle = width / 2
    sheet.put_line((middle, height * _TITLE_AT), screen.title, round(height / _TITLES_HIGH), text_width, theme.INK)
    top = height * _FILMS_TOP
    bottom = height * _FILMS_BOTTOM
    paste_picture(sheet, screen.left, (margin, top, middle - margin, bottom))
    paste_picture(sheet, screen.right, (middle + margin, top, width - margin, bottom))
    bar_top = height * _BAR_AT
    thickness = max(_LEAST_BAR_PX, round(height / _BARS_HIGH))
    bar_left = width * _BAR_LEFT
    bar_right = width * _BAR_RIGHT
    sheet.draw.rectangle((bar_left, bar_top, bar_right, bar_top + thickness), fill=theme.SURFACE)
    bar_position = bar_left + (bar_right - bar_left) * screen.along
    sheet.draw.rectangle((bar_left, bar_top, bar_position, bar_top + thickness), fill=theme.HIGHLIGHT)
    sheet.put_line((middle, height * _PROMPT_AT), screen.prompt, round(height / _PROMPTS_HIGH), text_width, theme.INK)
    progress_px = round(height / _PROGRESS_LINES_HIGH)
    sheet.put_line((middle, height * _PROGRESS_AT), screen.progress, progress_px, text_width, theme.MUTED_INK)
    return sheet
