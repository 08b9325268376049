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


def _fitting(
    do: Any,
    count: int,
    seen: tuple[Any, Any, Any],
    inverse: tuple[float, float, float],
    u: tuple[float, float, float],
    v: tuple[float, float, float],
    wide: float,
    high: float,
    last: int,
) -> Any:
    """The number of the size of a texture that fits: the last of which a pixel covers a texel, by its longer way."""
    far, right, up = seen
    by_x, by_y = do.single(inverse[1], count), do.single(inverse[2], count)
    across = do.larger(do.size(do.single(u[1], count) - right * by_x), do.size(do.single(u[2], count) - right * by_y))
    along = do.larger(do.size(do.single(v[1], count) - up * by_x), do.size(do.single(v[2], count) - up * by_y))
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
) -> None:
    """Find which size of its texture fits a face at every sixteenth pixel of a row, sixteen times.

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
    """
    ways = (inverse, inverse_x, inverse_y), (u, u_x, u_y), (v, v_x, v_y)
    steps = do.smaller(do.steps(LANES) * float(LANES), do.single(most, LANES))
    seen = _seen(do, steps, LANES, least, *ways)
    do.store(sizes, 0, _fitting(do, LANES, seen, *ways, wide, high, last))


def _look_up(count: int) -> Any:
    def look_up(
        do: Any,
        texels: Array,
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
        red: int,
        green: int,
        blue: int,
        out: Array,
        slot: int,
        ahead: int,
    ) -> None:
        """Write down the colours that neighbours in a row have by one size of a face's texture, and by its light.

        The size's texels begin at ``offset``. The light is 0 to 65536 for each channel. Colours go into ``out`` from
        ``slot`` on. Texels that are ``ahead`` of those will soon be needed too. For the others see `fit`.
        """
        ways = (inverse, inverse_x, 0.0), (u, u_x, 0.0), (v, v_x, 0.0)
        _, right, up = _seen(do, do.steps(count), count, least, *ways)
        size = [do.fixed(each, count) for each in (offset, width, height)]
        do.store(out, slot, _lit(do, count, texels, right, up, size, (red, green, blue), ahead))

    return vector()(look_up)


def _look_up_each(count: int) -> Any:
    def look_up_each(
        do: Any,
        texels: Array,
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
        red: int,
        green: int,
        blue: int,
        out: Array,
        slot: int,
    ) -> None:
        """Write them down where each has a size of its own; the texture's are in the table from ``first`` on."""
        ways = (inverse, inverse_x, inverse_y), (u, u_x, u_y), (v, v_x, v_y)
        seen = _seen(do, do.steps(count), count, least, *ways)
        number = _fitting(do, count, seen, *ways, wide, high, last)
        offset, both = do.pairs(table, do.fixed(first, count) + number + number)
        size = [offset, both & 0xFFFF, both >> 16]
        do.store(out, slot, _lit(do, count, texels, *seen[1:], size, (red, green, blue)))

    return vector()(look_up_each)


def _lit(
    do: Any,
    count: int,
    texels: Array,
    right: Any,
    up: Any,
    size: Sequence[Any],
    light: tuple[Any, Any, Any],
    ahead: Any = None,
) -> Any:
    offset, width, height = size
    # half a texel less, for texels are known at their middles; one more, for the ring around them
    x = do.cut((right - do.floor(right)) * (do.short(width) * 256.0)) + 128
    y = do.cut((up - do.floor(up)) * (do.short(height) * 256.0)) + 128
    row = width + 2
    at = offset + (x >> 8) + (y >> 8) * row
    right, up = x & 255, y & 255
    a, b = do.pairs(texels, at)
    c, d = do.pairs(texels, at + row)
    if ahead is not None:
        do.fetch(texels, at, ahead)
    share = do.halves(right | right << 16), do.halves(up | up << 16)
    others = [do.halves(each & _OTHERS) for each in (a, b, c, d)]
    greens = [do.halves(each) >> 8 for each in (a, b, c, d)]
    red, green, blue = light
    two = _under(do, count, _between(others, *share), _pair(red >> 8, blue >> 8), _pair(red & 255, blue & 255))
    one = _under(do, count, _between(greens, *share), green >> 8, green & 255)
    return do.wholes(two >> 8) | (do.wholes(one) & 0xFF00)


def _between(corners: Sequence[Any], right: Any, up: Any) -> Any:
    """Blend four numbers of 8 bits by how far a place is right and up from the first, in 1/256; 0 to 65280."""
    a, b, c, d = corners
    left = 256 - right
    low, high = (a * left + b * right + 128) >> 8, (c * left + d * right + 128) >> 8
    return low * (256 - up) + high * up


def _pair(low: Any, high: Any) -> Any:
    return low | high << 16


def _under(do: Any, count: int, channel: Any, light: Any, more_light: Any) -> Any:
    """A channel of 0 to 65280 under a light of 1/256 and one of 1/65536, times 256, rounded."""
    light, more_light = (do.halves(do.fixed(each, count)) for each in (light, more_light))
    channel = (channel + 128) >> 8
    return channel * light + ((channel * more_light) >> 8) + 128


look_up_8, look_up_16 = _look_up(8), _look_up(16)
look_up_each_8, look_up_each_16 = _look_up_each(8), _look_up_each(16)


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
