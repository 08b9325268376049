"""The sheet on which a screen is drawn: colours, type sizes and clickable spots.

Lengths are fractions of the height. Text that must be read is at least 1/40 of the height.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from PIL import Image, ImageDraw

from minihuman.display.shaping import measure_width_px
from minihuman.display.text import EMPHASIS_MARK, draw_line, wrap_text
from minihuman.display.typefaces import TypefaceSet, select_typefaces
from minihuman.experiment.machine.screens import Button, TextLocale

Colour = tuple[int, int, int]

# Contrast against BACKGROUND (WCAG): INK 14.4, MUTED_INK 6.6, ACCENT 8.5. HIGHLIGHT and ACCENT stay apart in every kind
# of colour vision (Okabe and Ito 2008: sky blue and orange).
BACKGROUND: Colour = (22, 25, 30)
SURFACE: Colour = (38, 43, 51)
EDGE: Colour = (84, 93, 105)
INK: Colour = (232, 230, 225)
MUTED_INK: Colour = (154, 164, 176)
ACCENT: Colour = (240, 176, 72)
HIGHLIGHT: Colour = (86, 180, 233)
GOOD: Colour = (0, 190, 140)
BAD: Colour = (232, 110, 60)
# Each colour in the light theme. Text has a contrast of 4.5 or more, also where ink and ground are exchanged.
LIGHT: Mapping[Colour, Colour] = {
    BACKGROUND: (247, 246, 243),
    SURFACE: (255, 255, 255),
    EDGE: (110, 118, 128),
    INK: (24, 27, 32),
    MUTED_INK: (84, 93, 105),
    ACCENT: (140, 80, 0),
    HIGHLIGHT: (0, 98, 155),
    GOOD: (0, 112, 80),
    BAD: (176, 56, 16),
}

Size = tuple[int, int]  # width, height
MARGIN = 0.03
LINE_HEIGHT = 1.45  # line height, of the type size
TIGHT_LINE_HEIGHT = 1.2  # where there is little room
MIN_TYPE_SIZE = 1 / 40
OVERFLOW_TYPE_SIZE = 1 / 60  # for a text that is too long even so: set smaller, not cut off; `check` reports it
MIN_TYPE_PX = 8  # smaller glyphs cannot be told apart, whatever the window's size
_TITLE_TYPE_SIZE = 1 / 18
_FOOTER_TYPE_SIZE = 1 / 36
# Middles of a page's lines, from the page's top
_TITLE_Y = 0.085
_BUTTONS_Y = 0.872
_PROMPT_Y = 0.925
_PROGRESS_Y = 0.97


def find_colour(colour: Colour, theme: str) -> Colour:
    """Return the colour of a theme that corresponds to a colour of the dark theme.

    If ``theme`` is not "light", or the light theme has no such colour, the colour itself is returned.
    """
    if theme == "light":
        return LIGHT.get(colour, colour)
    return colour


class LightDraw(ImageDraw.ImageDraw):
    """A drawing context that replaces the dark theme's colours by the light theme's."""


def _draw_light(draw: Callable[..., None]) -> Callable[..., None]:
    """Return a drawing method that replaces its fill and outline by the light theme's colours."""

    def draw_in_light(self: LightDraw, *args: Any, **options: Any) -> None:
        for name in ("fill", "outline"):
            if name in options:
                options[name] = find_colour(options[name], "light")
        draw(self, *args, **options)

    return draw_in_light


for _name in ("bitmap", "ellipse", "line", "rectangle", "rounded_rectangle"):
    setattr(LightDraw, _name, _draw_light(getattr(ImageDraw.ImageDraw, _name)))


@dataclass(frozen=True, slots=True)
class Spot:
    """A box in pixels that a pointer can press; if ``rtl``, positions along it count from the right."""

    name: str
    left: float
    top: float
    right: float
    bottom: float
    rtl: bool = False

    def holds(self, x: float, y: float) -> bool:
        """Return whether a point lies in the spot."""
        return self.left <= x < self.right and self.top <= y < self.bottom

    def along(self, x: float) -> float:
        """Return how far along the spot an x in pixels lies, from 0 at its start to 1 at its end in reading order."""
        share = min(1.0, max(0.0, (x - self.left) / max(1.0, self.right - self.left)))
        if self.rtl:
            return 1.0 - share
        return share


class Sheet:
    """A page of a given size, on which text, buttons and shapes are drawn in a language's reading direction."""

    def __init__(self, size_px: Size, locale: TextLocale) -> None:
        self.size_px = size_px
        self.locale = locale
        self.faces, self.bold = (
            select_typefaces(locale.language, bold=bold, fonts=locale.fonts) for bold in (False, True)
        )
        self.page = Image.new("RGB", size_px, find_colour(BACKGROUND, locale.theme))
        if locale.theme == "light":
            self.draw: ImageDraw.ImageDraw = LightDraw(self.page)
        else:
            self.draw = ImageDraw.ImageDraw(self.page)
        self.spots: list[Spot] = []

    @property
    def high(self) -> float:
        """The height to which lengths are relative; in a window narrower than 4:3, less than the window's height."""
        width, height = self.size_px
        return min(float(height), width * 3 / 4)

    @property
    def min_type_px(self) -> int:
        """The smallest type size in pixels for text that must be read."""
        return max(MIN_TYPE_PX, round(self.high * MIN_TYPE_SIZE))

    @property
    def top(self) -> float:
        """The y of the page's upper edge, in pixels; the page is centred in a window taller than itself."""
        return (self.size_px[1] - self.high) / 2

    # Reading order

    @property
    def start_anchor(self) -> str:
        """The anchor of a line at the side on which the language's lines begin: "l" or "r"."""
        if self.locale.rtl:
            return "r"
        return "l"

    def from_start(self, left: float, right: float, offset: float) -> float:
        """Return the x at an offset from the side, ``left`` or ``right``, on which the language's lines begin."""
        if self.locale.rtl:
            return right - offset
        return left + offset

    def from_end(self, left: float, right: float, offset: float) -> float:
        """Return the x at an offset from the side, ``left`` or ``right``, on which the language's lines end."""
        if self.locale.rtl:
            return left + offset
        return right - offset

    def place_from_left(self, index: int, count: int) -> int:
        """Return the index from the left of the element with ``index`` in reading order, of ``count`` elements."""
        if self.locale.rtl:
            return count - 1 - index
        return index

    # Words

    def width_px(self, words: str, type_px: int) -> float:
        """Return the length of a line of text in pixels."""
        if EMPHASIS_MARK not in words:
            return measure_width_px(words, self.faces, type_px)
        return sum(measure_width_px(piece, faces, type_px) for piece, faces, _ in self._split_emphasis(words))

    def _split_emphasis(self, words: str) -> list[tuple[str, TypefaceSet, bool]]:
        """Return the pieces of a line, each with its typefaces and whether it is emphasised."""
        pieces = []
        for number, piece in enumerate(words.split(EMPHASIS_MARK)):
            is_emphasised = number % 2 == 1  # each mark begins or ends emphasis, in turn
            pieces.append((piece, self.bold if is_emphasised else self.faces, is_emphasised))
        return pieces

    def put(self, place: tuple[float, float], words: str, type_px: int, colour: Colour, anchor: str = "l") -> None:
        """Draw a line of text, with emphasis where it has marks.

        ``place`` is a point (x, y) in pixels at the middle of the line's height, and ``anchor`` says which point of the
        line is there: its left end ("l"), its middle ("m") or its right end ("r").
        """
        rtl = self.locale.rtl
        if EMPHASIS_MARK not in words:
            draw_line(self.draw, place, words, faces=self.faces, size_px=type_px, colour=colour, anchor=anchor, rtl=rtl)
            return
        pieces = self._split_emphasis(words)
        x = place[0] - {"l": 0.0, "m": 0.5, "r": 1.0}[anchor] * self.width_px(words, type_px)
        if rtl:
            pieces.reverse()
        for piece, faces, is_strong in pieces:
            ink = colour
            if is_strong:
                ink = ACCENT
            draw_line(self.draw, (x, place[1]), piece, faces=faces, size_px=type_px, colour=ink, rtl=rtl)
            x += measure_width_px(piece, faces, type_px)

    def put_line(
        self, place: tuple[float, float], words: str, type_px: int, max_width_px: float, colour: Colour
    ) -> None:
        """Draw a line of text centred on a point (x, y), in smaller type if it is longer than ``max_width_px`` pixels.

        A line that is too long even in the smallest readable type is broken into several lines, centred on the point.
        """
        while type_px > self.min_type_px and self.width_px(words, type_px) > max_width_px:
            type_px -= 1
        if self.width_px(words, type_px) <= max_width_px:
            lines = [words]
        else:
            lines = self.wrap(words, type_px, max_width_px)
        x, y = place
        middle_row = (len(lines) - 1) / 2
        for row, line in enumerate(lines):
            line_y = y + (row - middle_row) * type_px * TIGHT_LINE_HEIGHT
            self.put((x, line_y), line, type_px, colour, "m")

    def column(
        self, lines: list[str], left: float, right: float, top: float, type_px: int, colour: Colour = INK
    ) -> float:
        """Draw lines below each other, aligned at their start; return the y below the last line."""
        for line in lines:
            y = top + type_px * LINE_HEIGHT / 2
            if self.locale.rtl:
                self.put((right, y), line, type_px, colour, "r")
            else:
                self.put((left, y), line, type_px, colour)
            top += type_px * LINE_HEIGHT
        return top

    def wrap(self, words: str, type_px: int, max_width_px: float) -> list[str]:
        """Break a text into lines that are at most ``max_width_px`` pixels long."""
        return wrap_text(words, faces=self.faces, size_px=type_px, max_width_px=max_width_px)

    def fitted(self, words: str, type_px: int, max_width_px: float, max_height_px: float) -> tuple[list[str], int]:
        """Return a text's lines in the largest type that fits, and the size of that type, at most ``type_px``.

        The lines fit if none is longer than ``max_width_px`` and all together are at most ``max_height_px`` high. If
        they fit at no size, the smallest size is used.
        """
        smallest = max(MIN_TYPE_PX, round(self.high * OVERFLOW_TYPE_SIZE))
        for size in range(type_px, smallest - 1, -1):
            lines = self.wrap(words, size, max_width_px)
            if len(lines) * size * LINE_HEIGHT <= max_height_px:
                return lines, size
        return self.wrap(words, smallest, max_width_px), smallest

    def header(self, title: str, max_width_px: float) -> None:
        """Draw the title of a page, at most ``max_width_px`` pixels long."""
        place = (self.size_px[0] / 2, self.top + self.high * _TITLE_Y)
        self.put_line(place, title, round(self.high * _TITLE_TYPE_SIZE), max_width_px, INK)

    def footer(self, buttons: tuple[Button, ...], prompt: str, progress: str, max_width_px: float) -> None:
        """Draw a page's buttons, and below them the prompt and the progress, both at most ``max_width_px`` long."""
        middle = self.size_px[0] / 2
        type_px = round(self.high * _FOOTER_TYPE_SIZE)
        self.buttons(buttons, self.top + self.high * _BUTTONS_Y)
        self.put_line((middle, self.top + self.high * _PROMPT_Y), prompt, type_px, max_width_px, MUTED_INK)
        self.put_line((middle, self.top + self.high * _PROGRESS_Y), progress, type_px, max_width_px, MUTED_INK)

    def buttons(self, buttons: tuple[Button, ...], y: float) -> None:
        """Draw buttons side by side in reading order, centred on the page around the height ``y``; add their spots."""
        type_px = round(self.high / 34)
        pad = self.high * 0.025
        gap = self.high * 0.03
        min_width = self.high * 0.14
        widths = [max(min_width, self.width_px(button.label, type_px) + 2 * pad) for button in buttons]
        row_width = sum(widths) + gap * (len(widths) - 1)
        x = (self.size_px[0] - row_width) / 2
        height = type_px * 2.0
        placed = list(zip(buttons, widths, strict=True))
        if self.locale.rtl:
            placed.reverse()
        asks_consent = any(button.name == "decline" for button in buttons)  # no answer may be highlighted then
        for button, width in placed:
            box = (x, y - height / 2, x + width, y + height / 2)
            outline = EDGE
            ink = INK
            if button.name == "go_on" and not asks_consent:
                outline = ACCENT
                ink = ACCENT
            self.draw.rounded_rectangle(
                box, radius=height * 0.25, fill=SURFACE, outline=outline, width=max(1, round(self.high / 400))
            )
            self.put((x + width / 2, y), button.label, type_px, ink, "m")
            self.spots.append(Spot(button.name, *box))
            x += width + gap


# Rows of an ISO keyboard: the left edge of the first key in key widths, then the keys. "name:width" is a key that is
# not 1 wide, and "_" is a gap. The rows of the keypad follow those of the main keys.
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
    """The position of a key on a keyboard, in key widths from the left (x) and from the top (y)."""

    key: str
    x: float
    y: float
    width: float


def _lay_out_keyboard() -> dict[str, Keycap]:
    """Return the keycap of each key of an ISO keyboard, by the key's name."""
    caps: dict[str, Keycap] = {}
    for number, (x, row) in enumerate(_ROWS):  # the keypad's rows lie beside the main rows, hence ``%`` below
        for entry in row.split():
            key, _, width = entry.partition(":")
            if key != "_":
                caps[key] = Keycap(key, x, number % _MAIN_ROWS, float(width or 1))
            x += float(width or 1)
    return caps


_CAPS: Mapping[str, Keycap] = _lay_out_keyboard()


def arrange_keycaps(keys: Sequence[str]) -> tuple[list[Keycap], float, float]:
    """Return the keycaps of keys, arranged as on a keyboard from (0, 0), and their total width and height.

    All lengths are in key widths. Rows without any of the keys are left out; keys that are not in the layout follow in
    one more row.
    """
    keyboard_caps = [_CAPS[key] for key in keys if key in _CAPS]
    left = min((cap.x for cap in keyboard_caps), default=0.0)
    rows = sorted({cap.y for cap in keyboard_caps})
    caps = [Keycap(cap.key, cap.x - left, float(rows.index(cap.y)), cap.width) for cap in keyboard_caps]
    height = float(len(rows))
    extra_keys = [key for key in keys if key not in _CAPS]
    if extra_keys:
        caps += [Keycap(key, 2.0 * index, height, 2.0) for index, key in enumerate(extra_keys)]
        height += 1
    width = max((cap.x + cap.width for cap in caps), default=0.0)
    return caps, width, height


def _fit_type(words: str, faces: TypefaceSet, size_px: int, least_px: int, max_width_px: float) -> int:
    """Return the largest type size, from ``size_px`` down, at which a text is at most ``max_width_px`` long.

    If there is none above ``least_px``, return ``least_px``.
    """
    while size_px > least_px and measure_width_px(words, faces, size_px) > max_width_px:
        size_px -= 1
    return size_px


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
    """Draw a key's cap into a box (left, top, right, bottom), with the key's label and a caption above the label.

    A pressed key is lit and carries a tick. Type is at least ``least_px`` pixels.
    """
    left, top, right, bottom = box
    width = right - left
    height = bottom - top
    ink = INK
    fill = SURFACE
    outline = EDGE
    if pressed:
        ink = BACKGROUND
        fill = HIGHLIGHT
        outline = HIGHLIGHT
    draw.rounded_rectangle(box, radius=height * 0.16, fill=fill, outline=outline, width=max(1, round(height / 28)))
    middle_x = (left + right) / 2
    label_y = top + height * 0.5
    if above:
        label_y = top + height * 0.6
        plain = select_typefaces(language)
        caption_px = max(least_px, min(round(height * 0.2), round(width * 0.2)))
        caption_px = _fit_type(above, plain, caption_px, least_px, width * 0.9)
        caption_place = (middle_x, top + height * 0.22)
        draw_line(draw, caption_place, above, faces=plain, size_px=caption_px, colour=ink, anchor="m")
    bold = select_typefaces(language, bold=True)
    label_px = _fit_type(words, bold, max(least_px, round(height * 0.48)), least_px, width * 0.8)
    draw_line(draw, (middle_x, label_y), words, faces=bold, size_px=label_px, colour=ink, anchor="m")
    if pressed:
        _draw_tick(draw, (right - height * 0.24, top + height * 0.2), height, ink)


def _draw_tick(draw: ImageDraw.ImageDraw, place: tuple[float, float], height: float, colour: Colour) -> None:
    """Draw the tick of a pressed key around a point (x, y); ``height`` is that of the keycap, in pixels."""
    x, y = place
    reach = height * 0.07
    tick = [(x - reach, y), (x - reach * 0.2, y + reach * 0.8), (x + reach * 1.2, y - reach)]
    draw.line(tick, fill=colour, width=max(1, round(height / 22)))
