"""A text screen: a title, a few words, what to press; or the keys that are to be checked."""

from minihuman.study.keycaps import caption_word, label
from minihuman.study.screens import TextScreen
from minihuman.windows import theme
from minihuman.windows.keycaps import arrange, draw_cap
from minihuman.windows.sheet import LINE, MARGIN, SMALLEST, Sheet, Size

BODY = 1 / 26  # type size of running text: 3.5 mm tall capitals on a 24-inch display
_MEASURE = 1.25  # longest line of running text


def draw_text(screen: TextScreen, size_px: Size) -> Sheet:
    """Draw it."""
    width, height = size_px
    sheet = Sheet(size_px, screen.script)
    wide = min(width - 4 * height * MARGIN, height * _MEASURE)
    top, bottom = text_box(screen, height)
    sheet.one_line((width / 2, height * 0.115), screen.title, round(height / 15), wide, theme.INK)
    if screen.keys:
        _keyboard(sheet, screen, (width / 2 - wide / 2, height * 0.42, width / 2 + wide / 2, height * 0.80))
    _paragraphs(sheet, screen.body, (width / 2 - wide / 2, top, width / 2 + wide / 2, bottom))
    sheet.one_line((width / 2, height * 0.87), screen.prompt, round(height * BODY), wide, theme.ACCENT)
    sheet.one_line((width / 2, height * 0.965), screen.progress, round(height / 36), wide, theme.QUIET)
    return sheet


def text_box(screen: TextScreen, height: int) -> tuple[float, float]:
    """Where running text begins and ends."""
    return height * (0.20 if screen.title else 0.08), height * (0.40 if screen.keys else 0.80)


def fits(screen: TextScreen, size_px: Size) -> bool:
    """Whether its words fit in the smallest type there may be."""
    sheet = Sheet(size_px, screen.script)
    top, bottom = text_box(screen, size_px[1])
    wide = min(size_px[0] - 4 * size_px[1] * MARGIN, size_px[1] * _MEASURE)
    lines, type_px = sheet.fitted(screen.body, round(size_px[1] * BODY), wide, bottom - top)
    return type_px >= round(sheet.high * SMALLEST) and len(lines) * type_px * LINE <= bottom - top


def _paragraphs(sheet: Sheet, body: str, box: tuple[float, float, float, float]) -> None:
    """Set running text in the largest type that fits the box, in its middle; three lines or fewer are centred."""
    left, top, right, bottom = box
    lines, type_px = sheet.fitted(body, round(sheet.size_px[1] * BODY), right - left, bottom - top)
    lines = sheet.wrap(body, type_px, _narrowest(sheet, body, type_px, right - left, len(lines)))
    longest = max((sheet.width_px(line, type_px) for line in lines), default=0.0)
    y = top + max(0.0, (bottom - top - len(lines) * type_px * LINE) / 2)
    if len(lines) > 3:
        sheet.column(lines, (left + right - longest) / 2, (left + right + longest) / 2, y, type_px)
        return
    for line in lines:
        sheet.put(((left + right) / 2, y + type_px * LINE / 2), line, type_px, theme.INK, "m")
        y += type_px * LINE


def _narrowest(sheet: Sheet, body: str, type_px: int, wide: float, lines: int) -> float:
    """The narrowest column, to a letter or so, that needs no more lines: no last word left alone."""
    if lines > 3:
        return wide
    while len(sheet.wrap(body, type_px, wide - type_px)) <= lines and wide > 12 * type_px:
        wide -= type_px
    return wide


def _keyboard(sheet: Sheet, screen: TextScreen, box: tuple[float, float, float, float]) -> None:
    """The keys to be checked, where they lie to each other; pressed ones lit."""
    left, top, right, bottom = box
    pressed = dict(screen.keys)
    printed = {key: (cap, above) for key, cap, above in screen.labels}
    caps, wide, high = arrange(tuple(pressed))
    unit = min((right - left) / wide, (bottom - top) / high, (bottom - top) / 2.5)
    x0, y0 = (left + right - wide * unit) / 2, (top + bottom - high * unit) / 2
    gap = unit * 0.05
    for cap in caps:
        x, y = x0 + cap.x * unit, y0 + cap.y * unit
        place = (x + gap, y + gap, x + cap.width * unit - gap, y + unit - gap)
        words, above = printed.get(cap.key, (label(cap.key), caption_word(cap.key)))
        draw_cap(
            *(sheet.draw, words, above, place),
            language=screen.script.language,
            pressed=pressed[cap.key],
            least_px=sheet.smallest_px,
        )
