"""Drawings of questions: the text, the answer controls, and the spots that a pointer can press."""

from PIL import ImageColor

from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.sheet import LINE_HEIGHT, MIN_TYPE_SIZE, TIGHT_LINE_HEIGHT, Sheet, Size, Spot
from minihuman.display.drawing.text_fields import draw_field
from minihuman.display.text import style_lines
from minihuman.experiment.machine.screens import (
    AnswerWidget,
    CanvasShape,
    OptionList,
    QuestionScreen,
    RatingMatrix,
    RatingScale,
    ShapeCanvas,
    Slider,
    TextField,
)

Box = tuple[float, float, float, float]  # left, top, right, bottom, in pixels

# Shares of the height
_TYPE = 1 / 30
_SMALL_TYPE = 1 / 36
_NOTE_TYPE = 1 / 34
_WIDE = 1.16
_TOP = 0.15
_BOTTOM = 0.82
_NOTE_Y = 0.805
_GAP_BEFORE_ANSWERS = 0.02
_GAP_AFTER_ANSWERS = 0.04
_LEAST_QUESTION_ROOM = 0.10  # for a question's text
_USUAL_QUESTION_ROOM = 0.30
_OPTION_QUESTION_ROOM = 0.58  # with a list of options, less the room per option
_ROOM_PER_OPTION = 0.075

_MOST_ROOMY_OPTIONS = 6  # with more options, the question has as little room as possible
_MOST_STATEMENT_LINES = 2
_MOST_NUMBERED_OPTIONS = 9  # the digit keys choose these

# Shares of the type size
_OPTION_PADDING = 0.3  # above and below an option's lines
_OPTION_GAP = 0.15
_OPTION_INDENT = 4  # beside an option's lines: its tick box and its digit

_POINT_RADIUS = 0.36  # of the space that a point of a scale has


def draw_question(screen: QuestionScreen, size_px: Size) -> Sheet:
    """Draw a question with its answer controls, and return the sheet."""
    sheet = Sheet(size_px, screen.locale)
    width, _ = size_px
    high = sheet.high
    column_px = _WIDE * high
    left = (width - column_px) / 2
    right = (width + column_px) / 2
    sheet.header(screen.title, column_px)
    question_px = _measure_question_room(screen) * high
    lines, type_px = sheet.fitted(screen.question, round(high * _TYPE), column_px, question_px)
    question_top = sheet.top + high * _TOP
    answers_top = question_top + question_px + high * _GAP_BEFORE_ANSWERS
    answers_bottom = sheet.top + high * (_BOTTOM - _GAP_AFTER_ANSWERS)
    empty_px = max(0.0, question_px - len(lines) * type_px * LINE_HEIGHT)  # above the text, so that answers are near it
    sheet.column(style_lines(lines), left, right, question_top + empty_px, type_px)
    _draw_widget(sheet, screen.item, (left, answers_top, right, answers_bottom))
    if screen.note:
        note_place = (width / 2, sheet.top + high * _NOTE_Y)
        sheet.put_line(note_place, screen.note, round(high * _NOTE_TYPE), column_px, theme.ACCENT)
    sheet.footer(screen.buttons, screen.prompt, screen.progress, column_px)
    return sheet


def _draw_widget(sheet: Sheet, widget: AnswerWidget, box: Box) -> None:
    """Draw a question's answer controls into a box, and add a spot for each."""
    match widget:
        case OptionList():
            _draw_options(sheet, widget, box)
        case RatingScale():
            _draw_scale(sheet, widget, box)
        case RatingMatrix():
            _draw_matrix(sheet, widget, box)
        case Slider():
            _draw_slider(sheet, widget, box)
        case TextField():
            _draw_text_field(sheet, widget, box)
        case ShapeCanvas():
            _draw_shapes(sheet, widget, box)


def question_fits(screen: QuestionScreen, size_px: Size) -> bool:
    """Return whether a question's text, options and statements fit the screen in the smallest readable type."""
    sheet = Sheet(size_px, screen.locale)
    question_px = _measure_question_room(screen) * sheet.high
    column_px = _WIDE * sheet.high
    lines, type_px = sheet.fitted(screen.question, round(sheet.high * _TYPE), column_px, question_px)
    if type_px < round(sheet.high * MIN_TYPE_SIZE) or len(lines) * type_px * LINE_HEIGHT > question_px:
        return False
    if isinstance(screen.item, RatingMatrix):
        answers_px = (_BOTTOM - _TOP - _GAP_BEFORE_ANSWERS - _GAP_AFTER_ANSWERS) * sheet.high - question_px
        return _matrix_fits(sheet, screen.item, column_px, answers_px)
    if isinstance(screen.item, OptionList):
        answers_px = (_BOTTOM - _TOP - (_GAP_BEFORE_ANSWERS + _GAP_AFTER_ANSWERS)) * sheet.high - question_px
        return _fit_options(sheet, screen.item, column_px, answers_px) is not None
    return True


def _measure_question_room(screen: QuestionScreen) -> float:
    """Return the share of the height for the question's text, which is larger if the answers need less room."""
    is_tall_canvas = isinstance(screen.item, ShapeCanvas) and screen.item.is_tall
    if is_tall_canvas or isinstance(screen.item, RatingMatrix):
        return _LEAST_QUESTION_ROOM
    if not isinstance(screen.item, OptionList):
        return _USUAL_QUESTION_ROOM
    n_options = len(screen.item.options)
    if n_options > _MOST_ROOMY_OPTIONS:
        return _LEAST_QUESTION_ROOM
    return max(_LEAST_QUESTION_ROOM, _OPTION_QUESTION_ROOM - _ROOM_PER_OPTION * n_options)


def _fit_options(
    sheet: Sheet, option_list: OptionList, width_px: float, max_height_px: float
) -> tuple[list[list[str]], int] | None:
    """Return each option's lines and the largest readable type size (px) in which all fit; None if they do not fit."""
    type_px = round(sheet.high * _TYPE)
    while type_px >= sheet.min_type_px:
        text_px = width_px - type_px * _OPTION_INDENT
        options_lines = [sheet.wrap(option, type_px, text_px) for option in option_list.options]
        frame_px = type_px * (2 * _OPTION_PADDING + _OPTION_GAP)
        heights = [len(lines) * type_px * TIGHT_LINE_HEIGHT + frame_px for lines in options_lines]
        if sum(heights) <= max_height_px:
            return options_lines, type_px
        type_px -= 1
    return None


def _draw_options(sheet: Sheet, option_list: OptionList, box: Box) -> None:
    """Draw options below each other, each with its number and a circle or, if several can be chosen, a tick box."""
    left, top, right, bottom = box
    fitted = _fit_options(sheet, option_list, right - left, bottom - top)
    if fitted is None:
        options_lines = [[option] for option in option_list.options]
        type_px = sheet.min_type_px
    else:
        options_lines, type_px = fitted
    y = top
    for number, lines in enumerate(options_lines):
        height = len(lines) * type_px * TIGHT_LINE_HEIGHT + type_px * 2 * _OPTION_PADDING
        option_box = (left, y, right, y + height)
        is_chosen = number in option_list.chosen
        outline, stroke = _option_outline(sheet, is_chosen=is_chosen, has_cursor=number == option_list.cursor)
        sheet.draw.rounded_rectangle(
            option_box, radius=type_px * 0.35, fill=theme.SURFACE, outline=outline, width=stroke
        )
        sheet.spots.append(Spot(f"option:{number}", *option_box))
        tick_x = sheet.from_start(left, right, type_px * 1.3)
        _draw_tick_box(sheet, (tick_x, y + height / 2), type_px, is_chosen=is_chosen, is_box=option_list.many)
        _draw_option_text(sheet, lines, number, option_box, type_px)
        y += height + type_px * _OPTION_GAP


def _draw_option_text(sheet: Sheet, lines: list[str], number: int, box: Box, type_px: int) -> None:
    """Draw an option's lines and, at their end, the digit of the key that chooses it."""
    left, top, right, bottom = box
    line_x = sheet.from_start(left, right, type_px * 2.6)
    line_y = top + type_px * _OPTION_PADDING + type_px * TIGHT_LINE_HEIGHT / 2
    for line in lines:
        sheet.put((line_x, line_y), line, type_px, theme.INK, sheet.start_anchor)
        line_y += type_px * TIGHT_LINE_HEIGHT
    if number < _MOST_NUMBERED_OPTIONS:
        number_x = sheet.from_end(left, right, type_px * 0.9)
        digit_px = max(sheet.min_type_px, round(type_px * 0.75))
        sheet.put((number_x, (top + bottom) / 2), str(number + 1), digit_px, theme.MUTED_INK, "m")


def _option_outline(sheet: Sheet, *, is_chosen: bool, has_cursor: bool) -> tuple[theme.Colour, int]:
    """Return the colour and the width of the line around an option."""
    if is_chosen:
        return theme.HIGHLIGHT, max(1, round(sheet.high / 240))
    stroke = max(1, round(sheet.high / 450))
    if has_cursor:
        return theme.MUTED_INK, stroke
    return theme.EDGE, stroke


def _draw_tick_box(sheet: Sheet, place: tuple[float, float], type_px: int, *, is_chosen: bool, is_box: bool) -> None:
    """Draw an option's tick box, or its circle if only one option can be chosen, around a point (x, y)."""
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
    """Return the colour of the text on a point or a shape, which depends on whether that is chosen."""
    if is_chosen:
        return theme.BACKGROUND
    return theme.INK


def _draw_point(sheet: Sheet, place: tuple[float, float], reach: float, *, is_chosen: bool) -> None:
    """Draw the circle of a point of a scale around a place (x, y), with the radius ``reach``, in pixels."""
    x, y = place
    sheet.draw.ellipse(
        (x - reach, y - reach, x + reach, y + reach),
        fill=_choice_fill(is_chosen),
        outline=_choice_outline(is_chosen),
        width=max(2, round(sheet.high / 360)),
    )


def _has_words(scale: RatingScale | RatingMatrix) -> bool:
    """Return whether every point of a scale has a text instead of a number."""
    return all(not point.isdecimal() for point in scale.points)


def _draw_scale(sheet: Sheet, scale: RatingScale, box: Box) -> None:
    """Draw the points of a scale side by side in reading order, with texts at the two ends or below each point."""
    left, top, right, _ = box
    count = len(scale.points)
    unit = (right - left) / count
    reach = min(unit * _POINT_RADIUS, sheet.high * 0.04)
    y = top + sheet.high * 0.10
    words_top = y + reach * 1.4
    has_words = _has_words(scale)
    type_px = sheet.min_type_px
    for number, point in enumerate(scale.points):
        x = left + unit * (sheet.place_from_left(number, count) + 0.5)
        is_chosen = number == scale.chosen
        _draw_point(sheet, (x, y), reach, is_chosen=is_chosen)
        label = point
        bottom = words_top
        if has_words:
            label = str(number + 1)
            bottom = _draw_point_words(sheet, point, (x, words_top), unit)
        sheet.put((x, y), label, max(type_px, round(reach * 0.95)), _choice_ink(is_chosen), "m")
        sheet.spots.append(Spot(f"option:{number}", x - unit / 2, y - reach * 1.6, x + unit / 2, bottom + type_px))
    if not has_words:
        _draw_end_texts(sheet, scale.low, scale.high, (left, right), words_top + type_px)


def _draw_point_words(sheet: Sheet, words: str, place: tuple[float, float], unit: float) -> float:
    """Draw a point's text centred below ``place`` in a column of ``unit`` pixels; return the y below the text."""
    x, top = place
    type_px = sheet.min_type_px
    lines = sheet.wrap(words, type_px, unit * 0.94)
    for row, line in enumerate(lines):
        line_y = top + type_px * (row * TIGHT_LINE_HEIGHT + 0.8)
        sheet.put((x, line_y), line, type_px, theme.INK, "m")
    return top + type_px * TIGHT_LINE_HEIGHT * len(lines)


_STATEMENT_SHARE = 0.42  # of the width; the points have the rest
_STATEMENT_MARGIN = 0.03  # at both sides of a statement together, of the height
_INK_HEIGHT = 0.97  # of the type size: from the top of a line's capitals to the bottom of its descenders


def _wrap_statements(sheet: Sheet, matrix: RatingMatrix, width_px: float) -> list[list[str]]:
    """Return the lines of each statement of a matrix that is ``width_px`` wide."""
    statement_px = width_px * _STATEMENT_SHARE - sheet.high * _STATEMENT_MARGIN
    return [sheet.wrap(statement, sheet.min_type_px, statement_px) for statement in matrix.rows]


def _matrix_fits(sheet: Sheet, matrix: RatingMatrix, width_px: float, height_px: float) -> bool:
    """Return whether each statement of a matrix fits into its row, in at most two lines."""
    most_lines = max(map(len, _wrap_statements(sheet, matrix, width_px)))
    unit = width_px * (1 - _STATEMENT_SHARE) / len(matrix.points)
    row_px = (height_px - _measure_matrix_heads(sheet, matrix, unit)) / len(matrix.rows)
    text_px = sheet.min_type_px * ((most_lines - 1) * TIGHT_LINE_HEIGHT + _INK_HEIGHT)
    return most_lines <= _MOST_STATEMENT_LINES and text_px <= row_px


def _wrap_matrix_heads(sheet: Sheet, matrix: RatingMatrix, unit: float) -> list[list[str]]:
    """Return the lines of each point's text in a column of ``unit`` pixels; [] if the points are numbers."""
    if not _has_words(matrix):
        return []
    return [sheet.wrap(point, sheet.min_type_px, unit * 0.96) for point in matrix.points]


def _measure_matrix_heads(sheet: Sheet, matrix: RatingMatrix, unit: float) -> float:
    """Return the height in pixels of the head above the statements, with the points' texts or those of the two ends."""
    type_px = sheet.min_type_px
    heads = _wrap_matrix_heads(sheet, matrix, unit)
    if not heads:
        return type_px * 2.4
    most_lines = max(2, *map(len, heads))
    return type_px * TIGHT_LINE_HEIGHT * most_lines + type_px * 0.6


def _draw_matrix(sheet: Sheet, matrix: RatingMatrix, box: Box) -> None:
    """Draw a row for each statement with its points in reading order, below a head with the meaning of the points."""
    left, top, right, bottom = box
    type_px = sheet.min_type_px
    width = right - left
    if sheet.locale.rtl:
        columns = (left, right - width * _STATEMENT_SHARE)
    else:
        columns = (left + width * _STATEMENT_SHARE, right)
    top += _draw_matrix_heads(sheet, matrix, columns, top)
    row_px = min((bottom - top) / len(matrix.rows), sheet.high * 0.09)
    for row, lines in enumerate(_wrap_statements(sheet, matrix, width)):
        y = top + row_px * (row + 0.5)
        if row == matrix.cursor:
            stripe = (left, y - row_px * 0.46, right, y + row_px * 0.46)
            sheet.draw.rounded_rectangle(stripe, radius=type_px * 0.4, outline=theme.EDGE)
        x = sheet.from_start(left, right, sheet.high * 0.015)
        middle_line = (len(lines) - 1) / 2
        for number, line in enumerate(lines):
            offset = (number - middle_line) * type_px * TIGHT_LINE_HEIGHT
            sheet.put((x, y + offset), line, type_px, theme.INK, sheet.start_anchor)
        _draw_matrix_points(sheet, matrix, row, columns, y, row_px)


def _draw_matrix_heads(sheet: Sheet, matrix: RatingMatrix, columns: tuple[float, float], top: float) -> float:
    """Write the meaning of the points from ``top`` down, between the two x of ``columns``; return its height in px."""
    type_px = sheet.min_type_px
    left, right = columns
    unit = (right - left) / len(matrix.points)
    heads = _wrap_matrix_heads(sheet, matrix, unit)
    if not heads:
        _draw_end_texts(sheet, matrix.low, matrix.high, columns, top)
    for point, lines in enumerate(heads):
        x = left + unit * (sheet.place_from_left(point, len(heads)) + 0.5)
        for number, line in enumerate(lines):
            line_y = top + type_px * (number * TIGHT_LINE_HEIGHT + TIGHT_LINE_HEIGHT / 2)
            sheet.put((x, line_y), line, type_px, theme.INK, "m")
    return _measure_matrix_heads(sheet, matrix, unit)


def _draw_matrix_points(
    sheet: Sheet, matrix: RatingMatrix, row: int, columns: tuple[float, float], y: float, row_px: float
) -> None:
    """Draw the points of a statement around the height ``y``, between the two x of ``columns``, and add their spots."""
    left, right = columns
    count = len(matrix.points)
    unit = (right - left) / count
    reach = min(unit * _POINT_RADIUS, row_px * _POINT_RADIUS)
    has_words = _has_words(matrix)
    for point, label in enumerate(matrix.points):
        column = sheet.place_from_left(point, count)
        x = left + unit * (column + 0.5)
        is_chosen = matrix.chosen[row] == point
        _draw_point(sheet, (x, y), reach, is_chosen=is_chosen)
        if not has_words:
            sheet.put((x, y), label, sheet.min_type_px, _choice_ink(is_chosen), "m")
        option = row * count + point  # the points of all statements are numbered row by row
        cell = (left + unit * column, y - row_px / 2, left + unit * (column + 1), y + row_px / 2)
        sheet.spots.append(Spot(f"option:{option}", *cell))


def _draw_end_texts(sheet: Sheet, low: str, high: str, sides: tuple[float, float], y: float) -> None:
    """Write the texts at the two ends of a scale from ``y`` down, each within its half between the x of ``sides``."""
    left, right = sides
    type_px = round(sheet.high * _SMALL_TYPE)
    ends = [low, high]
    if sheet.locale.rtl:
        ends.reverse()
    for words, x, anchor in zip(ends, sides, "lr", strict=True):
        for row, line in enumerate(sheet.wrap(words, type_px, (right - left) * 0.46)):
            sheet.put((x, y + type_px * (row * LINE_HEIGHT + 0.5)), line, type_px, theme.INK, anchor)


def _draw_slider(sheet: Sheet, slider: Slider, box: Box) -> None:
    """Draw a line with ticks, and a mark on it once the slider has been set."""
    left, top, right, _ = box
    width = right - left
    y = top + sheet.high * 0.12
    stroke = max(2, round(sheet.high / 300))
    long_tick = sheet.high * 0.022
    short_tick = sheet.high * 0.012
    sheet.draw.line([(left, y), (right, y)], fill=theme.MUTED_INK, width=stroke)
    for tick in range(slider.ticks + 1):
        x = left + width * tick / slider.ticks
        is_end = tick in (0, slider.ticks)
        is_middle = tick * 2 == slider.ticks
        tick_reach = long_tick if is_end or is_middle else short_tick
        sheet.draw.line([(x, y - tick_reach), (x, y + tick_reach)], fill=theme.MUTED_INK, width=stroke)
    if slider.position is not None:
        mark_x = sheet.from_start(left, right, width * slider.position)
        _draw_slider_mark(sheet, slider, mark_x, y, stroke)
    reach = sheet.high * 0.06
    sheet.spots.append(Spot("slider", left, y - reach, right, y + reach, sheet.locale.rtl))
    _draw_end_texts(sheet, slider.low, slider.high, (left, right), y + sheet.high * 0.05)


def _draw_slider_mark(sheet: Sheet, slider: Slider, x: float, y: float, stroke: int) -> None:
    """Draw the mark of a slider around (x, y), with lines ``stroke`` pixels wide, and the slider's value above it."""
    reach = sheet.high * 0.022
    circle = (x - reach, y - reach, x + reach, y + reach)
    sheet.draw.ellipse(circle, fill=theme.HIGHLIGHT, outline=theme.INK, width=stroke)
    if slider.value:
        sheet.put((x, y - reach * 2.4), slider.value, round(sheet.high / 30), theme.INK, "m")


def _draw_shapes(sheet: Sheet, canvas: ShapeCanvas, box: Box) -> None:
    """Draw boxes and ellipses with their labels on the largest canvas that fits a box; add a spot for each target."""
    left, top, right, bottom = box
    canvas_width = min(right - left, (bottom - top) * canvas.aspect)
    canvas_height = canvas_width / canvas.aspect
    canvas_left = (left + right - canvas_width) / 2
    stroke = max(2, round(sheet.high / 360))
    for shape in canvas.shapes:
        x = canvas_left + shape.x * canvas_width
        y = top + shape.y * canvas_height
        x_end = x + shape.width * canvas_width
        y_end = y + shape.height * canvas_height
        if shape.has_box:
            _draw_shape(sheet, shape, (x, y, x_end, y_end), stroke)
        if shape.label:
            middle = ((x + x_end) / 2, (y + y_end) / 2)
            ink = _choose_label_ink(shape)
            sheet.put_line(middle, shape.label, round(sheet.high * _SMALL_TYPE), shape.width * canvas_width, ink)
        if shape.target:
            sheet.spots.append(Spot(shape.target, x, y, x_end, y_end))


def _draw_shape(sheet: Sheet, shape: CanvasShape, box: Box, stroke: int) -> None:
    """Draw a box or an ellipse; if a shape that has its own colour is chosen, a frame shows this."""
    draw = sheet.draw.ellipse if shape.is_round else sheet.draw.rectangle
    if shape.fill and shape.chosen:
        left, top, right, bottom = box
        reach = stroke * 4
        frame = (left - reach, top - reach, right + reach, bottom + reach)
        draw(frame, outline=theme.HIGHLIGHT, width=stroke * 2)
    draw(box, fill=shape.fill or _choice_fill(shape.chosen), outline=theme.EDGE, width=stroke)


def _choose_label_ink(shape: CanvasShape) -> theme.Colour:
    """Return the colour of a shape's label, which contrasts with the shape, or with the screen if there is no box."""
    if not shape.has_box:
        return theme.INK
    if shape.fill:
        return _choose_ink(shape.fill)
    return _choice_ink(shape.chosen)


def _choose_ink(fill: str) -> theme.Colour:
    """Return black or white, whichever has the higher contrast on a colour."""
    equal_contrast_luminance = 0.179  # of WCAG 2.2, where (1 + 0.05) / (L + 0.05) equals (L + 0.05) / 0.05
    if _compute_luminance(ImageColor.getrgb(fill)) > equal_contrast_luminance:
        return (0, 0, 0)
    return (255, 255, 255)


def _compute_luminance(colour: tuple[int, ...]) -> float:
    """Return the relative luminance of an sRGB colour, from 0 to 1, by the formula of WCAG 2.2."""
    red_green_blue_weights = (0.2126, 0.7152, 0.0722)
    luminance = 0.0
    for channel, weight in zip(colour, red_green_blue_weights, strict=False):
        share = channel / 255
        if share <= 0.04045:
            luminance += weight * share / 12.92
        else:
            luminance += weight * ((share + 0.055) / 1.055) ** 2.4
    return luminance


def field_type_px(sheet: Sheet) -> int:
    """Return the size in pixels of the type in a text field."""
    return round(sheet.high * _TYPE)


def _draw_text_field(sheet: Sheet, field: TextField, box: Box) -> None:
    """Draw a text field with its text, caret and unit."""
    left, top, right, bottom = box
    type_px = field_type_px(sheet)
    pad = type_px * 0.6
    if field.long:
        height = bottom - top
    else:
        height = type_px * 2.2
        top += sheet.high * 0.06
    if field.unit:
        right = right - sheet.width_px(field.unit, type_px) - pad * 2
    draw_field(sheet, field, (left, top, right, top + height), type_px)
    if field.unit:
        sheet.put((right + pad, top + height / 2), field.unit, type_px, theme.INK)
