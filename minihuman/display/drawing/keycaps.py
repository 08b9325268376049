"""Keys as a person sees them: what is printed on them, and where they lie on a keyboard."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from PIL import ImageDraw

from minihuman.display.drawing import sheet
from minihuman.display.text import draw_line, measure_width_px, select_typefaces

# Rows of an ISO keyboard: left edge of the first key, then its keys; "name:width" where wider than 1, "_" a gap.
_ROWS: tuple[tuple[float, str], ...] = (
    (0.0, "escape _ f1 f2 f3 f4 _:0.5 f5 f6 f7 f8 _:0.5 f9 f10 f11 f12"),
    (0.0, "grave 1 2 3 4 5 6 7 8 9 0 minus equals backspace:2 _:0.5 insert home page_up"),
    (0.0, "tab:1.5 q w e r t y u i o p left_bracket right_bracket backslash:1.5 _:0.5 delete end page_down"),
    (0.0, "caps_lock:1.75 a s d f g h j k l semicolon quote enter:2.25"),
    (0.0, "left_shift:2.25 z x c v b n m comma period slash right_shift:2.75 _:1.5 up"),
    (0.0, "left_ctrl:1.25 _:1.25 left_alt:1.25 space:6.25 right_alt:1.25 _:2.5 right_ctrl:1.25 _:0.5 left down right"),
    (19.0, ""),
    (19.0, "num_lock kp_divide kp_multiply kp_minus"),
    (19.0, "kp_7 kp_8 kp_9 kp_plus"),
    (19.0, "kp_4 kp_5 kp_6"),
    (19.0, "kp_1 kp_2 kp_3 kp_enter"),
    (19.0, "kp_0:2 kp_period"),
)
_MAIN_ROWS = 6


@dataclass(frozen=True, slots=True)
class Keycap:
    """Where a key lies, in key widths, x to the right and y down."""

    key: str
    x: float
    y: float
    width: float


def _layout() -> dict[str, Keycap]:
    caps: dict[str, Keycap] = {}
    for number, (x, row) in enumerate(_ROWS):
        for entry in row.split():
            key, _, width = entry.partition(":")
            if key != "_":
                caps[key] = Keycap(key, x, number % _MAIN_ROWS, float(width or 1))
            x += float(width or 1)
    return caps


_CAPS: Mapping[str, Keycap] = _layout()


def arrange_keycaps(keys: Sequence[str]) -> tuple[list[Keycap], float, float]:
    """Where keys lie to each other, from (0, 0): the caps, the width and the height of them all, in key widths.

    Rows without any of the keys are left out; keys this layout has no place for come in a row of their own.
    """
    known = [_CAPS[key] for key in keys if key in _CAPS]
    left = min((cap.x for cap in known), default=0.0)
    rows = sorted({cap.y for cap in known})
    caps = [Keycap(cap.key, cap.x - left, float(rows.index(cap.y)), cap.width) for cap in known]
    strangers = [key for key in keys if key not in _CAPS]
    caps += [Keycap(key, 2.0 * place, float(len(rows)), 2.0) for place, key in enumerate(strangers)]
    width = max((cap.x + cap.width for cap in caps), default=0.0)
    return caps, width, float(len(rows) + bool(strangers))


def draw_keycap(
    draw: ImageDraw.ImageDraw,
    words: str,
    above: str,
    box: tuple[float, float, float, float],
    *,
    language: str = "en",
    pressed: bool = False,
    least_px: int = 6,
) -> None:
    """Draw a key's cap into ``box`` (left, top, right, bottom): what is printed on it, and what tells it from another.

    A pressed one lights up and carries a tick. No type is smaller than ``least_px``.
    """
    left, top, right, bottom = box
    height = bottom - top
    ink = sheet.BACKGROUND if pressed else sheet.INK
    draw.rounded_rectangle(
        box,
        radius=height * 0.16,
        fill=sheet.HIGHLIGHT if pressed else sheet.SURFACE,
        outline=sheet.HIGHLIGHT if pressed else sheet.EDGE,
        width=max(1, round(height / 28)),
    )
    bold, plain = select_typefaces(language, bold=True), select_typefaces(language)
    size_px = max(least_px, round(height * 0.48))
    while size_px > least_px and measure_width_px(words, bold, size_px) > (right - left) * 0.8:
        size_px -= 1
    middle = (left + right) / 2
    if above:
        small_px = max(least_px, min(round(height * 0.2), round((right - left) * 0.2)))
        while small_px > least_px and measure_width_px(above, plain, small_px) > (right - left) * 0.9:
            small_px -= 1
        draw_line(draw, (middle, top + height * 0.22), above, faces=plain, size_px=small_px, colour=ink, anchor="m")
    place = (middle, top + height * (0.6 if above else 0.5))
    draw_line(draw, place, words, faces=bold, size_px=size_px, colour=ink, anchor="m")
    if pressed:
        x, y, reach = right - height * 0.24, top + height * 0.2, height * 0.07
        tick = [(x - reach, y), (x - reach * 0.2, y + reach * 0.8), (x + reach * 1.2, y - reach)]
        draw.line(tick, fill=ink, width=max(1, round(height / 22)))
