"""A sheet: a page that is being drawn, the type it is set in, and the spots on it that can be pointed at.

Lengths are shares of the height. Nothing that must be read is set smaller than 1/40 of it.
"""

from dataclasses import dataclass

from PIL import Image, ImageDraw

from minihuman.study.screens import Button, Script
from minihuman.typeset.faces import faces_for
from minihuman.typeset.line import draw_line, width_px
from minihuman.typeset.lines import wrap
from minihuman.windows import theme

Size = tuple[int, int]  # width, height
MARGIN = 0.03
LINE = 1.45  # line height, of the type size
TIGHT = 1.2  # where there is little room
SMALLEST = 1 / 40
LAST_RESORT = 1 / 60  # a text too long even so is set smaller rather than cut off; `check` complains about it


@dataclass(frozen=True, slots=True)
class Spot:
    """A box that can be pointed at, in pixels; ``rtl`` says from which end ``along`` counts."""

    name: str
    left: float
    top: float
    right: float
    bottom: float
    rtl: bool = False

    def holds(self, x: float, y: float) -> bool:
        """Whether a point lies in it."""
        return self.left <= x < self.right and self.top <= y < self.bottom

    def along(self, x: float) -> float:
        """How far along it a point is, 0..1."""
        share = min(1.0, max(0.0, (x - self.left) / max(1.0, self.right - self.left)))
        return 1.0 - share if self.rtl else share


class Sheet:
    """A page of a size, in a language."""

    def __init__(self, size_px: Size, script: Script) -> None:
        self.size_px = size_px
        self.script = script
        self.faces = faces_for(script.language, fonts=script.fonts)
        self.page = Image.new("RGB", size_px, theme.BACKGROUND)
        self.draw = ImageDraw.Draw(self.page)
        self.spots: list[Spot] = []

    @property
    def high(self) -> float:
        """The height that lengths are shares of: a window narrower than 4:3 counts as lower than it is."""
        width, height = self.size_px
        return min(float(height), width * 3 / 4)

    @property
    def smallest_px(self) -> int:
        """The smallest type for what must be read."""
        return max(8, round(self.high * SMALLEST))

    def width_px(self, words: str, type_px: int) -> float:
        """How long a line is."""
        return width_px(words, self.faces, type_px)

    def put(
        self, place: tuple[float, float], words: str, type_px: int, colour: theme.Colour, anchor: str = "l"
    ) -> None:
        """Set a line: ``place`` is the middle of its height at its left end, middle ("m") or right end ("r")."""
        rtl = self.script.rtl
        draw_line(self.draw, place, words, faces=self.faces, size_px=type_px, colour=colour, anchor=anchor, rtl=rtl)

    def one_line(self, place: tuple[float, float], words: str, type_px: int, wide: float, colour: theme.Colour) -> None:
        """Centre one line on a place, in smaller type if it would be too long; if it is even so, break it there."""
        while type_px > self.smallest_px and self.width_px(words, type_px) > wide:
            type_px -= 1
        lines = [words] if self.width_px(words, type_px) <= wide else self.wrap(words, type_px, wide)
        x, y = place
        for row, line in enumerate(lines):
            self.put((x, y + (row - (len(lines) - 1) / 2) * type_px * TIGHT), line, type_px, colour, "m")

    def column(
        self, lines: list[str], left: float, right: float, top: float, type_px: int, colour: theme.Colour = theme.INK
    ) -> float:
        """Set lines below each other from where the language begins them; returns where the next would be."""
        for line in lines:
            y = top + type_px * LINE / 2
            if self.script.rtl:
                self.put((right, y), line, type_px, colour, "r")
            else:
                self.put((left, y), line, type_px, colour)
            top += type_px * LINE
        return top

    def wrap(self, words: str, type_px: int, wide: float) -> list[str]:
        """Break text into lines."""
        return wrap(words, faces=self.faces, size_px=type_px, wide_px=wide)

    def fitted(self, words: str, type_px: int, wide: float, high: float) -> tuple[list[str], int]:
        """Break text into lines in the largest type, not over ``type_px``, that fits; the last resort if none does."""
        smallest = max(8, round(self.high * LAST_RESORT))
        for size in range(type_px, smallest - 1, -1):
            lines = self.wrap(words, size, wide)
            if len(lines) * size * LINE <= high:
                return lines, size
        return self.wrap(words, smallest, wide), smallest

    def buttons(self, buttons: tuple[Button, ...], y: float) -> None:
        """Set buttons side by side around the middle, in reading order, and make each a spot."""
        type_px, pad, gap = round(self.high / 34), self.high * 0.025, self.high * 0.03
        widths = [max(self.width_px(button.label, type_px) + 2 * pad, self.high * 0.14) for button in buttons]
        x = (self.size_px[0] - sum(widths) - gap * (len(widths) - 1)) / 2
        tall = type_px * 2.0
        placed = list(zip(buttons, widths, strict=True))
        for button, wide in reversed(placed) if self.script.rtl else placed:
            box = (x, y - tall / 2, x + wide, y + tall / 2)
            main = button.name == "go_on"
            outline = theme.ACCENT if main else theme.EDGE
            self.draw.rounded_rectangle(
                box, radius=tall * 0.25, fill=theme.SURFACE, outline=outline, width=max(1, round(self.high / 400))
            )
            self.put((x + wide / 2, y), button.label, type_px, theme.ACCENT if main else theme.INK, "m")
            self.spots.append(Spot(button.name, *box))
            x += wide + gap
