"""Drawings of questions: the text, the answer controls, and the spots that a pointer can press."""

from PIL import ImageColor

from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.sheet import LINE_HEIGHT, MIN_TYPE_SIZE, Sheet, Size, Spot
from minihuman.display.drawing.text_fields import draw_field
from minihuman.display.text import style_lines
from minihuman.experiment.machine.screens import (
    OptionList,
    QuestionScreen,
    RatingMatrix,
    RatingScale,
    ShapeCanvas,
    Slider,
    TextField,
)

_TYPE = 1 / 30
_WIDE = 1.16  # of the height
_TOP = 0.15
_BOTTOM = 0.82


def draw_question(screen: QuestionScreen, size_px: Size) -> Sheet:
    """Draw a question."""
    sheet = Sheet(size_px, screen.locale)
    width, height = size_px
    high = sheet.high
    top = (height - high) / 2
    wide = _WIDE * high
    left = (width - wide) / 2
    right = (width + wide) / 2
    sheet.put_line((width / 2, top + high * 0.085), screen.title, round(high / 18), wide, theme.INK)
    room = _measure_question_room(screen) * high
    lines, type_px = sheet.fitted(screen.question, round(high * _TYPE), wide, room)
    y = top + high * _TOP
    y += max(0.0, room - len(lines) * type_px * LINE_HEIGHT)  # close to its answers
    sheet.column(style_lines(lines), left, right, y, type_px)
    box = (left, top + high * _TOP + room + high * 0.02, right, top + high * (_BOTTOM - 0.04))
    match screen.item:
        case OptionList():
            _draw_options(sheet, screen.item, box)
        case RatingScale():
            _draw_scale(sheet, screen.item, box)
        case RatingMatrix():
            _draw_matrix(sheet, screen.item, box)
        case Slider():
            _draw_slider(sheet, screen.item, box)
        case TextField():
            _draw_text_field(sheet, screen.item, box)
        case ShapeCanvas():
            _draw_shapes(sheet, screen.item, box)
    if screen.note:
        sheet.put_line((width / 2, top + high * 0.805), screen.note, round(high / 34), wide, theme.ACCENT)
    sheet.buttons(screen.buttons, top + high * 0.872)
    sheet.put_line((width / 2, top + high * 0.925), screen.prompt, round(high / 36), wide, theme.MUTED_INK)
    sheet.put_line((width / 2, top + high * 0.97), screen.progress, round(high / 36), wide, theme.MUTED_INK)
    return sheet


def question_fits(screen: QuestionScreen, size_px: Size) -> bool:
    """Return whether a question's text and answers fit the screen in the smallest readable type."""
    sheet = Sheet(size_px, screen.locale)
    room = _measure_question_room(screen) * sheet.high
    wide = _WIDE * sheet.high
    lines, type_px = sheet.fitted(screen.question, round(sheet.high * _TYPE), wide, room)
    if type_px < round(sheet.high * MIN_TYPE_SIZE) or len(lines) * type_px * LINE_HEIGHT > room:
        return False
    if isinstance(screen.item, RatingMatrix):
        return all(len(lines) < 3 for lines in _statement_lines(sheet, screen.item, wide))
    if isinstance(screen.item, OptionList):
        rows = _fit_options(sheet, screen.item, wide, (_BOTTOM - _TOP - 0.06) * sheet.high - room)
        return rows is not None
    return True


def _measure_question_room(screen: QuestionScreen) -> float:
    """Return the share of the height that is reserved for the question's text."""
    if isinstance(screen.item, RatingMatrix):
        return 0.10
    if not isinstance(screen.item, OptionList):
        return 0.30
    if len(screen.item.options) < 7:
        return max(0.10, 0.58 - 0.075 * len(screen.item.options))
    return 0.10


def _fit_options(sheet: Sheet, item: OptionList, wide: float, high: float) -> tuple[list[list[str]], int] | None:
    """Return the lines of every option and the largest type size at which all options fit; None if there is none."""
    type_px = round(sheet.high * _TYPE)
    while type_px >= sheet.min_type_px:
        rows = [sheet.wrap(option, type_px, wide - type_px * 4) for option in item.options]
        if sum(len(row) * type_px * 1.2 + type_px * 0.75 for row in rows) <= high:
            return rows, type_px
        type_px -= 1
    return None


def _draw_options(sheet: Sheet, item: OptionList, box: tuple[float, float, float, float]) -> None:
    """Draw options below each other, each with its number and a circle or, if several can be chosen, a tick box."""
    left, top, right, bottom = box
    fitted = _fit_options(sheet, item, right - left, bottom - top)
    type_px = sheet.min_type_px
    rows, type_px = fitted or ([[option] for option in item.options], type_px)
    y = top
    for number, lines in enumerate(rows):
        tall = len(lines) * type_px * 1.2 + type_px * 0.6
        is_chosen = number in item.chosen
        outline, stroke = _option_outline(sheet, is_chosen=is_chosen, has_cursor=number == item.cursor)
        sheet.draw.rounded_rectangle(
            (left, y, right, y + tall), radius=type_px * 0.35, fill=theme.SURFACE, outline=outline, width=stroke
        )
        sheet.spots.append(Spot(f"option:{number}", left, y, right, y + tall))
        tick_x = sheet.from_start(left, right, type_px * 1.3)
        _draw_tick_box(sheet, (tick_x, y + tall / 2), type_px, is_chosen=is_chosen, is_box=item.many)
        line_x = sheet.from_start(left, right, type_px * 2.6)
        line_y = y + type_px * 0.3 + type_px * 0.6
        for line in lines:
            sheet.put((line_x, line_y), line, type_px, theme.INK, sheet.start_anchor)
            line_y += type_px * 1.2
        if number < 9:
            number_x = sheet.from_end(left, right, type_px * 0.9)
            small = max(sheet.min_type_px, round(type_px * 0.75))
            sheet.put((number_x, y + tall / 2), str(number + 1), small, theme.MUTED_INK, "m")
        y += tall + type_px * 0.15


def _option_outline(sheet: Sheet, *, is_chosen: bool, has_cursor: bool) -> tuple[theme.Colour, int]:
    """Return the colour and the width of the line around an option."""
    if is_chosen:
        return theme.HIGHLIGHT, max(1, round(sheet.high / 240))
    stroke = max(1, round(sheet.high / 450))
    if has_cursor:
        return theme.MUTED_INK, stroke
    return theme.EDGE, stroke


def _draw_tick_box(sheet: Sheet, place: tuple[float, float], type_px: int, *, is_chosen: bool, is_box: bool) -> None:
    """Draw an option's tick box, or its circle if only one option can be chosen."""
    x, y = place
    reach = type_px * 0.42
    stroke = max(2, round(type_px / 10))
    outline = _choice_outline(is_chosen)
    box = (x - reach, y - reach, x + reach, y + reach)
    if is_box:
        sheet.draw.rectangle(box, outline=outline, width=stroke)
        if is_chosen:
            tick = [(x - reach * 0.6, y), (x - reach * 0.1, y + reach * 0.5), (x + reach * 0.65, y - reach * 0.5)]
            sheet.draw.line(tick, fill=theme.HIGHLIGHT, width=stroke + 1)
        return
    sheet.draw.ellipse(box, outline=outline, width=stroke)
    if is_chosen:
        dot = reach / 2
        sheet.draw.ellipse((x - dot, y - dot, x + dot, y + dot), fill=theme.HIGHLIGHT)


def _choice_fill(is_chosen: bool) -> theme.Colour:
    if is_chosen:
        return theme.HIGHLIGHT
    return theme.SURFACE


def _choice_outline(is_chosen: bool) -> theme.Colour:
    if is_chosen:
        return theme.HIGHLIGHT
    return theme.MUTED_INK


def _choice_ink(is_chosen: bool) -> theme.Colour:
    """Return the colour of the text on an option."""
    if is_chosen:
        return theme.BACKGROUND
    return theme.INK


def _has_words(scale: RatingScale | RatingMatrix) -> bool:
    """Return whether every point of a scale has a text instead of a number."""
    return all(not point.isdecimal() for point in scale.points)


def _draw_scale(sheet: Sheet, item: RatingScale, box: tuple[float, float, float, float]) -> None:
    """Draw the points of a scale side by side in reading order, with texts at the two ends or below each point."""
    left, top, right, _ = box
    count = len(item.points)
    unit = (right - left) / count
    reach = min(unit * 0.36, sheet.high * 0.04)
    y = top + sheet.high * 0.10
    has_words = _has_words(item)
    small = sheet.min_type_px
    for number, point in enumerate(item.points):
        x = left + unit * (sheet.place_from_left(number, count) + 0.5)
        is_chosen = number == item.chosen
        sheet.draw.ellipse(
            (x - reach, y - reach, x + reach, y + reach),
            fill=_choice_fill(is_chosen),
            outline=_choice_outline(is_chosen),
            width=max(2, round(sheet.high / 360)),
        )
        label = point
        if has_words:
            label = str(number + 1)
        sheet.put((x, y), label, max(small, round(reach * 0.95)), _choice_ink(is_chosen), "m")
        bottom = y + reach * 1.4
        if has_words:
            lines = sheet.wrap(point, small, unit * 0.94)
            for row, line in enumerate(lines):
                sheet.put((x, bottom + small * (row * 1.2 + 0.8)), line, small, theme.INK, "m")
            bottom += small * 1.2 * len(lines)
        sheet.spots.append(Spot(f"option:{number}", x - unit / 2, y - reach * 1.6, x + unit / 2, bottom + small))
    if not has_words:
        _draw_end_texts(sheet, item.low, item.high, (left, right), y + reach * 1.4 + small)


_STATEMENT_SHARE = 0.42  # of the width; the points have the rest


def _statement_lines(sheet: Sheet, item: RatingMatrix, wide: float) -> list[list[str]]:
    return [sheet.wrap(row, sheet.min_type_px, wide * _STATEMENT_SHARE - sheet.high * 0.03) for row in item.rows]


def _draw_matrix(sheet: Sheet, item: RatingMatrix, box: tuple[float, float, float, float]) -> None:
    """Draw a row for each statement with its points in reading order, below a head with the meaning of the points."""
    left, top, right, bottom = box
    small = sheet.min_type_px
    wide = right - left
    if sheet.locale.rtl:
        columns = (left, right - wide * _STATEMENT_SHARE)
    else:
        columns = (left + wide * _STATEMENT_SHARE, right)
    top += _draw_matrix_heads(sheet, item, columns, top)
    tall = min((bottom - top) / len(item.rows), sheet.high * 0.09)
    for row, lines in enumerate(_statement_lines(sheet, item, wide)):
        y = top + tall * (row + 0.5)
        if row == item.cursor:
            stripe = (left, y - tall * 0.46, right, y + tall * 0.46)
            sheet.draw.rounded_rectangle(stripe, radius=small * 0.4, outline=theme.EDGE)
        x = sheet.from_start(left, right, sheet.high * 0.015)
        for number, line in enumerate(lines):
            offset = (number - (len(lines) - 1) / 2) * small * 1.2
            sheet.put((x, y + offset), line, small, theme.INK, sheet.start_anchor)
        _draw_matrix_points(sheet, item, row, columns, y, tall)


def _draw_matrix_heads(sheet: Sheet, matrix: RatingMatrix, columns: tuple[float, float], top: float) -> float:
    """Write the meaning of the points above their columns; return the height of this head in pixels."""
    small = sheet.min_type_px
    if not _has_words(matrix):
        _draw_end_texts(sheet, matrix.low, matrix.high, columns, top)
        return small * 2.4
    left, right = columns
    unit = (right - left) / len(matrix.points)
    heads = [sheet.wrap(point, small, unit * 0.96) for point in matrix.points]
    for point, lines in enumerate(heads):
        x = left + unit * (sheet.place_from_left(point, len(heads)) + 0.5)
        for number, line in enumerate(lines):
            sheet.put((x, top + small * (number * 1.2 + 0.6)), line, small, theme.INK, "m")
    return small * 1.2 * max(2, *map(len, heads)) + small * 0.6


def _draw_matrix_points(
    sheet: Sheet, matrix: RatingMatrix, row: int, columns: tuple[float, float], y: float, tall: float
) -> None:
    """Draw the points of one statement, and add a spot for each."""
    left, right = columns
    count = len(matrix.points)
    unit = (right - left) / count
    reach = min(unit * 0.36, tall * 0.36)
    has_words = _has_words(matrix)
    for point, label in enumerate(matrix.points):
        place = sheet.place_from_left(point, count)
        x = left + unit * (place + 0.5)
        is_chosen = matrix.chosen[row] == point
        sheet.draw.ellipse(
            (x - reach, y - reach, x + reach, y + reach),
            fill=_choice_fill(is_chosen),
            outline=_choice_outline(is_chosen),
            width=max(2, round(sheet.high / 360)),
        )
        if not has_words:
            sheet.put((x, y), label, sheet.min_type_px, _choice_ink(is_chosen), "m")
        option = row * count + point
        cell = (left + unit * place, y - tall / 2, left + unit * (place + 1), y + tall / 2)
        sheet.spots.append(Spot(f"option:{option}", *cell))


def _draw_end_texts(sheet: Sheet, low: str, high: str, sides: tuple[float, float], y: float) -> None:
    """Write the texts at the two ends of a scale, each within its half of the width."""
    left, right = sides
    small = round(sheet.high / 36)
    ends = [low, high]
    if sheet.locale.rtl:
        ends.reverse()
    for words, x, anchor in zip(ends, sides, "lr", strict=True):
        for row, line in enumerate(sheet.wrap(words, small, (right - left) * 0.46)):
            sheet.put((x, y + small * (row * LINE_HEIGHT + 0.5)), line, small, theme.INK, anchor)


def _draw_slider(sheet: Sheet, slider: Slider, box: tuple[float, float, float, float]) -> None:
    """Draw a line with ticks, and a mark on it once the slider has been set."""
    left, top, right, _ = box
    y = top + sheet.high * 0.12
    stroke = max(2, round(sheet.high / 300))
    sheet.draw.line([(left, y), (right, y)], fill=theme.MUTED_INK, width=stroke)
    for tick in range(slider.ticks + 1):
        x = left + (right - left) * tick / slider.ticks
        is_long = tick in (0, slider.ticks) or tick * 2 == slider.ticks
        tall = sheet.high * (0.022 if is_long else 0.012)
        sheet.draw.line([(x, y - tall), (x, y + tall)], fill=theme.MUTED_INK, width=stroke)
    rtl = sheet.locale.rtl
    if slider.position is not None:
        share = 1 - slider.position if rtl else slider.position
        _draw_slider_mark(sheet, slider, left + (right - left) * share, y, stroke)
    reach = sheet.high * 0.06
    sheet.spots.append(Spot("slider", left, y - reach, right, y + reach, rtl))
    _draw_end_texts(sheet, slider.low, slider.high, (left, right), y + sheet.high * 0.05)


def _draw_slider_mark(sheet: Sheet, slider: Slider, x: float, y: float, stroke: int) -> None:
    """Draw the mark of a slider that has been set, with its value above."""
    reach = sheet.high * 0.022
    circle = (x - reach, y - reach, x + reach, y + reach)
    sheet.draw.ellipse(circle, fill=theme.HIGHLIGHT, outline=theme.INK, width=stroke)
    if slider.value:
        sheet.put((x, y - reach * 2.4), slider.value, round(sheet.high / 30), theme.INK, "m")


def _draw_shapes(sheet: Sheet, item: ShapeCanvas, box: tuple[float, float, float, float]) -> None:
    """Draw boxes and ellipses with their labels, on the largest canvas that fits."""
    left, top, right, bottom = box
    canvas_width = min(right - left, (bottom - top) * item.aspect)
    canvas_height = canvas_width / item.aspect
    canvas_left = (left + right - canvas_width) / 2
    stroke = max(2, round(sheet.high / 360))
    for shape in item.shapes:
        x = canvas_left + shape.x * canvas_width
        y = top + shape.y * canvas_height
        x_end = x + shape.width * canvas_width
        y_end = y + shape.height * canvas_height
        draw = sheet.draw.ellipse if shape.is_round else sheet.draw.rectangle
        if shape.fill and shape.chosen:  # it keeps its colour; a frame shows that it is chosen
            reach = stroke * 4
            frame = (x - reach, y - reach, x_end + reach, y_end + reach)
            draw(frame, outline=theme.HIGHLIGHT, width=stroke * 2)
        draw((x, y, x_end, y_end), fill=shape.fill or _choice_fill(shape.chosen), outline=theme.EDGE, width=stroke)
        if shape.label:
            middle = ((x + x_end) / 2, (y + y_end) / 2)
            ink = _choose_ink(shape.fill) if shape.fill else _choice_ink(shape.chosen)
            sheet.put_line(middle, shape.label, round(sheet.high / 36), shape.width * canvas_width, ink)
        if shape.target:
            sheet.spots.append(Spot(shape.target, x, y, x_end, y_end))


def _choose_ink(fill: str) -> theme.Colour:
    """Choose black or white, whichever has the higher contrast on a colour (WCAG 2.2, relative luminance)."""
    luminance = 0.0
    for channel, weight in zip(ImageColor.getrgb(fill), (0.2126, 0.7152, 0.0722), strict=False):
        share = channel / 255
        if share <= 0.04045:
            luminance += weight * share / 12.92
        else:
            luminance += weight * ((share + 0.055) / 1.055) ** 2.4
    if luminance > 0.179:  # where both contrasts are the same
        return (0, 0, 0)
    return (255, 255, 255)


def field_type_px(sheet: Sheet) -> int:
    """Return the size of type in a field."""
    return round(sheet.high * _TYPE)


def _draw_text_field(sheet: Sheet, item: TextField, box: tuple[float, float, float, float]) -> None:
    """Draw a text field with its text, caret and unit."""
    left, top, right, bottom = box
    type_px = field_type_px(sheet)
    pad = type_px * 0.6
    if item.long:
        tall = bottom - top
    else:
        tall = type_px * 2.2
        top += sheet.high * 0.06
    if item.unit:
        right = right - sheet.width_px(item.unit, type_px) - pad * 2
    draw_field(sheet, item, (left, top, right, top + tall), type_px)
    if item.unit:
        sheet.put((right + pad, top + tall / 2), item.unit, type_px, theme.INK)
