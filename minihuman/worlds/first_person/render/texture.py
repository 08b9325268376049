"""Looking up textures as OpenGL does: four texels of one size and four of the next, blended by where a place lies.

Lookups wait in a strip until there are enough of them, for the blending goes fastest over many at once. A strip is one
array of unsigned 32-bit integers, ``STRIP`` lookups wide; each of its rows holds one number of every lookup.
"""

import numpy as np
from numpy import uint32 as u32
from numpy import uint64 as index
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.tables import F64, I64
from minihuman.worlds.kernels import part

U32 = NDArray[np.uint32]

STRIP = 128
STRIP_ROWS = 17
# Of the nearer size: where its first texel is, how many make a row, and how far the place is from it, in 1/256; then
# the same of the next size, and how much that one counts, in 1/256.
_AT, _ROW, _RIGHT, _UP = 0, STRIP, 2 * STRIP, 3 * STRIP
_FAR = 4 * STRIP
_PART = 8 * STRIP
_TEXELS, _FAR_TEXELS = 9 * STRIP, 13 * STRIP  # four rows each, once they are fetched
# What comes out, 0 to 65280 each: red, with blue in the upper half, and green.
RED_BLUE, GREEN = _TEXELS, _TEXELS + STRIP

# Unsigned numbers stay unsigned and 32 bits wide only among their like; as an index, they cannot count from the end.
_8, _128, _255, _256 = u32(8), u32(128), u32(255), u32(256)
_LANES, _HALVES = u32(0x00FF00FF), u32(0x00800080)
_EXPONENT, _BIAS = 52, 1023  # a double's bits from 52 up are its power of two, plus 1023


@part(lean=True, into_caller=True)
def size_for(bits: int, last: int) -> tuple[int, int]:
    """Which size of a texture will do where it moves by a step from pixel to pixel, and how much the next one counts.

    The step, in texels, comes as the bits of a double; ``last`` is the smallest size. The part is out of 256. Where the
    texture moves by two texels, half the size will do, and halfway from one power of two to the next, so do both.
    """
    power = (bits >> _EXPONENT) - _BIAS
    part = (bits >> (_EXPONENT - 8)) & 255
    return min(max(power, 0), last), part if 0 <= power < last else 0


@part(lean=True, into_caller=True)
def aim(strip: U32, slot: int, u: float, v: float, offset: int, width: int, height: int) -> None:
    """Say which texels the lookup in a slot is about: a place (0 to 1 right and up) on one size of a texture."""
    # half a texel less, for texels are known at their middles; one more, for the ring around them
    x = u32(u32(np.int32(u * (256.0 * width))) + _128)
    y = u32(u32(np.int32(v * (256.0 * height))) + _128)
    row = u32(width + 2)
    strip[index(_AT + slot)] = u32(u32(u32(offset) + u32(x >> _8)) + u32(u32(y >> _8) * row))
    strip[index(_ROW + slot)] = row
    strip[index(_RIGHT + slot)] = u32(x & _255)
    strip[index(_UP + slot)] = u32(y & _255)


@part(lean=True, into_caller=True)
def ask(
    strip: U32, slot: int, places: F64, bits: I64, odd: int, count: int, sizes: I64, texture: int, last: int
) -> None:
    """Put ``count`` lookups of a texture into a strip, from ``slot`` on.

    ``places`` holds where in the texture each lies, 0 to 1: ``STRIP`` numbers for right, then as many for up. ``bits``
    says for each two of them, but for one where the first is ``odd``, by how much the texture moves, see ``size_for``.
    """
    done = block = 0
    level, part = size_for(bits[0], last)
    while done < count:
        end, size = done, level
        while level == size:
            strip[index(_PART + slot + end)] = u32(part)
            block += 1
            end = min(2 * block - odd, count)
            strip[index(_PART + slot + end - 1)] = u32(part)
            if end == count:
                break
            level, part = size_for(bits[index(block)], last)
        offset, width, height = sizes[texture, size, 0], sizes[texture, size, 1], sizes[texture, size, 2]
        size = min(size + 1, last)
        far_offset, far_width, far_height = sizes[texture, size, 0], sizes[texture, size, 1], sizes[texture, size, 2]
        for i in range(done, end):
            u, v = places[index(i)], places[index(STRIP + i)]
            aim(strip, slot + i, u, v, offset, width, height)
            aim(strip, _FAR + slot + i, u, v, far_offset, far_width, far_height)
        done = end


@part(lean=True, into_caller=True)
def fetch(strip: U32, texels: U32, count: int) -> None:
    """Copy the texels that ``count`` lookups are about into the strip."""
    for i in range(count):
        for far in range(2):
            at, row = index(strip[index(far * _FAR + _AT + i)]), index(strip[index(far * _FAR + _ROW + i)])
            to = (_FAR_TEXELS if far else _TEXELS) + i
            strip[index(to)] = texels[at]
            strip[index(to + STRIP)] = texels[at + index(1)]
            strip[index(to + 2 * STRIP)] = texels[at + row]
            strip[index(to + 3 * STRIP)] = texels[at + row + index(1)]


@part(lean=True, into_caller=True)
def mix(a: u32, b: u32, part: u32) -> u32:
    """The one where ``part`` is 0, the other where it is 256; one or two channels, 16 bits each."""
    return u32(u32(a * u32(_256 - part)) + u32(b * part))


@part(lean=True, into_caller=True)
def rounded(two: u32) -> u32:
    """Two channels of 16 bits, back to 8 bits each."""
    return u32(u32(u32(two + _HALVES) >> _8) & _LANES)


@part(lean=True, into_caller=True)
def bilinear(a: u32, b: u32, c: u32, d: u32, right: u32, up: u32) -> u32:
    """Two channels, 8 bits each 16 bits apart, of four texels in a square."""
    low = mix(u32(a & _LANES), u32(b & _LANES), right)
    high = mix(u32(c & _LANES), u32(d & _LANES), right)
    return u32(mix(rounded(low), rounded(high), up))


@part(lean=True, into_caller=True)
def blend(strip: U32, count: int) -> None:
    """Turn what was fetched into colours."""
    for i in range(count):
        a, b = strip[_TEXELS + i], strip[_TEXELS + STRIP + i]
        c, d = strip[_TEXELS + 2 * STRIP + i], strip[_TEXELS + 3 * STRIP + i]
        right, up = strip[_RIGHT + i], strip[_UP + i]
        red_blue = bilinear(a, b, c, d, right, up)
        green = bilinear(u32(a >> _8), u32(b >> _8), u32(c >> _8), u32(d >> _8), right, up)
        a, b = strip[_FAR_TEXELS + i], strip[_FAR_TEXELS + STRIP + i]
        c, d = strip[_FAR_TEXELS + 2 * STRIP + i], strip[_FAR_TEXELS + 3 * STRIP + i]
        right, up = strip[_FAR + _RIGHT + i], strip[_FAR + _UP + i]
        far_red_blue = bilinear(a, b, c, d, right, up)
        far_green = bilinear(u32(a >> _8), u32(b >> _8), u32(c >> _8), u32(d >> _8), right, up)
        part = strip[_PART + i]
        both_red_blue = mix(rounded(red_blue), rounded(far_red_blue), part)
        both_green = mix(rounded(green), rounded(far_green), part)
        strip[RED_BLUE + i] = both_red_blue if part else red_blue
        strip[GREEN + i] = both_green if part else green
