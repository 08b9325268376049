"""Looking up textures: four texels of the size that fits best, blended by where a place lies between them, and lit.

A texture is kept in many sizes, four for each halving, so that one of them always fits to a fifth: OpenGL has one for
each halving and has to blend two. What is done here is vector code, eight or sixteen pixels side by side at once; where
a place lies is told in float32, what is seen there in whole numbers of 16 bits. Colours are 0x00BBGGRR.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.lanes import Array, vector

U32 = NDArray[np.uint32]

LANES = 16  # pixels at once; half of them where no more are wanted
BLOCK = LANES * (LANES - 1)  # pixels between the ends of which sizes are found at once
MOST_SIZES = 48  # of a texture: more than four for each halving of 2047 texels a side
WHITE = 0xFFFFFF

_BIAS = 127  # of a float32's power of two
_OTHERS = 0x00FF00FF  # than green


def _seen(
    do: Any,
    steps: Any,
    count: int,
    least: float,
    inverse: tuple[float, float, float],
    u: tuple[float, float, float],
    v: tuple[float, float, float],
) -> tuple[Any, Any, Any]:
    """How far a face is at pixels of a row, so many steps from the first, and where in its texture: right and up."""
    far = 1.0 / do.larger(do.single(inverse[1], count) * steps + do.single(inverse[0], count), do.single(least, count))
    right = (do.single(u[1], count) * steps + do.single(u[0], count)) * far
    up = (do.single(v[1], count) * steps + do.single(v[0], count)) * far
    return far, right, up


def _ways(
    do: Any,
    count: int,
    seen: tuple[Any, Any, Any],
    inverse: tuple[float, float, float],
    u: tuple[float, float, float],
    v: tuple[float, float, float],
) -> list[Any]:
    """How far a pixel goes in the texture over ``far``: across by a pixel right and one down, and upwards by them."""
    _, right, up = seen
    by = do.single(inverse[1], count), do.single(inverse[2], count)
    return [do.single(each[k + 1], count) - at * by[k] for each, at in ((u, right), (v, up)) for k in (0, 1)]


def _fitting(do: Any, count: int, far: Any, ways: Sequence[Any], wide: float, high: float, last: int) -> Any:
    """The number of the size of a texture that fits: the last of which a pixel covers a texel, by its longer way."""
    across, along = (do.larger(do.size(ways[k]), do.size(ways[k + 1])) for k in (0, 2))
    covered = do.larger(across * do.single(wide, count), along * do.single(high, count)) * far
    square = covered * covered
    # the power of two in the fourth power counts quarters of a halving
    quarters, bias = do.bits(square * square) >> 23, do.fixed(_BIAS, count)
    return do.smaller(do.larger(quarters, bias), bias + do.fixed(last, count)) - bias


@vector()
def fit(
    do: Any,
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
    beside: float,
    below: float,
) -> None:
    """Find which size of its texture fits a face at every sixteenth pixel of a row, sixteen times.

    After the sizes' numbers stand, as float32, how far in the texture it is to the pixel so many ``beside`` and
    ``below``: in repeats, from left to right sixteen times, then upwards.

    Args:
        do: the operations.
        sizes: where their numbers are written to.
        inverse: how near the face is at the first pixel; ``inverse_x`` and ``inverse_y`` are how that changes by pixels
            right and down.
        inverse_x: see inverse.
        inverse_y: see inverse.
        u: where in the texture the first pixel lies from left to right, in repeats, times how near it is.
        u_x: see inverse.
        u_y: see inverse.
        v: the same upwards.
        v_x: see inverse.
        v_y: see inverse.
        wide: how many texels the largest size has from left to right.
        high: and upwards.
        least: the least nearness; beyond a face's edge it may reach nonsense.
        most: how many pixels follow the first; what is beyond them is like the last.
        last: the number of the smallest size.
        beside: see above.
        below: see above.
    """
    ways = (inverse, inverse_x, inverse_y), (u, u_x, u_y), (v, v_x, v_y)
    steps = do.smaller(do.steps(LANES) * float(LANES), do.single(most, LANES))
    seen = _seen(do, steps, LANES, least, *ways)
    changes = _ways(do, LANES, seen, *ways)
    do.store(sizes, 0, _fitting(do, LANES, seen[0], changes, wide, high, last))
    for k in (0, 2):
        moved = (changes[k] * do.single(beside, LANES) + changes[k + 1] * do.single(below, LANES)) * seen[0]
        do.store(sizes, (1 + k // 2) * LANES, do.bits(moved))


@vector()
def place(
    do: Any,
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
    """Write down where neighbours in a row are found in one size of a face's texture, whose texels begin at ``offset``.

    Texels that are ``ahead`` of those will soon be needed too. For the others see `fit`.
    """
    ways = (inverse, inverse_x, 0.0), (u, u_x, 0.0), (v, v_x, 0.0)
    _, right, up = _seen(do, do.steps(LANES), LANES, least, *ways)
    size = [do.fixed(each, LANES) for each in (offset, width, height)]
    found = _place(do, places, at, right, up, size)
    do.fetch(texels, found, ahead)


@vector()
def place_each(
    do: Any,
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
    """Write it down where each has a size of its own; the texture's are in the table from ``first`` on."""
    ways = (inverse, inverse_x, inverse_y), (u, u_x, u_y), (v, v_x, v_y)
    seen = _seen(do, do.steps(LANES), LANES, least, *ways)
    number = _fitting(do, LANES, seen[0], _ways(do, LANES, seen, *ways), wide, high, last)
    offset, both = do.pairs(table, do.fixed(first, LANES) + number + number)
    _place(do, places, at, *seen[1:], [offset, both & 0xFFFF, both >> 16])


def _place(do: Any, places: Array, at: int, right: Any, up: Any, size: Sequence[Any]) -> Any:
    offset, width, height = size
    # half a texel less, for texels are known at their middles; one more, for the ring around them
    x = do.cut((right - do.floor(right)) * (do.short(width) * 256.0)) + 128
    y = do.cut((up - do.floor(up)) * (do.short(height) * 256.0)) + 128
    row = width + 2
    found = offset + (x >> 8) + (y >> 8) * row
    right, up = x & 255, y & 255
    for nth, each in enumerate((found, found + row, right | right << 16, up | up << 16)):
        do.store(places, at + nth * LANES, each)
    return found


@vector()
def light(do: Any, lights: Array, red: int, green: int, blue: int) -> None:
    """Write down a light of 0 to 65535 for each channel."""
    for nth, each in enumerate((red | blue << 16, green)):
        do.store(lights, nth * LANES, do.fixed(each, LANES))


def _look_up(count: int) -> Any:
    def look_up(do: Any, texels: Array, places: Array, at: int, lights: Array, out: Array, slot: int) -> None:
        """Write down the colours that are found at some places, under a light that was written down."""
        a, b = do.pairs_at(texels, places, at, count)
        c, d = do.pairs_at(texels, places, at + LANES, count)
        share = [do.halves(do.load(places, at + nth * LANES, count)) for nth in (2, 3)]
        others = [do.halves(each & _OTHERS) for each in (a, b, c, d)]
        greens = [do.halves(each) >> 8 for each in (a, b, c, d)]
        channels = _between(others, *share), _between(greens, *share)
        # rounded; a channel has 0 to 255 above eight bits of no meaning, before and after
        by = [do.halves(do.load(lights, nth * LANES, count)) for nth in (0, 1)]
        two, one = (do.upper((each + 128) & 0xFF00, light) + 128 for each, light in zip(channels, by, strict=True))
        do.store(out, slot, do.wholes(two >> 8) | (do.wholes(one) & 0xFF00))

    return vector()(look_up)


def _between(corners: Sequence[Any], right: Any, up: Any) -> Any:
    """Blend four numbers of 8 bits by how far a place is right and up from the first, in 1/256; 0 to 65280."""
    a, b, c, d = corners
    left = 256 - right
    low, high = (a * left + b * right + 128) >> 8, (c * left + d * right + 128) >> 8
    return low * (256 - up) + high * up


look_up_8, look_up_16 = _look_up(8), _look_up(16)


@vector()
def shade(
    do: Any,
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
    """Put sixteen colours under a light that varies: how bright it is on the first, over distance, and how it grows."""
    steps = do.steps(LANES)
    far = do.single(inverse_x, LANES) * steps + do.single(inverse, LANES)
    far = 1.0 / do.larger(far, do.single(least, LANES))
    colours = do.load(out, slot, LANES)
    result = do.fixed(0, LANES)
    for shift, (first, by) in ((0, (red, red_x)), (8, (green, green_x)), (16, (blue, blue_x))):
        bright = (do.single(by, LANES) * steps + do.single(first, LANES)) * far
        bright = do.smaller(do.larger(bright, 0.0), 1.0)
        channel = ((colours >> shift) & 255) * do.cut(bright * 65535.0 + 0.5)
        result = result | ((channel + 32768) >> 16) << shift
    do.store(out, slot, result)


@vector()
def fill(do: Any, out: Array, at: int, colour: int) -> None:
    """Give sixteen pixels one colour."""
    do.store(out, at, do.fixed(colour, LANES))


@vector()
def copy(do: Any, out: Array, at: int, colours: Array, slot: int) -> None:
    """Copy sixteen colours."""
    do.store(out, at, do.load(colours, slot, LANES))


@vector()
def pack(do: Any, line: Array, x: int, picture: Array, at: int) -> None:
    """Write sixteen colours as bytes: red, green, blue."""
    do.store(picture, at, do.three_of_four(do.octets(do.load(line, x, LANES))))
