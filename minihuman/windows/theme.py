"""What every screen is drawn with: colours that read well in a dim room, and one typeface in the sizes asked for."""

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from PIL import ImageFont

Colour = tuple[int, int, int]

# Contrast against BACKGROUND (WCAG): INK 14.4, QUIET 6.6, ACCENT 8.5. LIT and ACCENT stay apart in every kind of colour
# vision (Okabe and Ito 2008: sky blue and orange).
BACKGROUND: Colour = (22, 25, 30)
SURFACE: Colour = (38, 43, 51)
EDGE: Colour = (84, 93, 105)
INK: Colour = (232, 230, 225)
QUIET: Colour = (154, 164, 176)
ACCENT: Colour = (240, 176, 72)
LIT: Colour = (86, 180, 233)


@lru_cache(maxsize=64)
def font(size_px: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, ``size_px`` from ascender to descender: Latin, Greek, Cyrillic and arrows."""
    return ImageFont.truetype(str(_folder() / f"DejaVuSans{'-Bold' if bold else ''}.ttf"), max(1, size_px))


@lru_cache(maxsize=1)
def _folder() -> Path:
    """Where matplotlib keeps the typeface it ships; found without importing it (which takes half a second)."""
    spec = find_spec("matplotlib")
    assert spec is not None, "matplotlib is a dependency of this package"
    assert spec.origin is not None
    return Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf"
