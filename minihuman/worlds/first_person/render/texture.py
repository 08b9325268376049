"""Texture sampling: four texels of the best-fitting size, blended by position and lit.

A texture is stored in many sizes, four for each halving, so that one always fits within a fifth; OpenGL has one size
for each halving and must blend two. This is SIMD code for eight or sixteen pixels at once; positions are float32, and
colours are whole numbers of 16 bits. Colours are 0x00BBGGRR.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import kernel
from minihuman.worlds.simd import Array, simd_function

U32 = NDArray[np.uint32]

LANES = 16  # pixels at once; sometimes half as many at the end of a row
BLOCK = LANES * (LANES - 1)  # the number of pixels for which one call of `fit` finds the sizes
SCANLINE_BUFFER = 512  # the number of pixels whose texel positions and colours are in memory at once
TAP = 4 * SCANLINE_BUFFER  # the distance between the numbers of a pixel's first tap, its second, and so on
# the maximum number of taps (texture lookups) of a pixel; and a flag in that number, if they lie below each other
MOST_TAPS = 4
DOWN = 8
# the ratio of length to width, of the part of a texture that a pixel covers, above which it has two or four taps
TWO_TAPS = 1.2
FOUR_TAPS = 2.2
MOST_SIZES = 48  # of a texture: more than four for each halving of 2047 texels on a side
WHITE = 0xFFFFFF
ONE = 0x3F800000  # the bits of 1 as float32
# The light at a distance d is (d + FADE_M) / (d + FADE_M + FADED * d) of that nearby.
FADE_M = 14.0
FADED = 0.35
# in the style of a display: the light of a near wall, and the part of it that a joint takes away
BRIGHTER = 1.12
DARK = 0.45

_BIAS = 127  # of a float32's exponent
_OTHERS = 0x00FF00FF  # the channels other than green
_THREE_OF_FOUR = [lane for lane in range(4 * LANES) if lane % 4 < 3]


def _seen(
    ops: Any,
    steps: Any,
    count: int,
    least: float,
    inverse: tuple[float, float, float],
    u: tuple[float, float, float],
    v: tuple[float, float, float],
) -> tuple[Any, Any, Any]:
    """Return a face's distance at some pixels of a row, and its texture position right and up.

    ``steps`` are the pixels' numbers from the first one. The other arguments are as in `fit`.
    """
    far = 1.0 / ops.larger(
        ops.single(inverse[1], count) * steps + ops.single(inverse[0], count), ops.single(least, count)
    )
    right = (ops.single(u[1], count) * steps + ops.single(u[0], count)) * far
    up = (ops.single(v[1], count) * steps + ops.single(v[0], count)) * far
    return far, right, up


def _ways(
    ops: Any,
    count: int,
    projected: tuple[Any, Any, Any],
    inverse: tuple[float, float, float],
    u: tuple[float, float, float],
    v: tuple[float, float, float],
) -> list[Any]:
    """Return a pixel's extent in the texture, divided by the face's distance.

    The four numbers are the change of the texture position right, per pixel right and down, and then of that up.
    ``projected`` is the result of `_seen`.
    """
    _, right, up = projected
    by = ops.single(inverse[1], count), ops.single(inverse[2], count)
    return [
        ops.single(coordinate[k + 1], count) - at * by[k] for coordinate, at in ((u, right), (v, up)) for k in (0, 1)
    ]


def _fitting(ops: Any, count: int, far: Any, ways: Sequence[Any], wide: float, high: float, last: int) -> Any:
    """Return the number of the smallest texture size in which a pixel still covers a texel along its longer extent."""
    across, along = (ops.larger(ops.size(ways[k]), ops.size(ways[k + 1])) for k in (0, 2))
    covered = ops.larger(across * ops.single(wide, count), along * ops.single(high, count)) * far
    return _number(ops, count, covered, last)


def _number(ops: Any, count: int, covered: Any, last: int) -> Any:
    """Return the number, up to ``last``, of the smallest size in which pixels still cover a texel.

    In the largest size, they cover ``covered`` texels.
    """
    square = covered * covered
    # the power of two in the fourth power counts quarters of a halving
    quarters = ops.view(square * square, "uint32") >> 23
    bias = ops.fixed(_BIAS, count)
    return ops.smaller(ops.larger(quarters, bias), bias + ops.fixed(last, count)) - bias


@simd_function()
def fit(
    ops: Any,
    sizes: Array,
    inverse: float,
    inverse_x: float,
    inverse_y: float,
    u: float,
    u_x: float,
    u_y: float,
    v: float,
    v_x: float,
    v_y: float,
    wide: float,
    high: float,
    least: float,
    most: float,
    last: int,
    pixels_right: float,
    below: float,
) -> None:
    """Find which size of its texture fits a face at every sixteenth pixel of a row, sixteen times.

    ``sizes`` receives the sizes' numbers and then, as float32, the texture distance to the pixel that is
    ``pixels_right`` and ``below``: in repeats, from left to right sixteen times, then upwards. Then follow the sizes
    for pixels that are sampled at several taps along their longer extent, the number of taps (1, 2 or 4), and `DOWN`.

    ``inverse`` is the face's nearness at the first pixel; ``u`` and ``v`` are that pixel's texture position in repeats
    right and up, times the nearness; ``_x`` and ``_y`` are the change of each per pixel right and down. The largest
    size has ``wide`` x ``high`` texels, and ``last`` is the number of the smallest. Nearness is at least ``least``, and
    ``most`` pixels follow the first.
    """
    ways = (inverse, inverse_x, inverse_y), (u, u_x, u_y), (v, v_x, v_y)
    steps = ops.smaller(ops.steps(LANES) * float(LANES), ops.single(most, LANES))
    projected = _seen(ops, steps, LANES, least, *ways)
    changes = _ways(ops, LANES, projected, *ways)
    ops.store(sizes, 0, _fitting(ops, LANES, projected[0], changes, wide, high, last))
    for k in (0, 2):
        moved = (changes[k] * ops.single(pixels_right, LANES) + changes[k + 1] * ops.single(below, LANES)) * projected[
            0
        ]
        ops.store(sizes, (1 + k // 2) * LANES, ops.view(moved, "uint32"))
    by = [ops.single(extent, LANES) for extent in (wide, high)]
    right, down = (
        ops.larger(ops.size(changes[k]) * by[0], ops.size(changes[k + 2]) * by[1]) * projected[0] for k in (0, 1)
    )
    long = ops.larger(right, down)
    short = ops.smaller(right, down)
    # texels larger than a pixel need no taps
    shape = long / ops.larger(short, 1.0)
    two = steps * 0.0 + 2.0
    taps = ops.where(shape > FOUR_TAPS, two + 2.0, ops.where(shape > TWO_TAPS, two, 1.0))
    ops.store(sizes, 3 * LANES, _number(ops, LANES, ops.larger(short, long / taps), last))
    ops.store(sizes, 4 * LANES, ops.cut(taps) | ops.where(down > right, ops.fixed(DOWN, LANES), 0))


@simd_function()
def place(
    ops: Any,
    places: Array,
    at: int,
    offset: int,
    width: int,
    height: int,
    inverse: float,
    inverse_x: float,
    u: float,
    u_x: float,
    v: float,
    v_x: float,
    least: float,
    texels: Array,
    ahead: int,
) -> None:
    """Write the texel positions of neighbouring pixels in one texture size to ``places``, from index ``at`` on.

    The size has ``width`` x ``height`` texels, which begin at ``offset`` in ``texels``. Texels ``ahead`` of these will
    soon be needed, too. The other arguments are as in `fit`.
    """
    ways = (inverse, inverse_x, 0.0), (u, u_x, 0.0), (v, v_x, 0.0)
    _, right, up = _seen(ops, ops.steps(LANES), LANES, least, *ways)
    size = [ops.fixed(extent, LANES) for extent in (offset, width, height)]
    texel_indices = _place(ops, places, at, right, up, size)
    ops.fetch(texels, texel_indices, ahead)


@simd_function()
def place_each(
    ops: Any,
    places: Array,
    at: int,
    table: Array,
    first: int,
    last: int,
    inverse: float,
    inverse_x: float,
    inverse_y: float,
    u: float,
    u_x: float,
    u_y: float,
    v: float,
    v_x: float,
    v_y: float,
    wide: float,
    high: float,
    least: float,
) -> None:
    """Write the texel positions of pixels that each have their own texture size.

    The texture's sizes begin at index ``first`` of the table. The other arguments are as in `fit` and `place`.
    """
    ways = (inverse, inverse_x, inverse_y), (u, u_x, u_y), (v, v_x, v_y)
    projected = _seen(ops, ops.steps(LANES), LANES, least, *ways)
    number = _fitting(ops, LANES, projected[0], _ways(ops, LANES, projected, *ways), wide, high, last)
    offset, extents = ops.pairs(table, ops.fixed(first, LANES) + number + number)
    _place(ops, places, at, *projected[1:], [offset, extents & 0xFFFF, extents >> 16])


def _place(ops: Any, places: Array, at: int, right: Any, up: Any, size: Sequence[Any]) -> Any:
    """Write and return the index of the texel below and left of each texture position.

    Also write the index of the texel above it, and the position between them, right and up, in 1/256. ``size`` is the
    start of the texture size's texels, its width and its height.
    """
    offset, width, height = size
    # in 1/256 texel: 128 less, as a texel's position is its middle, and 256 more, for the ring of texels around them
    x = ops.cut((right - ops.floor(right)) * (ops.short(width) * 256.0)) + 128
    y = ops.cut((up - ops.floor(up)) * (ops.short(height) * 256.0)) + 128
    row = width + 2
    texel_indices = offset + (x >> 8) + (y >> 8) * row
    right = x & 255
    up = y & 255
    for nth, lanes in enumerate((texel_indices, texel_indices + row, right | right << 16, up | up << 16)):
        ops.store(places, at + nth * LANES, lanes)
    return texel_indices


@simd_function()
def light(ops: Any, lights: Array, red: int, green: int, blue: int) -> None:
    """Write the light of each channel, 0 to 65535, for the functions that look up colours."""
    for nth, pair in enumerate((red | blue << 16, green)):
        ops.store(lights, nth * LANES, ops.fixed(pair, LANES))


def _look_up(count: int, taps: int = 1) -> Any:
    """Return vector code that looks up the colours of ``count`` pixels, with a number of taps each."""

    def look_up(ops: Any, texels: Array, places: Array, at: int, lights: Array, out: Array, slot: int) -> None:
        """Write the colours at the texel positions that `place` wrote, under the light that `light` wrote.

        With several taps, that light is each tap's share.
        """
        by = [ops.view(ops.load(lights, nth * LANES, count), "uint16") for nth in (0, 1)]
        tap_sums = []
        # `_place` wrote sixteen lower texels, then the upper ones, then the positions right and up between them
        for tap_at in range(0, taps * TAP, TAP):
            a, b = ops.pairs_at(texels, places, at + tap_at, count)
            c, d = ops.pairs_at(texels, places, at + (tap_at + LANES), count)
            share = [ops.view(ops.load(places, at + (tap_at + nth * LANES), count), "uint16") for nth in (2, 3)]
            red_blues = [ops.view(texels & _OTHERS, "uint16") for texels in (a, b, c, d)]
            greens = [ops.view(texels, "uint16") >> 8 for texels in (a, b, c, d)]
            channels = _between(red_blues, *share), _between(greens, *share)
            # a channel is 0 to 255 in the upper eight bits, before and after; the lower ones are rounded away
            tap_sums.append(
                [ops.upper((channel + 128) & 0xFF00, light) for channel, light in zip(channels, by, strict=True)]
            )
        red_blue, green = (sum(sums[1:], sums[0]) + 128 for sums in zip(*tap_sums, strict=True))
        ops.store(out, slot, ops.view(red_blue >> 8, "uint32") | (ops.view(green, "uint32") & 0xFF00))

    return simd_function()(look_up)


def _between(corners: Sequence[Any], right: Any, up: Any) -> Any:
    """Blend four 8-bit numbers by a position right and up from the first, in 1/256; the result is 0 to 65280."""
    a, b, c, d = corners
    left = 256 - right
    low = (a * left + b * right + 128) >> 8
    high = (c * left + d * right + 128) >> 8
    return low * (256 - up) + high * up


look_up_8 = _look_up(8)
look_up_16 = _look_up(16)
look_up_2 = _look_up(16, 2)
look_up_4 = _look_up(16, 4)


@simd_function()
def shade(
    ops: Any,
    out: Array,
    slot: int,
    inverse: float,
    inverse_x: float,
    least: float,
    red: float,
    red_x: float,
    green: float,
    green_x: float,
    blue: float,
    blue_x: float,
) -> None:
    """Multiply sixteen colours by a light that varies along the row.

    ``red``, ``green`` and ``blue`` are the light at the first pixel divided by distance, and ``_x`` their changes per
    pixel. ``inverse`` and ``least`` are as in `fit`.
    """
    steps = ops.steps(LANES)
    far = ops.single(inverse_x, LANES) * steps + ops.single(inverse, LANES)
    far = 1.0 / ops.larger(far, ops.single(least, LANES))
    colours = ops.load(out, slot, LANES)
    result = ops.fixed(0, LANES)
    for shift, (first, by) in ((0, (red, red_x)), (8, (green, green_x)), (16, (blue, blue_x))):
        bright = (ops.single(by, LANES) * steps + ops.single(first, LANES)) * far
        bright = ops.smaller(ops.larger(bright, 0.0), 1.0)
        channel = ((colours >> shift) & 255) * ops.cut(bright * 65535.0 + 0.5)
        result = result | ((channel + 32768) >> 16) << shift
    ops.store(out, slot, result)


@simd_function()
def occlude(
    ops: Any,
    near: Array,
    at: int,
    inverse: float,
    inverse_x: float,
    along: float,
    along_x: float,
    aside: float,
    aside_x: float,
    length: float,
    scale: float,
    inner: float,
    least: float,
) -> None:
    """Record for sixteen pixels the nearness of a segment on their face, if it is nearer than others.

    The recorded value is the squared distance times ``scale``, minus ``inner``: 1 where the segment no longer darkens a
    pixel, 0 or less where it darkens most.

    ``along`` and ``aside`` are the pixels' positions along the segment from its start and beside it, in metres divided
    by distance.
    """
    ways = [(ops.single(by, LANES), ops.single(to, LANES)) for by, to in ((along_x, along), (aside_x, aside))]
    steps = ops.steps(LANES)
    far = 1.0 / ops.larger(ops.single(inverse_x, LANES) * steps + ops.single(inverse, LANES), ops.single(least, LANES))
    on, off = ((by * steps + to) * far for by, to in ways)
    beyond = ops.larger(ops.larger(on - ops.single(length, LANES), on * -1.0), 0.0)
    square = (beyond * beyond + off * off) * ops.single(scale, LANES) - ops.single(inner, LANES)
    ops.store(near, at, ops.larger(ops.smaller(ops.load(near, at, LANES), square), 0.0))


@simd_function()
def darken(
    ops: Any, out: Array, slot: int, near: Array, at: int, inverse: float, inverse_x: float, least: float
) -> None:
    """Darken sixteen colours by the occlusion that `occlude` recorded, and by their distance."""
    colours = ops.load(out, slot, LANES)
    result = ops.fixed(0, LANES)
    closer = ops.single(inverse_x, LANES) * ops.steps(LANES) + ops.single(inverse, LANES)
    closer = ops.larger(closer, ops.single(least, LANES)) * FADE_M + 1.0
    part = 1.0 - ops.load(near, at, LANES)
    bright = (1.0 - part * part * (part * part) * DARK) * (closer / (closer + FADED))
    by = ops.cut(bright * (65535.0 * BRIGHTER) + 0.5)
    for shift in (0, 8, 16):
        channel = (((colours >> shift) & 255) * by + 32768) >> 16
        result = result | ops.smaller(channel, 255) << shift
    ops.store(out, slot, result)


@simd_function()
def fill(ops: Any, out: Array, at: int, colour: int) -> None:
    """Write one colour to sixteen pixels."""
    ops.store(out, at, ops.fixed(colour, LANES))


@simd_function()
def copy(ops: Any, out: Array, at: int, colours: Array, slot: int) -> None:
    """Copy sixteen colours."""
    ops.store(out, at, ops.load(colours, slot, LANES))


@simd_function()
def pack(ops: Any, line: Array, x: int, picture: Array, at: int) -> None:
    """Write sixteen colours as bytes of red, green and blue."""
    ops.store(picture, at, ops.shuffled(ops.view(ops.load(line, x, LANES), "uint8"), _THREE_OF_FOUR))


@kernel("void(uint8[:, :, ::1], uint32[::1], uint32[::1])", only=True, hold_gil=True)
def fill_sizes(pixels: NDArray[np.uint8], table: U32, texels: U32) -> None:
    """Write a texture in all its sizes, each with its ring, to the places in its table; the first pixel row is on top.

    A texel is the mean of the texels that it covers four sizes before, or in the largest size if there is none. Means
    are rounded up, as in OpenGL's software driver, and are whole numbers throughout.
    """
    for size in range(int(table[2 * MOST_SIZES - 1]) + 1):
        begin = int(table[2 * size])
        extents = int(table[2 * size + 1])
        width = extents & 0xFFFF
        height = extents >> 16
        before = size - 4 if size >= 4 else 0
        source = int(table[2 * before])
        extents = int(table[2 * before + 1])
        columns = extents & 0xFFFF
        rows = extents >> 16
        row = begin + width + 2
        for i in range(height):
            for j in range(width):
                red = 0
                green = 0
                blue = 0
                if size == 0:
                    red = int(pixels[-1 - i, j, 0])
                    green = int(pixels[-1 - i, j, 1])
                    blue = int(pixels[-1 - i, j, 2])
                else:
                    for k in range(i * rows // height, min(i * rows // height + 3, rows)):
                        high = min((i + 1) * rows, (k + 1) * height) - max(i * rows, k * height)
                        for m in range(j * columns // width, min(j * columns // width + 3, columns)):
                            wide = min((j + 1) * columns, (m + 1) * width) - max(j * columns, m * width)
                            if high > 0 and wide > 0:
                                texel = int(texels[source + (k + 1) * (columns + 2) + m + 1])
                                red += high * wide * (texel & 0xFF)
                                green += high * wide * (texel >> 8 & 0xFF)
                                blue += high * wide * (texel >> 16)
                    area = rows * columns
                    red = (red + area - 1) // area
                    green = (green + area - 1) // area
                    blue = (blue + area - 1) // area
                texels[row + j + 1] = red | green << 8 | blue << 16
            texels[row], texels[row + width + 1] = texels[row + width], texels[row + 1]
            row += width + 2
        for j in range(width + 2):
            texels[begin + j], texels[row + j] = texels[row - width - 2 + j], texels[begin + width + 2 + j]
