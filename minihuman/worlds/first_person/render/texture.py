"""Looking up a texture as OpenGL does: four texels of one size and four of the next, blended by where a place lies.

Texels are blended three channels at a time, 16 bits each in one 64-bit integer.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.tables import F64, I64

LANES = 0x000000FF00FF00FF  # red in bits 0 to 7, blue from 16, green from 32
HALVES = 0x0000008000800080
FULL = 0x0000FF00FF00FF00  # white
SHRINK = np.array([0.5**level for level in range(12)])  # of each size of a texture
GROW = np.array([2.0**level for level in range(1, 13)])


@njit(cache=True, nogil=True, error_model="numpy")
def bilinear(texels: NDArray[np.uint32], offset: int, stride: int, width: float, height: float, u: float, v: float) -> Any:
    """The blend of the four texels around a place (0 to 1 right and up), each channel 0 to 65280.

    ``width`` and ``height`` are in 1/256 texel.
    """
    x: Any = np.int64(u * width) - 128
    y: Any = np.int64(v * height) - 128
    fx = x & 255
    fy = y & 255
    at = offset + (y >> 8) * stride + (x >> 8)
    # unsigned, for a negative index would count from the end, and checking that takes time
    a, b = np.int64(texels[np.uint64(at)]), np.int64(texels[np.uint64(at + 1)])
    c, d = np.int64(texels[np.uint64(at + stride)]), np.int64(texels[np.uint64(at + stride + 1)])
    a, b = (a | (a << 24)) & LANES, (b | (b << 24)) & LANES
    c, d = (c | (c << 24)) & LANES, (d | (d << 24)) & LANES
    low = (((a << 8) + (b - a) * fx + HALVES) >> 8) & LANES
    high = (((c << 8) + (d - c) * fx + HALVES) >> 8) & LANES
    return (low << 8) + (high - low) * fy


@njit(cache=True, nogil=True, error_model="numpy")
def look_up(
    texels: NDArray[np.uint32], sizes: I64, texture: int, last: int, steps: F64, us: F64, vs: F64, odd: int, count: int, lanes: I64
) -> None:
    """The colours of ``count`` pixels side by side, each channel 0 to 65280, into ``lanes``.

    ``us`` and ``vs`` say where in the texture each lies (0 to 1 right and up). ``steps`` says for each two of them, but
    for one where the first pixel is ``odd``, by how many texels the texture moves from pixel to pixel: where it moves
    by two, half the size will do.
    """
    level = part = 0
    offset = stride = far_offset = far_stride = 0
    width = height = far_width = far_height = 0.0
    for i in range(count):
        if i == 0 or (i + odd) & 1 == 0:
            step = steps[(i + odd) >> 1]
            while level < last and step >= GROW[level]:
                level += 1
            while level > 0 and step < GROW[level - 1]:
                level -= 1
            part = 0
            offset, stride = sizes[texture, level, 0], sizes[texture, level, 1] + 2
            width, height = 256.0 * sizes[texture, level, 1], 256.0 * sizes[texture, level, 2]
            if level < last:
                part = int((step * SHRINK[level] - 1.0) * 256.0)
                far_offset, far_stride = sizes[texture, level + 1, 0], sizes[texture, level + 1, 1] + 2
                far_width, far_height = 256.0 * sizes[texture, level + 1, 1], 256.0 * sizes[texture, level + 1, 2]
        u, v = us[i], vs[i]
        near = bilinear(texels, offset, stride, width, height, u, v)
        if part > 0:
            near = ((near + HALVES) >> 8) & LANES
            far = bilinear(texels, far_offset, far_stride, far_width, far_height, u, v)
            far = ((far + HALVES) >> 8) & LANES
            near = (near << 8) + (far - near) * part
        lanes[i] = near
