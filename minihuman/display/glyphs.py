"""Drawing of shaped lines: FreeType renders glyphs as grey pixels, with the hinting of the typeface.

FreeType comes with the package freetype-py, so that pictures do not change with Pillow, which has its own FreeType. All
arithmetic is with integers, so the pixels are the same on every processor.
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
    """A glyph's coverage of each pixel, uint8[rows, columns], and its upper left corner relative to its origin."""

    coverage: NDArray[np.uint8]
    left: int
    top: int  # upwards


@cache
def _open_face(face: Typeface) -> freetype.Face:
    return freetype.Face(face.path, face.index)


@lru_cache(maxsize=8192)
def render_glyph(face: Typeface, size_px: int, glyph: int) -> GlyphBitmap:
    """Return the bitmap of the glyph with an index in a typeface, at a type size in pixels."""
    with _LOCK:
        ft_face = _open_face(face)
        ft_face.set_pixel_sizes(0, size_px)
        ft_face.load_glyph(glyph, _LOAD_FLAGS)
        ft_face.glyph.render(freetype.FT_RENDER_MODE_NORMAL)
        bitmap = ft_face.glyph.bitmap
        rows = np.array(bitmap.buffer, np.uint8).reshape(bitmap.rows, bitmap.pitch)
        coverage = rows[:, : bitmap.width].copy()  # without the padding at the end of each row
        return GlyphBitmap(coverage, ft_face.glyph.bitmap_left, ft_face.glyph.bitmap_top)


def draw_shaped(
    draw: ImageDraw.ImageDraw, baseline: tuple[float, float], line: ShapedLine, size_px: int, colour: Colour
) -> None:
    """Draw a shaped line of type.

    Args:
        draw: the drawing context.
        baseline: the left end (x, y) of the line's baseline, in pixels from the top left.
        line: the line.
        size_px: the size of type for which the line was shaped, in pixels.
        colour: the colour of the type.
    """
    x_64, y_64 = (round(coordinate * SUBPIXELS) for coordinate in baseline)
    mask = _render_line(line, size_px, x_64 % SUBPIXELS, y_64 % SUBPIXELS)
    if mask is not None:
        left = x_64 // SUBPIXELS + mask.left
        top = y_64 // SUBPIXELS - mask.top
        draw.bitmap((left, top), Image.fromarray(mask.coverage), fill=colour)


@lru_cache(maxsize=512)
def _render_line(line: ShapedLine, size_px: int, x_64: int, y_64: int) -> GlyphBitmap | None:
    """Render a line's glyphs into one bitmap; return None if all glyphs are blank.

    ``x_64`` and ``y_64`` are the position of the line's origin within its pixel, in 64ths to the right and down.
    """
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
        under += _scale(bitmap.coverage, 255 - under)  # a glyph covers its share of what is not covered yet
    return GlyphBitmap(canvas, left, top)


def _find_pixel(glyph: PlacedGlyph, x_64: int, y_64: int) -> tuple[int, int]:
    """Return the pixel (x, y) to which a glyph's origin is rounded, to the right and up from the line's pixel.

    ``x_64`` and ``y_64`` are the position of the line's origin within its pixel, in 64ths to the right and down.
    """
    half = SUBPIXELS // 2
    return (glyph.x_64 + x_64 + half) // SUBPIXELS, (glyph.y_64 - y_64 + half) // SUBPIXELS


def _scale(coverage: NDArray[np.uint8], share: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return coverage * share / 255 for arrays of values from 0 to 255, rounded to the nearest whole number.

    The shifts divide by 255 exactly for all products of two bytes.
    """
    product = coverage.astype(np.uint16) * share + 128
    return (((product >> 8) + product) >> 8).astype(np.uint8)
