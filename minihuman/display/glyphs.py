"""Draw shaped lines: FreeType turns outlines into grey pixels, with the hints of the face. Knows no text.

FreeType comes with the package freetype-py, so that pictures do not change with Pillow, which has a FreeType of its
own. All of it is integer arithmetic: the pixels are the same on every processor.
"""

import threading
from dataclasses import dataclass
from functools import cache, lru_cache

import freetype
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from minihuman.display.shaping import SUBPIXELS, PlacedGlyph, ShapedLine
from minihuman.display.typefaces import Typeface

_LOAD_FLAGS = freetype.FT_LOAD_DEFAULT | freetype.FT_LOAD_NO_BITMAP
_LOCK = threading.Lock()  # a FreeType face has one size and one glyph at a time, and a server draws in several threads

Colour = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class GlyphBitmap:
    """How far a glyph covers each pixel, uint8[rows, columns], and where its upper left corner is from its origin."""

    coverage: NDArray[np.uint8]
    left: int
    top: int  # upwards


@cache
def _open_face(face: Typeface) -> freetype.Face:
    return freetype.Face(face.path, face.index)


@lru_cache(maxsize=8192)
def render_glyph(face: Typeface, size_px: int, glyph: int) -> GlyphBitmap:
    """Render a glyph of a face in a size."""
    with _LOCK:
        opened = _open_face(face)
        opened.set_pixel_sizes(0, size_px)
        opened.load_glyph(glyph, _LOAD_FLAGS)
        opened.glyph.render(freetype.FT_RENDER_MODE_NORMAL)
        bitmap = opened.glyph.bitmap
        rows = np.array(bitmap.buffer, np.uint8).reshape(bitmap.rows, bitmap.pitch)
        coverage = rows[:, : bitmap.width].copy()
        return GlyphBitmap(coverage, opened.glyph.bitmap_left, opened.glyph.bitmap_top)


def draw_shaped(
    draw: ImageDraw.ImageDraw, baseline: tuple[float, float], line: ShapedLine, size_px: int, colour: Colour
) -> None:
    """Draw a line from the left end of its baseline."""
    x_64, y_64 = (round(length * SUBPIXELS) for length in baseline)
    mask = _render_line(line, size_px, x_64 % SUBPIXELS, y_64 % SUBPIXELS)
    if mask is not None:
        left = x_64 // SUBPIXELS + mask.left
        top = y_64 // SUBPIXELS - mask.top
        draw.bitmap((left, top), Image.fromarray(mask.coverage), fill=colour)


@lru_cache(maxsize=512)
def _render_line(line: ShapedLine, size_px: int, x_64: int, y_64: int) -> GlyphBitmap | None:
    """Put a line's glyphs together, its origin so far to the right and down in its pixel; None where all are blank."""
    placed = [
        (render_glyph(glyph.face, size_px, glyph.glyph), *_find_pixel(glyph, x_64, y_64)) for glyph in line.glyphs
    ]
    inked = [(bitmap, x + bitmap.left, y + bitmap.top) for bitmap, x, y in placed if bitmap.coverage.size]
    if not inked:
        return None
    left = min(x for _, x, _ in inked)
    top = max(y for _, _, y in inked)
    right = max(x + bitmap.coverage.shape[1] for bitmap, x, _ in inked)
    bottom = min(y - bitmap.coverage.shape[0] for bitmap, _, y in inked)
    canvas = np.zeros((top - bottom, right - left), np.uint8)
    for bitmap, x, y in inked:
        height, width = bitmap.coverage.shape
        under = canvas[top - y : top - y + height, x - left : x - left + width]
        under += _scale(bitmap.coverage, 255 - under)
    return GlyphBitmap(canvas, left, top)


def _find_pixel(glyph: PlacedGlyph, x_64: int, y_64: int) -> tuple[int, int]:
    """Find the whole pixel that a glyph's origin is rounded to, to the right and up."""
    half = SUBPIXELS // 2
    return (glyph.x_64 + x_64 + half) // SUBPIXELS, (glyph.y_64 - y_64 + half) // SUBPIXELS


def _scale(coverage: NDArray[np.uint8], share: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Multiply two arrays of shares of 255, rounded to the nearest."""
    product = coverage.astype(np.uint16) * share + 128
    return (((product >> 8) + product) >> 8).astype(np.uint8)
