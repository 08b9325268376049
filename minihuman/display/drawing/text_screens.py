"""Drawings of text screens: short texts with a title, the keyboard check, and the pages of a longer text.

A page has a title, a picture, running text with the line breaks of the plan, buttons and a page number.
"""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.display import text
from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.sheet import (
    LINE_HEIGHT,
    MARGIN,
    MIN_TYPE_PX,
    MIN_TYPE_SIZE,
    TIGHT_LINE_HEIGHT,
    Sheet,
    Size,
    arrange_keycaps,
    draw_keycap,
)
from minihuman.experiment.keys import key_caption, key_label
from minihuman.experiment.machine.screens import PageScreen, PictureLabel, TextScreen

BODY_TYPE_SIZE = 1 / 26  # type size of running text: 3.5 mm tall capitals on a 24-inch display
_MEASURE = 1.25  # longest line of running text, in heights
_MOST_CENTRED_LINES = 3  # a longer text is aligned at its start
# Shares of the height
_TITLE_Y = 0.115
_KEYBOARD_TOP = 0.42
_TEXT_BOTTOM = 0.80
_TEXT_BOTTOM_ABOVE_KEYBOARD = 0.40
_PROMPT_Y = 0.87
_PROGRESS_Y = 0.965
_GAP_BELOW_PICTURE = 0.03
_DOT_RADIUS = 0.009

_LABELLED_PICTURE_SHARE = 0.5  # of the width; labels have the other half
_LEAST_COLUMN = 12  # the narrowest column of running text, in type sizes
_LONGEST_LINE = 1.03  # of a page, in column widths: hinting makes some lines longer than they were measured


def draw_text(screen: TextScreen, size_px: Size) -> Sheet:
    """Draw a text screen, with the keyboard check if it has keys, and return the sheet."""
    width, height = size_px
    sheet = Sheet(size_px, screen.locale)
    column_px = min(width - 4 * height * MARGIN, height * _MEASURE)
    middle = width / 2
    left = middle - column_px / 2
    right = middle + column_px / 2
    top, bottom = measure_text_box(screen, height)
    sheet.put_line((middle, height * _TITLE_Y), screen.title, round(height / 15), column_px, theme.INK)
    if screen.keys:
        _draw_keyboard(sheet, screen, (left, height * _KEYBOARD_TOP, right, height * _TEXT_BOTTOM))
    _draw_paragraphs(sheet, screen.body, (left, top, right, bottom))
    if screen.waits:
        _draw_waiting(sheet, (middle, height * _PROMPT_Y))
    sheet.put_line((middle, height * _PROMPT_Y), screen.prompt, round(height * BODY_TYPE_SIZE), column_px, theme.ACCENT)
    sheet.put_line((middle, height * _PROGRESS_Y), screen.progress, round(height / 36), column_px, theme.MUTED_INK)
    return sheet


def _draw_waiting(sheet: Sheet, place: tuple[float, float]) -> None:
    """Draw three dots around a point (x, y), as a sign that the session goes on without a key press."""
    x, y = place
    radius = sheet.high * _DOT_RADIUS
    for number in (-1, 0, 1):
        left = x + number * 4 * radius - radius
        sheet.draw.ellipse((left, y - radius, left + 2 * radius, y + radius), fill=theme.HIGHLIGHT)


def measure_text_box(screen: TextScreen, height: int) -> tuple[float, float]:
    """Return the y in pixels at which running text begins and ends, in a window of a height in pixels."""
    top = height * 0.08
    bottom = height * _TEXT_BOTTOM
    if screen.title:
        top = height * 0.20
    if screen.keys:
        bottom = height * _TEXT_BOTTOM_ABOVE_KEYBOARD
    return top, bottom


def text_fits(screen: TextScreen, size_px: Size) -> bool:
    """Return whether a screen's text fits in the smallest readable type."""
    width, height = size_px
    sheet = Sheet(size_px, screen.locale)
    top, bottom = measure_text_box(screen, height)
    room_px = bottom - top
    column_px = min(width - 4 * height * MARGIN, height * _MEASURE)
    lines, type_px = sheet.fitted(screen.body, round(height * BODY_TYPE_SIZE), column_px, room_px)
    text_px = len(lines) * type_px * LINE_HEIGHT
    return type_px >= round(sheet.high * MIN_TYPE_SIZE) and text_px <= room_px


def _draw_paragraphs(sheet: Sheet, body: str, box: tuple[float, float, float, float]) -> None:
    """Draw running text in the middle of a box, in the largest type that fits; up to three lines are centred."""
    left, top, right, bottom = box
    width_px = right - left
    height_px = bottom - top
    _, window_height = sheet.size_px
    fitted_lines, type_px = sheet.fitted(body, round(window_height * BODY_TYPE_SIZE), width_px, height_px)
    narrowest_px = _find_narrowest_px(sheet, body, type_px, width_px, len(fitted_lines))
    lines = text.style_lines(sheet.wrap(body, type_px, narrowest_px))
    middle = (left + right) / 2
    line_px = type_px * LINE_HEIGHT
    y = top + max(0.0, (height_px - len(lines) * type_px * LINE_HEIGHT) / 2)
    if len(lines) > _MOST_CENTRED_LINES:
        longest_px = max(sheet.width_px(line, type_px) for line in lines)
        column_left = (left + right - longest_px) / 2
        column_right = (left + right + longest_px) / 2
        sheet.column(lines, column_left, column_right, y, type_px)
        return
    for line in lines:
        sheet.put((middle, y + line_px / 2), line, type_px, theme.INK, "m")
        y += line_px


def _find_narrowest_px(sheet: Sheet, body: str, type_px: int, width_px: float, n_lines: int) -> float:
    """Return the width of the narrowest column in which a text has ``n_lines`` lines, so that its lines are even.

    A text of more than three lines keeps the full width ``width_px``. The width is exact to about a letter.
    """
    if n_lines > _MOST_CENTRED_LINES:
        return width_px
    least_width_px = _LEAST_COLUMN * type_px
    while width_px > least_width_px and len(sheet.wrap(body, type_px, width_px - type_px)) <= n_lines:
        width_px -= type_px
    return width_px


def _draw_keyboard(sheet: Sheet, screen: TextScreen, box: tuple[float, float, float, float]) -> None:
    """Draw the keys to check as they are arranged on a keyboard, with pressed keys lit."""
    left, top, right, bottom = box
    is_pressed = dict(screen.keys)
    printed_labels = {key: (cap, above) for key, cap, above in screen.labels}
    caps, n_columns, n_rows = arrange_keycaps(tuple(is_pressed))
    key_px = min((right - left) / n_columns, (bottom - top) / n_rows, (bottom - top) / 2.5)  # or one key would be huge
    keyboard_left = (left + right - n_columns * key_px) / 2
    keyboard_top = (top + bottom - n_rows * key_px) / 2
    gap = key_px * 0.05
    for cap in caps:
        x = keyboard_left + cap.x * key_px
        y = keyboard_top + cap.y * key_px
        key_box = (x + gap, y + gap, x + cap.width * key_px - gap, y + key_px - gap)
        words, above = printed_labels.get(cap.key, (key_label(cap.key), key_caption(cap.key)))
        draw_keycap(
            sheet.draw,
            words,
            above,
            key_box,
            language=screen.locale.language,
            pressed=is_pressed[cap.key],
            least_px=sheet.min_type_px,
        )


def draw_page(screen: PageScreen, size_px: Size) -> Sheet:
    """Draw a page and return the sheet.

    The lines break at the same words in a window of any size; only the size of the type depends on the window.
    """
    sheet = Sheet(size_px, screen.locale)
    column_width = text.PAGE_COLUMN_WIDTH * sheet.high
    left = (size_px[0] - column_width) / 2
    right = (size_px[0] + column_width) / 2
    top = sheet.top + sheet.high * text.TEXT_TOP
    bottom = sheet.top + sheet.high * text.TEXT_BOTTOM
    sheet.header(screen.title, column_width)
    if screen.picture is not None:
        picture_bottom = bottom
        if screen.body:
            picture_bottom = top + sheet.high * (text.PAGE_PICTURE_HEIGHT - _GAP_BELOW_PICTURE)
        _draw_labelled_picture(sheet, screen.picture, screen.marks, (left, top, right, picture_bottom))
        top += sheet.high * text.PAGE_PICTURE_HEIGHT
    if screen.body:
        _draw_page_lines(sheet, screen, (left, top, right, bottom))
    sheet.footer(screen.buttons, screen.prompt, screen.progress, column_width)
    return sheet


def _draw_page_lines(sheet: Sheet, screen: PageScreen, box: tuple[float, float, float, float]) -> None:
    """Draw a page's text in a box, from its top or, if there is no other page, in the middle of its height.

    On an only page, up to three lines are also centred from left to right.
    """
    left, top, right, bottom = box
    lines = text.style_lines(text.break_page_lines(screen.body))
    type_px = _fit_page_type_px(sheet, lines, right - left)
    line_px = type_px * LINE_HEIGHT
    if screen.pages == 1:
        top += max(0.0, (bottom - top - len(lines) * line_px) / 2)
    if len(lines) > _MOST_CENTRED_LINES or screen.pages > 1:
        sheet.column(lines, left, right, top, type_px)
        return
    for number, line in enumerate(lines):
        sheet.put(((left + right) / 2, top + (number + 0.5) * line_px), line, type_px, theme.INK, "m")


def _fit_page_type_px(sheet: Sheet, lines: list[str], column_px: float) -> int:
    """Return the size of type in pixels of a page's lines; it is reduced if hinting makes a line too long."""
    longest_px = column_px * _LONGEST_LINE
    type_px = max(MIN_TYPE_PX, round(sheet.high * text.PAGE_TYPE_SIZE))
    while type_px > MIN_TYPE_PX and any(sheet.width_px(line, type_px) > longest_px for line in lines):
        type_px -= 1
    return type_px


def _draw_labelled_picture(
    sheet: Sheet, picture: NDArray[np.uint8], marks: tuple[PictureLabel, ...], box: tuple[float, float, float, float]
) -> None:
    """Paste a picture into a box, as large as possible, with labels at its sides and lines to what they describe."""
    left, top, right, bottom = box
    height, width = picture.shape[:2]
    room_px = right - left
    if marks:
        room_px *= _LABELLED_PICTURE_SHARE
    scale = min(room_px / width, (bottom - top) / height)
    shown_width = max(1, round(width * scale))
    shown_height = max(1, round(height * scale))
    x = (left + right - shown_width) / 2
    y = (top + bottom - shown_height) / 2
    resampling = Image.Resampling.LANCZOS
    if scale > 1 and scale == int(scale):
        resampling = Image.Resampling.NEAREST
    shown = Image.fromarray(picture).resize((shown_width, shown_height), resampling)
    sheet.page.paste(shown, (round(x), round(y)))
    picture_box = (x, y, x + shown_width, y + shown_height)
    for mark in sorted(marks, key=lambda mark: mark.y):
        _draw_label(sheet, mark, picture_box, (shown_width, shown_height), (left, right))


def _draw_label(
    sheet: Sheet,
    mark: PictureLabel,
    picture_box: tuple[float, float, float, float],
    size: tuple[int, int],
    sides: tuple[float, float],
) -> None:
    """Draw a label next to a picture, with a line to the point of the picture that it describes.

    ``size`` is the picture's; picture and labels lie between the left and the right of ``sides``. All are in pixels.
    """
    picture_left, picture_top, picture_right, _ = picture_box
    left, right = sides
    width, height = size
    x = picture_left + mark.x * width
    y = picture_top + mark.y * height
    reach = sheet.high * 0.02
    gap = reach * 0.4
    if mark.x >= 0.5:
        line_end = picture_right + reach
        room_px = right - line_end - gap
        label_x = line_end + gap
        anchor = "l"
    else:
        line_end = picture_left - reach
        room_px = line_end - left - gap
        label_x = line_end - gap
        anchor = "r"
    stroke = max(2, round(sheet.high / 360))
    dot = stroke * 2
    sheet.draw.line([(x, y), (line_end, y)], fill=theme.ACCENT, width=stroke)
    sheet.draw.ellipse((x - dot, y - dot, x + dot, y + dot), fill=theme.ACCENT)
    type_px = round(sheet.high / 36)
    while type_px > sheet.min_type_px and sheet.width_px(mark.label, type_px) > room_px:
        type_px -= 1
    lines = sheet.wrap(mark.label, type_px, room_px)
    middle_row = (len(lines) - 1) / 2
    for row, line in enumerate(lines):
        line_y = y + (row - middle_row) * type_px * TIGHT_LINE_HEIGHT
        sheet.put((label_x, line_y), line, type_px, theme.ACCENT, anchor)
