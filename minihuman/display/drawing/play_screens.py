"""Drawings of the screens that show a world: play, shared control with an agent, and films of episodes.

In shared control, a frame around the picture and a line below it show who is in control: the frame is dashed for an
agent and solid for a person. Both are redrawn with every step, so they are fast copies: the frame is painted in NumPy,
and the line is a picture that is drawn once.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.sheet import (
    LINE_HEIGHT,
    MARGIN,
    MIN_TYPE_PX,
    MIN_TYPE_SIZE,
    OVERFLOW_TYPE_SIZE,
    Sheet,
    Size,
    draw_keycap,
)
from minihuman.display.mission_paragraphs import split_mission
from minihuman.display.shaping import measure_width_px
from minihuman.display.text import draw_line
from minihuman.display.typefaces import select_typefaces
from minihuman.experiment.keys import key_label
from minihuman.experiment.machine.screens import PlayScreen, TextLocale

Box = tuple[int, int, int, int]  # left, top, width, height


_Key = tuple[str, str]  # what is printed on it, what it does


_TOP = 0.10  # the height of the mission's band, in window heights


_BOTTOM = 0.16  # the height of the band of legend and progress, in window heights


_PROGRESS_Y = 0.965  # the middle of the line of progress, in window heights


_LEGEND_OFFSET = 0.068  # of the legend's middle below the picture's space, of the height


_MOST_ROWS = 3  # of the legend, in type that can be read


_GAP = 1.4  # between a key's word and the next key, of the type size


_CAP_GAP = 0.6  # between a key and its word, of the type size


_WORTH_ENLARGING = 1.2  # a picture that would grow by less keeps its size, and so stays sharp


_RULE_GAP = 0.5  # between a mission's rules beside the picture, of the type size


_MARKS = {"good": theme.GOOD, "bad": theme.BAD, "neutral": theme.MUTED_INK}


_PLATE_OPACITY = 235  # of 255


@dataclass(frozen=True, slots=True)
class PlayFrame:
    """The parts of a play screen that do not change during an episode.

    Attributes:
        mission: the text of the mission.
        progress: the text of the progress, at the bottom.
        legend: each key's name with the action that it chooses.
        labels: for keys whose printed label is known: the key's name, its label and the caption above the label.
        locale: the language, reading direction, theme and fonts of the texts.
        picture_px: the width and height of the world's picture before it is fitted; (0, 0) if unknown.
    """

    mission: str
    progress: str
    legend: tuple[tuple[str, str], ...]
    labels: tuple[tuple[str, str, str], ...]
    locale: TextLocale
    picture_px: Size = (0, 0)


def picture_size_px(size_px: Size) -> Size:
    """Return the largest width and height in pixels of a world's picture in a window.

    The shape is 4:3, like that of agents' observations: on a wider picture, a person would see more of a 3D world than
    an agent does.
    """
    width, height = size_px
    room_height = height - round(height * _TOP) - round(height * _BOTTOM)
    picture_width = min(width - 2 * round(height * MARGIN), room_height * 4 // 3)
    return picture_width, picture_width * 3 // 4


def paint_picture(frame: NDArray[np.uint8], picture: NDArray[np.uint8]) -> Box:
    """Fit a world's picture to a frame and paint it there, in place; return the box in pixels that it covers."""
    size_px = frame.shape[1], frame.shape[0]
    picture = _fit_picture(picture, *picture_size_px(size_px))
    left, top, width, height = _place_picture(picture.shape[1], picture.shape[0], size_px)
    frame[top : top + height, left : left + width] = picture
    return left, top, width, height


def locate_picture(picture: NDArray[np.uint8], size_px: Size) -> Box:
    """Return the box in pixels in which a world's picture is drawn in a window, after it is fitted to the window."""
    return _locate_size(picture.shape[1], picture.shape[0], size_px)


def _locate_size(width: int, height: int, size_px: Size) -> Box:
    """Return the box in which a picture of a width and height in pixels is drawn, after it is fitted to the window."""
    return _place_picture(*_fit_size(width, height, *picture_size_px(size_px)), size_px)


def _place_picture(width: int, height: int, size_px: Size) -> Box:
    """Return the box of a fitted picture, centred in a window's space between heading and legend."""
    window_width, window_height = size_px
    top = round(window_height * _TOP)
    bottom = window_height - round(window_height * _BOTTOM)
    x = (window_width - width) // 2
    y = top + (bottom - top - height) // 2
    return x, y, width, height


def _fit_picture(picture: NDArray[np.uint8], room_width: int, room_height: int) -> NDArray[np.uint8]:
    """Return a picture, scaled to fit into a space of ``room_width`` by ``room_height`` pixels.

    Its pixels are repeated by the largest whole factor above 1 that fits. If none fits, the picture keeps its size or
    is enlarged smoothly; a picture that is larger than the space is averaged down.
    """
    height, width = picture.shape[:2]
    scale = min(room_width // width, room_height // height)
    if scale > 1:
        return picture.repeat(scale, axis=0).repeat(scale, axis=1)
    fitted_size = _fit_size(width, height, room_width, room_height)
    if fitted_size == (width, height):
        return picture
    resampling = Image.Resampling.BOX
    if scale:
        resampling = Image.Resampling.BILINEAR
    return np.asarray(Image.fromarray(picture).resize(fitted_size, resampling))


def _fit_size(width: int, height: int, room_width: int, room_height: int) -> Size:
    """Return the width and height to which `_fit_picture` scales a picture of a given width and height."""
    scale = min(room_width // width, room_height // height)
    if scale > 1:
        return width * scale, height * scale
    factor = min(room_width / width, room_height / height)
    if scale == 1 and factor < _WORTH_ENLARGING:
        return width, height
    return max(1, int(width * factor)), max(1, int(height * factor))


def draw_surroundings(play_frame: PlayFrame, size_px: Size) -> Sheet:
    """Draw a play screen without the world's picture, and return the sheet.

    If the mission has rules, its goal is drawn above the picture, and each rule begins a new line beside the picture.
    If a window has no room for the rules there, the whole mission is drawn above.
    """
    width, height = size_px
    sheet = Sheet(size_px, play_frame.locale)
    text_width_px = width - 2 * height * MARGIN
    mission = play_frame.mission[:1].upper() + play_frame.mission[1:]
    heading, *rules = split_mission(mission)
    if rules and not _draw_rules(sheet, rules, play_frame.picture_px):
        heading = mission
    sheet.put_line((width / 2, height * _TOP / 2), heading, round(height / 24), text_width_px, theme.INK)
    _draw_legend(sheet, play_frame)
    progress_place = (width / 2, height * _PROGRESS_Y)
    sheet.put_line(progress_place, play_frame.progress, round(height / 36), text_width_px, theme.MUTED_INK)
    return sheet


def _draw_rules(sheet: Sheet, rules: list[str], picture_px: Size) -> bool:
    """Draw rules beside the picture; return False, without drawing, if they do not fit or the picture has no size.

    They are drawn on one side in readable type, or else on both sides in type that can be smaller.
    """
    if not all(picture_px):
        return False
    width, height = sheet.size_px
    margin = height * MARGIN
    left, top, _, _ = _locate_size(*picture_px, sheet.size_px)
    column_width_px = left - 2 * margin
    max_height_px = height * (1 - _BOTTOM) - top
    sides = [margin, width - margin - column_width_px]
    if sheet.locale.rtl:
        sides.reverse()
    half = math.ceil(len(rules) / 2)
    halves = [rules[:half], rules[half:]]
    largest = round(height / 32)
    least = max(MIN_TYPE_PX, round(sheet.high * OVERFLOW_TYPE_SIZE))
    for columns, smallest in (([rules], sheet.min_type_px), (halves, least)):
        for type_px in range(largest, smallest - 1, -1):
            if all(_measure_rules_px(sheet, column, type_px, column_width_px) <= max_height_px for column in columns):
                for column_left, column in zip(sides, columns, strict=False):
                    _draw_column(sheet, column, (column_left, top, column_width_px), type_px)
                return True
    return False


def _measure_rules_px(sheet: Sheet, rules: list[str], type_px: int, max_width_px: float) -> float:
    """Return the height in pixels of a column of rules that is ``max_width_px`` wide."""
    n_lines = sum(len(sheet.wrap(rule, type_px, max_width_px)) for rule in rules)
    return (n_lines * LINE_HEIGHT + (len(rules) - 1) * _RULE_GAP) * type_px


def _draw_column(sheet: Sheet, rules: list[str], column_px: tuple[float, float, float], type_px: int) -> None:
    """Draw rules below each other in a column, given by its left, top and width in pixels."""
    left, y, width = column_px
    for rule in rules:
        y = sheet.column(sheet.wrap(rule, type_px, width), left, left + width, y, type_px) + _RULE_GAP * type_px


def draw_mark(screen: PlayScreen, size_px: Size) -> Image.Image:
    """Draw the mark of an outcome: a coloured frame around the picture, with a sign and the score near the top.

    The rest of the returned layer, which has the window's size, is transparent.
    """
    fitted = screen.picture
    if fitted.shape[1]:
        fitted = _fit_picture(fitted, *picture_size_px(size_px))
    left, top, width, height = _place_picture(fitted.shape[1], fitted.shape[0], size_px)
    layer = Image.new("RGBA", size_px, (0, 0, 0, 0))
    draw = ImageDraw.Draw(layer)
    colour = _MARKS[screen.mark]
    stroke = max(3, round(size_px[1] / 90))
    draw.rectangle((left, top, left + width - 1, top + height - 1), outline=colour, width=stroke)
    _draw_outcome_label(draw, screen, (left + width / 2, top), size_px[1], stroke)
    return layer


def _draw_outcome_label(
    draw: ImageDraw.ImageDraw, screen: PlayScreen, top_middle: tuple[float, float], window_height: int, stroke: int
) -> None:
    """Draw the sign of an outcome and the score on a plate, below the middle of the picture's upper edge.

    A label at the lower edge would often hide the agent. ``top_middle`` is the middle (x, y) of the upper edge; it, the
    window's height and ``stroke``, the width of lines, are in pixels.
    """
    reach = window_height * 0.045
    type_px = round(window_height / 26)
    faces = select_typefaces(screen.locale.language, fonts=screen.locale.fonts)
    score_px = 0.0
    if screen.score_text:
        score_px = measure_width_px(screen.score_text, faces, type_px) + reach * 0.6
    middle, top = top_middle
    sign_x = middle - score_px / 2
    y = top + reach * 1.6
    plate = (sign_x - reach * 1.3, y - reach, sign_x + reach * 1.3 + score_px, y + reach)
    fill = (*theme.BACKGROUND, _PLATE_OPACITY)
    colour = _MARKS[screen.mark]
    draw.rounded_rectangle(plate, radius=reach * 0.4, fill=fill, outline=colour, width=stroke // 2)
    _draw_sign(draw, screen.mark, (sign_x, y), reach * 0.55, colour, stroke)
    if screen.score_text:
        draw_line(draw, (sign_x + reach, y), screen.score_text, faces=faces, size_px=type_px, colour=theme.INK)


def _draw_sign(
    draw: ImageDraw.ImageDraw, mark: str, place: tuple[float, float], reach: float, colour: theme.Colour, stroke: int
) -> None:
    """Draw a tick for "good", a cross for "bad" or a bar for "neutral", which differ even without colour.

    ``place`` is the sign's middle (x, y), ``reach`` is half its width, and ``stroke`` is the width of its lines, all in
    pixels.
    """
    x, y = place
    left = x - reach
    right = x + reach
    if mark == "good":
        tick_foot = (x - reach * 0.2, y + reach * 0.7)
        draw.line([(left, y), tick_foot, (right, y - reach * 0.8)], colour, stroke)
    elif mark == "bad":
        draw.line([(left, y - reach), (right, y + reach)], colour, stroke)
        draw.line([(left, y + reach), (right, y - reach)], colour, stroke)
    else:
        draw.line([(left, y), (right, y)], colour, stroke)


def _draw_legend(sheet: Sheet, play_frame: PlayFrame) -> None:
    """Draw the keys and their actions side by side in a centred line.

    If they do not fit in a line, the type is made smaller, and then they are broken into several lines.
    """
    printed_labels = {key: f"{above} {cap}".strip() for key, cap, above in play_frame.labels}
    keys = [(printed_labels.get(key, key_label(key)), action.replace("_", " ")) for key, action in play_frame.legend]
    rows, type_px = _fit_legend(sheet, keys)
    width, height = sheet.size_px
    keycap_height = type_px * (2.0 if len(rows) == 1 else 1.3)  # less than ``row_px``, so that rows do not touch
    row_px = type_px * 1.4
    legend_y = height * (1 - _BOTTOM + _LEGEND_OFFSET)
    raised_px = height * 0.004 * (len(rows) - 1)  # the progress line is right below
    middle_row = (len(rows) - 1) / 2
    for number, row in enumerate(rows):
        x = (width - _measure_legend_px(sheet, row, type_px)) / 2
        y = legend_y + (number - middle_row) * row_px - raised_px
        for cap, word in row:
            keycap_width = _measure_cap_px(sheet, cap, type_px)
            keycap_box = (x, y - keycap_height / 2, x + keycap_width, y + keycap_height / 2)
            draw_keycap(
                sheet.draw, cap, "", keycap_box, language=play_frame.locale.language, least_px=sheet.min_type_px
            )
            sheet.put((x + keycap_width + type_px * _CAP_GAP, y), word, type_px, theme.INK)
            x += _measure_legend_px(sheet, [(cap, word)], type_px) + type_px * _GAP


def _fit_legend(sheet: Sheet, keys: list[tuple[str, str]]) -> tuple[list[list[tuple[str, str]]], int]:
    """Break pairs of a key's label and its action into rows; return the rows and the size of their type in pixels."""
    width, height = sheet.size_px
    room_px = width - 2 * height * MARGIN
    type_px = round(height * 0.03)
    while type_px > sheet.min_type_px and _measure_legend_px(sheet, keys, type_px) > room_px:
        type_px -= 1
    rows = _break_legend(sheet, keys, type_px, room_px)
    while len(rows) > _MOST_ROWS and type_px > MIN_TYPE_PX:
        type_px -= 1
        rows = _break_legend(sheet, keys, type_px, room_px)
    return rows, type_px


def _break_legend(sheet: Sheet, keys: list[_Key], type_px: int, max_width_px: float) -> list[list[_Key]]:
    """Return keys, each with its action, broken into lines that are at most ``max_width_px`` pixels long."""
    rows: list[list[_Key]] = [[]]
    for key in keys:
        if rows[-1] and _measure_legend_px(sheet, [*rows[-1], key], type_px) > max_width_px:
            rows.append([])
        rows[-1].append(key)
    return rows


def _measure_cap_px(sheet: Sheet, cap: str, type_px: int) -> float:
    """Return the width in pixels of a drawn key with the label ``cap``."""
    return max(type_px * 2.0, (sheet.width_px(cap, type_px) + type_px) * 1.1)


def _measure_legend_px(sheet: Sheet, keys: list[_Key], type_px: int) -> float:
    """Return the length of a line of the legend in pixels."""
    gap_px = type_px * _CAP_GAP
    lengths = [_measure_cap_px(sheet, cap, type_px) + gap_px + sheet.width_px(word, type_px) for cap, word in keys]
    return sum(lengths) + type_px * _GAP * (len(keys) - 1)


_COLOURS = {"agent": theme.HIGHLIGHT, "person": theme.ACCENT}


_FLASHES = {"good": theme.GOOD, "bad": theme.BAD}


_SIGNS = {"good": "+", "bad": "\N{MINUS SIGN}"}


_LINE = 0.03  # the line's height, of the window's


_DASH = 4  # of the frame's thickness


def draw_steering(frame: NDArray[np.uint8], screen: PlayScreen, picture_box: Box) -> Box:
    """Draw a border around the picture and a line of text below it, which show who is in control.

    Args:
        frame: the screen's picture uint8[H, W, 3], which is changed in place.
        screen: the screen, which names the controller and, after a rating, whether to flash "good" or "bad".
        picture_box: the box that the world's picture covers.

    Returns:
        The box that may have changed, which includes the picture.
    """
    height, width = frame.shape[:2]
    stroke = max(3, height // 144)
    left, top, picture_width, picture_height = picture_box
    box = (left - stroke, top - stroke, picture_width + 2 * stroke, picture_height + 2 * stroke)
    colour = theme.find_colour(_FLASHES.get(screen.flash) or _COLOURS[screen.controller], screen.locale.theme)
    ground = theme.find_colour(theme.BACKGROUND, screen.locale.theme)
    gap_colour = colour
    if screen.controller == "agent" and not screen.flash:  # dashed
        gap_colour = ground
    _draw_frame(frame, box, stroke, colour, gap_colour)
    text = _SIGNS.get(screen.flash, screen.controller_text)
    line = _draw_text_line(text, screen.locale.language, colour, ground, box[2], round(height * _LINE))
    line_top = box[1] + box[3]
    line_left = (width - line.shape[1]) // 2
    rows = min(len(line), height - line_top)
    frame[line_top : line_top + rows, line_left : line_left + line.shape[1]] = line[:rows]
    changed_left = min(line_left, box[0])
    return changed_left, box[1], width - 2 * changed_left, box[3] + rows


def _draw_frame(frame: NDArray[np.uint8], box: Box, stroke: int, colour: theme.Colour, gap: theme.Colour) -> None:
    """Draw a box's four sides inside it, ``stroke`` pixels thick; they are dashed if ``gap`` is not ``colour``."""
    left, top, width, height = box
    right = left + width
    bottom = top + height
    along_x = _draw_dashed_side(width, stroke, colour, gap)
    along_y = _draw_dashed_side(height, stroke, colour, gap)[:, None]
    frame[top : top + stroke, left:right] = along_x
    frame[bottom - stroke : bottom, left:right] = along_x
    frame[top:bottom, left : left + stroke] = along_y
    frame[top:bottom, right - stroke : right] = along_y


@lru_cache(maxsize=16)
def _draw_dashed_side(length: int, stroke: int, colour: theme.Colour, gap: theme.Colour) -> NDArray[np.uint8]:
    """Return a side of the frame as uint8[length, 3]; it begins and ends with a dash, so that corners are complete."""
    side = np.full((length, 3), colour, np.uint8)
    n_gaps = max(1, round((length / (stroke * _DASH) - 1) / 2))
    n_pieces = 2 * n_gaps + 1
    piece_of_pixel = np.floor(np.arange(length) / length * n_pieces)
    side[piece_of_pixel % 2 == 1] = gap
    return side


@lru_cache(maxsize=16)
def _draw_text_line(
    text: str, language: str, colour: theme.Colour, ground: theme.Colour, width: int, height: int
) -> NDArray[np.uint8]:
    """Return a picture of the line of text as uint8[height, at least width, 3], wider if the text needs it."""
    faces = select_typefaces(language)
    size_px = max(MIN_TYPE_PX, round(height / _LINE * MIN_TYPE_SIZE))
    text_px = measure_width_px(text, faces, size_px)
    image_width = max(width, 2 * round(text_px / 2 + size_px))  # with a margin of one type size at each end
    image = Image.new("RGB", (image_width, height), ground)
    start = (image_width - text_px) / 2
    draw_line(ImageDraw.Draw(image), (start, height / 2), text, faces=faces, size_px=size_px, colour=colour)
    return np.asarray(image)


RectPx = tuple[float, float, float, float]  # left, top, right, bottom


def paste_picture(sheet: Sheet, picture: NDArray[np.uint8], box: RectPx) -> None:
    """Paste a picture into the middle of a box, as large as possible, with a thin line around the picture.

    A picture without pixels is left out.
    """
    left, top, right, bottom = box
    height, width = picture.shape[:2]
    if not height or not width:
        return
    scale = min((right - left) / width, (bottom - top) / height)
    resampling = Image.Resampling.NEAREST
    if scale < 1:
        resampling = Image.Resampling.BOX
    width = max(1, round(width * scale))
    height = max(1, round(height * scale))
    x = round((left + right - width) / 2)
    y = round((top + bottom - height) / 2)
    sheet.page.paste(Image.fromarray(picture).resize((width, height), resampling), (x, y))
    sheet.draw.rectangle((x - 2, y - 2, x + width + 1, y + height + 1), outline=theme.EDGE, width=2)
