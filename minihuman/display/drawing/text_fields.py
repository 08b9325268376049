"""The text field of a question: its lines, caret and selection, and the position in the text at a point."""

from dataclasses import dataclass
from itertools import pairwise

from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.sheet import LINE_HEIGHT, Sheet, Spot
from minihuman.experiment.machine.screens import TextField

FieldBox = tuple[float, float, float, float]  # left, top, right, bottom, in pixels


@dataclass(frozen=True, slots=True)
class FieldView(TextField):
    """A field that a window edits; its text from anchor to caret is selected or, if ``is_composing``, composed now."""

    anchor: int = 0
    is_composing: bool = False


@dataclass(frozen=True, slots=True)
class FieldLayout:
    """The lines of a field's text that are visible, in the field's box.

    Attributes:
        lines: where each line begins and ends in the text.
        top: the y of the first line's top, in pixels.
        left: the x at which lines begin on the left.
        right: the x at which they end on the right.
        type_px: the size of type.
    """

    lines: tuple[tuple[int, int], ...]
    top: float
    left: float
    right: float
    type_px: int

    def locate(self, sheet: Sheet, text: str, x: float, y: float) -> int:
        """Return the position in the text, in characters, that is nearest to a point (x, y) in pixels."""
        row = min(len(self.lines) - 1, max(0, int((y - self.top) // (self.type_px * LINE_HEIGHT))))
        begin, end = self.lines[row]
        if sheet.locale.rtl:
            offset = self.right - x
        else:
            offset = x - self.left
        widths = [sheet.width_px(text[begin:position], self.type_px) for position in range(begin, end + 1)]
        middles = [(before + after) / 2 for before, after in pairwise(widths)]
        return begin + sum(middle < offset for middle in middles)


def lay_out_field(sheet: Sheet, field: TextField, box: FieldBox, type_px: int) -> FieldLayout:
    """Break a field's text into lines, and return the layout of those that are visible in a box.

    These are the first lines that fit or, if the caret is below them, the lines that end with the caret's line.
    """
    left, top, right, bottom = box
    pad = type_px * 0.6
    spans = _break_lines(sheet, field.text, type_px, right - left - 2 * pad)
    n_visible = max(1, int((bottom - top - pad) / (type_px * LINE_HEIGHT)))
    caret_row = max(row for row, (begin, _) in enumerate(spans) if begin <= field.caret)
    first = max(0, min(caret_row, len(spans) - 1) - n_visible + 1)
    first_y = top + (bottom - top - n_visible * type_px * LINE_HEIGHT) / 2
    return FieldLayout(tuple(spans[first : first + n_visible]), first_y, left + pad, right - pad, type_px)


def _break_lines(sheet: Sheet, text: str, type_px: int, max_width_px: float) -> list[tuple[int, int]]:
    """Return where each line of a text begins and ends; lines break at line feeds and, if too long, after spaces."""
    spans: list[tuple[int, int]] = []
    begin = 0
    for paragraph in text.split("\n"):
        end = begin + len(paragraph)
        spans += _break_paragraph(sheet, text, (begin, end), type_px, max_width_px)
        begin = end + 1
    return spans


def _break_paragraph(
    sheet: Sheet, text: str, span: tuple[int, int], type_px: int, max_width_px: float
) -> list[tuple[int, int]]:
    """Return where each line of a paragraph begins and ends; lines end after spaces, if possible."""
    begin, end = span
    spans = []
    while sheet.width_px(text[begin:end].rstrip(" "), type_px) > max_width_px and end - begin > 1:
        n_fitting = _count_fitting(sheet, text[begin:end], type_px, max_width_px)
        blank = text.rfind(" ", begin, begin + n_fitting + 1)
        cut = begin + n_fitting
        if blank > begin:
            cut = min(blank + 1, end)
        spans.append((begin, cut))
        begin = cut
    return [*spans, (begin, end)]


def _count_fitting(sheet: Sheet, text: str, type_px: int, max_width_px: float) -> int:
    """Return how many of a text's first characters fit into a line, at least one, by bisection."""
    low = 1
    high = len(text)
    while low < high:
        middle = (low + high + 1) // 2
        if sheet.width_px(text[:middle], type_px) <= max_width_px:
            low = middle
        else:
            high = middle - 1
    return low


def draw_field(sheet: Sheet, field: TextField, box: FieldBox, type_px: int) -> None:
    """Draw a field with its text, selection and caret into a box, and add a spot "field" for it."""
    sheet.draw.rounded_rectangle(
        box, radius=type_px * 0.3, fill=theme.SURFACE, outline=theme.MUTED_INK, width=max(2, round(sheet.high / 360))
    )
    sheet.spots.append(Spot("field", *box))
    layout = lay_out_field(sheet, field, box, type_px)
    anchor = field.caret
    if isinstance(field, FieldView):
        anchor = field.anchor
    begin, end = min(anchor, field.caret), max(anchor, field.caret)
    is_composing = isinstance(field, FieldView) and field.is_composing
    for row, span in enumerate(layout.lines):
        _draw_selection(sheet, field.text, layout, row, span, (begin, end), is_underline=is_composing)
    visible_lines = [field.text[first:last].rstrip("\n") for first, last in layout.lines]
    sheet.column(visible_lines, layout.left, layout.right, layout.top, type_px)
    _draw_caret(sheet, field, layout)


def _draw_selection(
    sheet: Sheet,
    text: str,
    layout: FieldLayout,
    row: int,
    line: tuple[int, int],
    selection: tuple[int, int],
    *,
    is_underline: bool,
) -> None:
    """Draw the part of a selection that lies in a line, as an underline if an input method is composing it.

    ``line`` and ``selection`` are given by their begin and end in ``text``; ``row`` is the line's number among the
    visible lines, from 0.
    """
    line_begin, line_end = line
    selection_begin, selection_end = selection
    begin = max(line_begin, selection_begin)
    end = min(line_end, selection_end)
    if begin >= end:
        return
    text_before_px = sheet.width_px(text[line_begin:begin], layout.type_px)
    text_through_px = sheet.width_px(text[line_begin:end], layout.type_px)
    near = sheet.from_start(layout.left, layout.right, text_before_px)
    far = sheet.from_start(layout.left, layout.right, text_through_px)
    line_px = layout.type_px * LINE_HEIGHT
    top = layout.top + row * layout.type_px * LINE_HEIGHT
    bottom = top + line_px
    fill = theme.EDGE
    if is_underline:
        top = bottom - max(2, layout.type_px // 12)
        fill = theme.ACCENT
    sheet.draw.rectangle((min(near, far), top, max(near, far), bottom), fill=fill)


def _draw_caret(sheet: Sheet, field: TextField, layout: FieldLayout) -> None:
    """Draw the caret in the line that it is in."""
    rows = [row for row, (begin, _) in enumerate(layout.lines) if begin <= field.caret]
    row = max(rows, default=0)
    before = field.text[layout.lines[row][0] : field.caret]
    x = sheet.from_start(layout.left, layout.right, sheet.width_px(before, layout.type_px))
    y = layout.top + (row + 0.5) * layout.type_px * LINE_HEIGHT
    reach = layout.type_px * 0.55
    sheet.draw.line([(x, y - reach), (x, y + reach)], fill=theme.ACCENT, width=max(2, layout.type_px // 12))
