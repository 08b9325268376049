"""From covered samples to colours: textures filtered as OpenGL's software driver does, four samples averaged.

Texels are blended three channels at a time, 16 bits each in one 64-bit integer.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.tables import F64, Drawn, Textures

LANES = 0x000000FF00FF00FF  # red in bits 0 to 7, blue from 16, green from 32
HALVES = 0x0000008000800080
SHARPNESS = 3.5 / (2.0 * 1.4142135623730951)


@njit(cache=True, nogil=True)
def spread(texel: int) -> int:
    """Make room between the three channels of a texel."""
    wide = np.int64(texel)
    return (wide | (wide << 24)) & LANES


@njit(cache=True, nogil=True)
def bilinear(textures: Textures, texture: int, level: int, u: float, v: float) -> int:
    """The blend of the four texels around a place (0 to 1 right and up), each channel 0 to 65280."""
    offset = textures.levels[texture, level, 0]
    width = textures.levels[texture, level, 1]
    height = textures.levels[texture, level, 2]
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
    texels = textures.texels
    low = spread(texels[row + i]) * (256 - fx) + spread(texels[row + right]) * fx
    high = spread(texels[next_row + i]) * (256 - fx) + spread(texels[next_row + right]) * fx
    low = ((low + HALVES) >> 8) & LANES
    high = ((high + HALVES) >> 8) & LANES
    return low * (256 - fy) + high * fy


@njit(cache=True, nogil=True)
def trilinear(textures: Textures, texture: int, u: float, v: float, footprint: float) -> int:
    """The texture at a place, from the two sizes that fit a pixel's footprint in texels; channels 0 to 65280."""
    u -= np.floor(u)
    v -= np.floor(v)
    level = 0
    footprint *= SHARPNESS
    last = textures.level_count[texture] - 1
    while footprint >= 2.0 and level < last:
        footprint *= 0.5
        level += 1
    near = bilinear(textures, texture, level, u, v)
    part = np.int64((2.0 * footprint - 3.0) * 256.0)
    if part <= 0 or level == last:
        return near
    far = bilinear(textures, texture, level + 1, u, v)
    near = ((near + HALVES) >> 8) & LANES
    far = ((far + HALVES) >> 8) & LANES
    return near * (256 - part) + far * part


@njit(cache=True, nogil=True)
def footprint(textures: Textures, planes: F64, face: int, texture: int, x: int, y: int, least: float) -> float:
    """How many texels the texture moves from a pixel to the next, right or down, at the pixel's block of four."""
    px = (x & -2) + 0.5
    py = (y | 1) + 0.5
    inverse = planes[face, 3] * px + planes[face, 4] * py + planes[face, 5]
    w = 1.0 / max(inverse, least)
    u = (planes[face, 6] * px + planes[face, 7] * py + planes[face, 8]) * w
    v = (planes[face, 9] * px + planes[face, 10] * py + planes[face, 11]) * w
    right = 1.0 / max(inverse + planes[face, 3], least)
    up = 1.0 / max(inverse - planes[face, 4], least)
    wide = textures.levels[texture, 0, 1]
    high = textures.levels[texture, 0, 2]
    along_x = max(abs(planes[face, 6] - u * planes[face, 3]) * wide, abs(planes[face, 9] - v * planes[face, 3]) * high)
    along_y = max(abs(planes[face, 7] - u * planes[face, 4]) * wide, abs(planes[face, 10] - v * planes[face, 4]) * high)
    return max(along_x * right, along_y * up)


@njit(cache=True, nogil=True)
def shade(drawn: Drawn, textures: Textures, face: int, x: int, y: int, least: float, colour: F64) -> None:
    """The colour (0 to 255 a channel) of a face at the middle of a pixel, into ``colour``."""
    planes = drawn.planes
    px = x + 0.5
    py = y + 0.5
    inverse = planes[face, 3] * px + planes[face, 4] * py + planes[face, 5]
    w = 1.0 / max(inverse, least)
    texture = drawn.kind[face, 0]
    red = green = blue = 65280
    if texture >= 0:
        u = (planes[face, 6] * px + planes[face, 7] * py + planes[face, 8]) * w
        v = (planes[face, 9] * px + planes[face, 10] * py + planes[face, 11]) * w
        lanes = trilinear(textures, texture, u, v, footprint(textures, planes, face, texture, x, y, least))
        red = lanes & 0xFFFF
        blue = (lanes >> 16) & 0xFFFF
        green = lanes >> 32
    if drawn.kind[face, 1] == 1:
        colour[0] = red * planes[face, 12] * 0.00390625
        colour[1] = green * planes[face, 15] * 0.00390625
        colour[2] = blue * planes[face, 18] * 0.00390625
    else:
        for channel in range(3):
            k = 12 + 3 * channel
            lit = (planes[face, k] * px + planes[face, k + 1] * py + planes[face, k + 2]) * w
            lanes = red if channel == 0 else (green if channel == 1 else blue)
            colour[channel] = lanes * min(max(lit, 0.0), 1.0) * 0.00390625


@njit(cache=True, nogil=True)
def resolve(drawn: Drawn, textures: Textures, sky: F64, least: float, picture: NDArray[np.uint8]) -> None:
    """Colour every pixel: each face in it is shaded once and counts by the samples it covers."""
    height, width = picture.shape[0], picture.shape[1]
    owner = drawn.owner
    colour = np.empty(3)
    total = np.empty(3)
    four = np.empty(4, np.int32)
    for y in range(height):
        for x in range(width):
            first = owner[4 * y, x]
            four[0] = first
            four[1] = owner[4 * y + 1, x]
            four[2] = owner[4 * y + 2, x]
            four[3] = owner[4 * y + 3, x]
            if first >= 0 and four[1] == first and four[2] == first and four[3] == first:
                shade(drawn, textures, first, x, y, least, colour)
                for channel in range(3):
                    picture[y, x, channel] = np.uint8(colour[channel] + 0.5)
                continue
            total[0] = total[1] = total[2] = 0.0
            for s in range(4):
                face = four[s]
                if face == -2:
                    continue
                weight = 0
                for t in range(s, 4):
                    if four[t] == face:
                        weight += 1
                        four[t] = -2
                if face == -1:
                    for channel in range(3):
                        total[channel] += weight * sky[channel] * 255.0
                else:
                    shade(drawn, textures, face, x, y, least, colour)
                    for channel in range(3):
                        total[channel] += weight * colour[channel]
            for channel in range(3):
                picture[y, x, channel] = np.uint8(total[channel] * 0.25 + 0.5)
