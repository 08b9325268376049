"""From covered samples to colours: textures filtered as OpenGL does, four samples averaged.

Texels are blended three channels at a time, 16 bits each in one 64-bit integer.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.tables import F64, I32, I64

LANES = 0x000000FF00FF00FF  # red in bits 0 to 7, blue from 16, green from 32
HALVES = 0x0000008000800080
TAKEN = -2  # a sample whose face has been shaded


@njit(cache=True, nogil=True, error_model="numpy")
def bilinear(texels: NDArray[np.uint32], offset: int, width: int, height: int, u: float, v: float) -> Any:
    """The blend of the four texels around a place (0 to 1 right and up), each channel 0 to 65280."""
    x: Any = np.int64(u * (width * 256)) - 128
    y: Any = np.int64(v * (height * 256)) - 128
    i: Any = x >> 8
    j: Any = y >> 8
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
def span(
    planes: F64,
    kind: I32,
    texels: NDArray[np.uint32],
    levels: I64,
    level_count: I64,
    face: int,
    y: int,
    start: int,
    end: int,
    least: float,
    colours: F64,
) -> None:
    """The colours (0 to 255) of a face at the middles of pixels ``start`` to ``end`` of row ``y``, into ``colours``.

    How large a version of the texture is looked up is decided once for each block of two by two pixels, from how far
    the texture moves across the block: where it moves by two texels, half the size will do.
    """
    p = planes[face]
    py = y + 0.5
    inverse_x, inverse_c = p[3], p[4] * py + p[5]
    u_x, u_c, v_x, v_c = p[6], p[7] * py + p[8], p[9], p[10] * py + p[11]
    even = kind[face, 1] == 1
    red_lit = p[12] / 256.0 if even else 1.0 / 256.0
    green_lit = p[15] / 256.0 if even else 1.0 / 256.0
    blue_lit = p[18] / 256.0 if even else 1.0 / 256.0
    texture = kind[face, 0]
    if texture < 0:
        for x in range(start, end):
            colours[x, 0] = 65280.0 * red_lit
            colours[x, 1] = 65280.0 * green_lit
            colours[x, 2] = 65280.0 * blue_lit
    else:
        last = level_count[texture] - 1
        wide, high = float(levels[texture, 0, 1]), float(levels[texture, 0, 2])
        block_y = (y | 1) + 0.5
        block_inverse, block_u, block_v = p[4] * block_y + p[5], p[7] * block_y + p[8], p[10] * block_y + p[11]
        level = part = 0
        for x in range(start, end):
            if x == start or x & 1 == 0:
                px = (x & -2) + 0.5
                inverse = inverse_x * px + block_inverse
                w = 1.0 / max(inverse, least)
                u = (u_x * px + block_u) * w
                v = (v_x * px + block_v) * w
                along_x = max(abs(u_x - u * inverse_x) * wide, abs(v_x - v * inverse_x) * high)
                along_y = max(abs(p[7] - u * p[4]) * wide, abs(p[10] - v * p[4]) * high)
                step = max(along_x / max(inverse + inverse_x, least), along_y / max(inverse - p[4], least))
                level = 0
                while step >= 2.0 and level < last:
                    step *= 0.5
                    level += 1
                part = int((step - 1.0) * 256.0) if level < last else 0
            px = x + 0.5
            w = 1.0 / max(inverse_x * px + inverse_c, least)
            u = (u_x * px + u_c) * w
            v = (v_x * px + v_c) * w
            u -= np.floor(u)
            v -= np.floor(v)
            lanes = bilinear(
                texels, levels[texture, level, 0], levels[texture, level, 1], levels[texture, level, 2], u, v
            )
            if part > 0:
                far = bilinear(
                    texels,
                    levels[texture, level + 1, 0],
                    levels[texture, level + 1, 1],
                    levels[texture, level + 1, 2],
                    u,
                    v,
                )
                lanes = ((lanes + HALVES) >> 8) & LANES
                far = ((far + HALVES) >> 8) & LANES
                lanes = lanes * (256 - part) + far * part
            colours[x, 0] = (lanes & 0xFFFF) * red_lit
            colours[x, 1] = (lanes >> 32) * green_lit
            colours[x, 2] = ((lanes >> 16) & 0xFFFF) * blue_lit
    if not even:
        for x in range(start, end):
            px = x + 0.5
            w = 1.0 / max(inverse_x * px + inverse_c, least)
            for channel in range(3):
                k = 12 + 3 * channel
                lit = (p[k] * px + p[k + 1] * py + p[k + 2]) * w
                colours[x, channel] *= min(max(lit, 0.0), 1.0)


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
    width = picture.shape[1]
    colours = np.empty((width, 3))
    four = np.empty(4, np.int32)
    total = np.empty(3)
    for y in range(picture.shape[0]):
        row = 4 * y
        x = 0
        while x < width:
            face = owner[row, x]
            start = x
            while (
                x < width
                and owner[row, x] == face
                and owner[row + 1, x] == face
                and owner[row + 2, x] == face
                and owner[row + 3, x] == face
            ):
                x += 1
            if x > start:
                if face < 0:
                    for i in range(start, x):
                        for channel in range(3):
                            colours[i, channel] = sky[channel] * 255.0
                else:
                    span(planes, kind, texels, levels, level_count, face, y, start, x, least, colours)
            else:
                for s in range(4):
                    four[s] = owner[row + s, x]
                total[:] = 0.0
                for s in range(4):
                    face = four[s]
                    if face == TAKEN:
                        continue
                    weight = 0
                    for t in range(s, 4):
                        if four[t] == face:
                            weight += 1
                            four[t] = TAKEN
                    if face < 0:
                        for channel in range(3):
                            total[channel] += weight * (sky[channel] * 255.0)
                    else:
                        span(planes, kind, texels, levels, level_count, face, y, x, x + 1, least, colours)
                        for channel in range(3):
                            total[channel] += weight * colours[x, channel]
                for channel in range(3):
                    colours[x, channel] = total[channel] * 0.25
                x += 1
        for i in range(width):
            for channel in range(3):
                picture[y, i, channel] = np.uint8(colours[i, channel] + 0.5)
