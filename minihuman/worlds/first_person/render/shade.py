"""From covered samples to colours: each face in a pixel is shaded once, and counts by the samples it covers."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.tables import F64, I32, I64
from minihuman.worlds.first_person.render.texture import FULL, look_up

TAKEN = -2  # a sample whose face has been shaded
SHIFT = np.array([0, 32, 16])  # to red, green and blue


@njit(cache=True, nogil=True, error_model="numpy")
def span(
    planes: F64,
    face: int,
    texels: NDArray[np.uint32],
    sizes: I64,
    texture: int,
    last: int,
    y: int,
    start: int,
    count: int,
    least: float,
    scratch: F64,
    lanes: I64,
) -> None:
    """The colours, before light, of a face at the middles of ``count`` pixels of row ``y`` from ``start``, into ``lanes``.

    How large a version of the texture is looked up is decided once for each block of two by two pixels, from how far
    the texture moves across the block.
    """
    us, vs, steps = scratch[0], scratch[1], scratch[2]
    inverse_x, inverse_y = planes[face, 3], planes[face, 4]
    u_x, u_y, v_x, v_y = planes[face, 6], planes[face, 7], planes[face, 9], planes[face, 10]
    py = y + 0.5
    inverse_c = inverse_y * py + planes[face, 5]
    u_c, v_c = u_y * py + planes[face, 8], v_y * py + planes[face, 11]
    for i in range(count):
        px = (start + i) + 0.5
        w = 1.0 / max(inverse_x * px + inverse_c, least)
        u = (u_x * px + u_c) * w
        v = (v_x * px + v_c) * w
        us[i] = u - np.floor(u)
        vs[i] = v - np.floor(v)
    wide, high = float(sizes[texture, 0, 1]), float(sizes[texture, 0, 2])
    py = (y | 1) + 0.5
    inverse_c = inverse_y * py + planes[face, 5]
    u_c, v_c = u_y * py + planes[face, 8], v_y * py + planes[face, 11]
    first = start & -2
    for i in range((start + count - first + 1) >> 1):
        px = (first + 2 * i) + 0.5
        inverse = inverse_x * px + inverse_c
        w = 1.0 / max(inverse, least)
        u = (u_x * px + u_c) * w
        v = (v_x * px + v_c) * w
        along_x = max(abs(u_x - u * inverse_x) * wide, abs(v_x - v * inverse_x) * high)
        along_y = max(abs(u_y - u * inverse_y) * wide, abs(v_y - v * inverse_y) * high)
        steps[i] = max(along_x / max(inverse + inverse_x, least), along_y / max(inverse - inverse_y, least))
    look_up(texels, sizes, texture, last, steps, us, vs, start - first, count, lanes)


@njit(cache=True, nogil=True, error_model="numpy")
def lit(planes: F64, even: bool, face: int, channel: int, px: float, py: float, least: float) -> float:
    """How bright a face is there in a channel, 0 to 1."""
    k = 12 + 3 * channel
    if even:
        return planes[face, k]
    w = 1.0 / max(planes[face, 3] * px + (planes[face, 4] * py + planes[face, 5]), least)
    return min(max((planes[face, k] * px + planes[face, k + 1] * py + planes[face, k + 2]) * w, 0.0), 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def resolve(
    owner: I32,
    planes: F64,
    kind: I32,
    texels: NDArray[np.uint32],
    sizes: I64,
    level_count: I64,
    sky: F64,
    least: float,
    picture: NDArray[np.uint8],
) -> None:
    """Colour every pixel. Where one face covers a pixel whole, so it often does its neighbours: they go together."""
    width = picture.shape[1]
    lanes = np.empty(width, np.int64)
    scratch = np.empty((3, width))
    samples = np.empty(4, np.int32)
    total = np.empty(3)
    for y in range(picture.shape[0]):
        row0, row1, row2, row3 = owner[4 * y], owner[4 * y + 1], owner[4 * y + 2], owner[4 * y + 3]
        line = picture[y]
        py = y + 0.5
        x = 0
        while x < width:
            samples[0], samples[1], samples[2], samples[3] = row0[x], row1[x], row2[x], row3[x]
            face = samples[0]
            start = x
            x += 1
            whole = samples[1] == face and samples[2] == face and samples[3] == face
            while whole and x < width and row0[x] == face and row1[x] == face and row2[x] == face and row3[x] == face:
                x += 1
            count = x - start
            total[:] = 0.0
            for s in range(1 if whole else 4):
                face = samples[s]
                if face == TAKEN:
                    continue
                weight = 0.0
                for t in range(s, 4):
                    if samples[t] == face:
                        weight += 1.0
                        samples[t] = TAKEN
                even = face < 0 or kind[face, 1] == 1
                texture = -1 if face < 0 else kind[face, 0]
                if texture >= 0:
                    last = level_count[texture] - 1
                    span(planes, face, texels, sizes, texture, last, y, start, count, least, scratch, lanes)
                else:
                    for i in range(count):
                        lanes[i] = FULL
                for channel in range(3):
                    bright = sky[channel] if face < 0 else lit(planes, even, face, channel, start + 0.5, py, least)
                    shift = SHIFT[channel]
                    if not whole:
                        total[channel] += weight * (((lanes[0] >> shift) & 0xFFFF) * (bright / 256.0))
                    elif even:
                        bright /= 256.0
                        for i in range(count):
                            line[start + i, channel] = np.uint8(((lanes[i] >> shift) & 0xFFFF) * bright + 0.5)
                    else:
                        for i in range(count):
                            bright = lit(planes, even, face, channel, (start + i) + 0.5, py, least)
                            line[start + i, channel] = np.uint8(((lanes[i] >> shift) & 0xFFFF) * (bright / 256.0) + 0.5)
            if not whole:
                for channel in range(3):
                    line[start, channel] = np.uint8(total[channel] * 0.25 + 0.5)
