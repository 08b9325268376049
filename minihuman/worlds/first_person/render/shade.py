"""From covered samples to colours: textures filtered as OpenGL's software driver does, four samples averaged.

Texels are blended three channels at a time, 16 bits each in one 64-bit integer.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.tables import F64, I32, I64

LANES = 0x000000FF00FF00FF  # red in bits 0 to 7, blue from 16, green from 32
HALVES = 0x0000008000800080


@njit(cache=True, nogil=True, error_model="numpy")
def bilinear(texels: NDArray[np.uint32], offset: int, width: int, height: int, u: float, v: float) -> int:
    """The blend of the four texels around a place (0 to 1 right and up), each channel 0 to 65280."""
    x = np.int64(u * (width * 256)) - 128
    y = np.int64(v * (height * 256)) - 128
    i = x >> 8
    j = y >> 8
    fx = x & 255
    fy = y & 255
    right = i + 1 if i + 1 < width else 0
    above = j + 1 if j + 1 < height else 0
    if i < 0:
        i = width - 1
    if j < 0:
        j = height - 1
    row = offset + j * width
    next_row = offset + above * width
    a, b = np.int64(texels[row + i]), np.int64(texels[row + right])
    c, d = np.int64(texels[next_row + i]), np.int64(texels[next_row + right])
    low = ((a | (a << 24)) & LANES) * (256 - fx) + ((b | (b << 24)) & LANES) * fx
    high = ((c | (c << 24)) & LANES) * (256 - fx) + ((d | (d << 24)) & LANES) * fx
    low = ((low + HALVES) >> 8) & LANES
    high = ((high + HALVES) >> 8) & LANES
    return low * (256 - fy) + high * fy


@njit(cache=True, nogil=True, error_model="numpy")
def trilinear(
    texels: NDArray[np.uint32], levels: I64, level_count: I64, texture: int, u: float, v: float, footprint: float
) -> int:
    """The texture at a place, from the two sizes that fit a pixel's footprint in texels; channels 0 to 65280."""
    u -= np.floor(u)
    v -= np.floor(v)
    level = 0
    last = level_count[texture] - 1
    while footprint >= 2.0 and level < last:
        footprint *= 0.5
        level += 1
    near = bilinear(texels, levels[texture, level, 0], levels[texture, level, 1], levels[texture, level, 2], u, v)
    part = np.int64((footprint - 1.0) * 256.0)
    if part <= 0 or level == last:
        return near
    level += 1
    far = bilinear(texels, levels[texture, level, 0], levels[texture, level, 1], levels[texture, level, 2], u, v)
    near = ((near + HALVES) >> 8) & LANES
    far = ((far + HALVES) >> 8) & LANES
    return near * (256 - part) + far * part


@njit(cache=True, nogil=True, error_model="numpy")
def reach(planes: F64, face: int, wide: int, high: int, x: int, y: int, least: float) -> float:
    """How many texels the texture moves from a pixel to the next, right or up, at the pixel's block of four."""
    px = (x & -2) + 0.5
    py = (y | 1) + 0.5
    inverse = planes[face, 3] * px + planes[face, 4] * py + planes[face, 5]
    w = 1.0 / max(inverse, least)
    u = (planes[face, 6] * px + planes[face, 7] * py + planes[face, 8]) * w
    v = (planes[face, 9] * px + planes[face, 10] * py + planes[face, 11]) * w
    along_x = max(abs(planes[face, 6] - u * planes[face, 3]) * wide, abs(planes[face, 9] - v * planes[face, 3]) * high)
    along_y = max(abs(planes[face, 7] - u * planes[face, 4]) * wide, abs(planes[face, 10] - v * planes[face, 4]) * high)
    return max(along_x / max(inverse + planes[face, 3], least), along_y / max(inverse - planes[face, 4], least))


@njit(cache=True, nogil=True, error_model="numpy")
def shade(
    planes: F64,
    kind: I32,
    texels: NDArray[np.uint32],
    levels: I64,
    level_count: I64,
    face: int,
    x: int,
    y: int,
    least: float,
) -> tuple[float, float, float]:
    """Red, green and blue (0 to 255) of a face at the middle of a pixel."""
    px = x + 0.5
    py = y + 0.5
    w = 1.0 / max(planes[face, 3] * px + planes[face, 4] * py + planes[face, 5], least)
    texture = kind[face, 0]
    red = green = blue = 65280
    if texture >= 0:
        u = (planes[face, 6] * px + planes[face, 7] * py + planes[face, 8]) * w
        v = (planes[face, 9] * px + planes[face, 10] * py + planes[face, 11]) * w
        footprint = reach(planes, face, levels[texture, 0, 1], levels[texture, 0, 2], x, y, least)
        lanes = trilinear(texels, levels, level_count, texture, u, v, footprint)
        red = lanes & 0xFFFF
        blue = (lanes >> 16) & 0xFFFF
        green = lanes >> 32
    lit_red, lit_green, lit_blue = planes[face, 12], planes[face, 15], planes[face, 18]
    if kind[face, 1] == 0:
        lit_red = min(max((lit_red * px + planes[face, 13] * py + planes[face, 14]) * w, 0.0), 1.0)
        lit_green = min(max((lit_green * px + planes[face, 16] * py + planes[face, 17]) * w, 0.0), 1.0)
        lit_blue = min(max((lit_blue * px + planes[face, 19] * py + planes[face, 20]) * w, 0.0), 1.0)
    return red * lit_red / 256.0, green * lit_green / 256.0, blue * lit_blue / 256.0


@njit(cache=True, nogil=True, error_model="numpy")
def resolve(
    owner: I32,
    planes: F64,
    kind: I32,
    texels: NDArray[np.uint32],
    levels: I64,
    level_count: I64,
    sky: F64,
    least: float,
    picture: NDArray[np.uint8],
) -> None:
    """Colour every pixel: each face in it is shaded once and counts by the samples it covers."""
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            first = owner[4 * y, x]
            second, third, fourth = owner[4 * y + 1, x], owner[4 * y + 2, x], owner[4 * y + 3, x]
            left = 4  # samples whose face has not been shaded yet
            total_red = total_green = total_blue = 0.0
            face = first
            while left > 0:
                weight = 0
                following = -2
                for s in range(4):
                    sample = first if s == 0 else (second if s == 1 else (third if s == 2 else fourth))
                    if sample == face:
                        weight += 1
                    elif sample != -2 and following == -2:
                        following = sample
                first = -2 if first == face else first
                second = -2 if second == face else second
                third = -2 if third == face else third
                fourth = -2 if fourth == face else fourth
                if face < 0:
                    red, green, blue = sky[0] * 255.0, sky[1] * 255.0, sky[2] * 255.0
                else:
                    red, green, blue = shade(planes, kind, texels, levels, level_count, face, x, y, least)
                total_red += weight * red
                total_green += weight * green
                total_blue += weight * blue
                left -= weight
                face = following
            picture[y, x, 0] = np.uint8(total_red * 0.25 + 0.5)
            picture[y, x, 1] = np.uint8(total_green * 0.25 + 0.5)
            picture[y, x, 2] = np.uint8(total_blue * 0.25 + 0.5)
