"""From covered samples to colours: each face in a pixel is shaded once, and counts by the samples it covers."""

import numpy as np
from numpy import uint32 as u32
from numpy import uint64 as index
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.tables import F64, I32, I64, Textures
from minihuman.worlds.first_person.render.texture import (
    GREEN,
    RED_BLUE,
    STRIP,
    STRIP_ROWS,
    U32,
    ask,
    blend,
    fetch,
)
from minihuman.worlds.kernels import int64, kernel, part

TAKEN = -2  # a sample whose face has been shaded
WHITE = 65280.0
LOW, HIGH = u32(0xFFFF), u32(16)

# The columns of a stretch: pixels side by side that a face covers, with the same number of samples each.
FACE, START, COUNT, SLOT, WEIGHT = 0, 1, 2, 3, 4  # slot -1 for a face without a texture
MOST_STRETCHES = STRIP + 8


@part(lean=True, into_caller=True)
def texture_place(
    px: float, inverse_x: float, inverse_c: float, u_x: float, u_c: float, v_x: float, v_c: float, least: float
) -> tuple[float, float]:
    """Where in its texture a face is looked up at a place in a row, in repeats right and up."""
    w = 1.0 / max(inverse_x * px + inverse_c, least)
    return (u_x * px + u_c) * w, (v_x * px + v_c) * w


@part(lean=True, into_caller=True)
def prepare(
    planes: F64,
    face: int,
    sizes: I64,
    texture: int,
    last: int,
    y: int,
    start: int,
    count: int,
    least: float,
    scratch: F64,
    bits: I64,
    strip: U32,
    slot: int,
) -> None:
    """Put the lookups for ``count`` pixels of row ``y`` from ``start``, at their middles, into the strip.

    How large a version of the texture is looked up is decided once for each block of two by two pixels, from how far
    the texture moves across the block.
    """
    inverse_x, inverse_y, inverse_1 = planes[face, 3], planes[face, 4], planes[face, 5]
    u_x, u_y, u_1 = planes[face, 6], planes[face, 7], planes[face, 8]
    v_x, v_y, v_1 = planes[face, 9], planes[face, 10], planes[face, 11]
    py = y + 0.5
    inverse_c, u_c, v_c = inverse_y * py + inverse_1, u_y * py + u_1, v_y * py + v_1
    for i in range(count):
        u, v = texture_place((start + i) + 0.5, inverse_x, inverse_c, u_x, u_c, v_x, v_c, least)
        scratch[index(i)] = u - np.floor(u)
        scratch[index(STRIP + i)] = v - np.floor(v)
    wide, high = float(sizes[texture, 0, 1]), float(sizes[texture, 0, 2])
    py = (y | 1) + 0.5
    inverse_c, u_c, v_c = inverse_y * py + inverse_1, u_y * py + u_1, v_y * py + v_1
    first = start & -2
    for i in range((start + count - first + 1) >> 1):
        px = (first + 2 * i) + 0.5
        inverse = inverse_x * px + inverse_c
        u, v = texture_place(px, inverse_x, inverse_c, u_x, u_c, v_x, v_c, least)
        along_x = max(abs(u_x - u * inverse_x) * wide, abs(v_x - v * inverse_x) * high)
        along_y = max(abs(u_y - u * inverse_y) * wide, abs(v_y - v * inverse_y) * high)
        step = max(along_x / max(inverse + inverse_x, least), along_y / max(inverse - inverse_y, least))
        scratch[index(2 * STRIP + i)] = step
    ask(strip, slot, scratch, bits, start - first, count, sizes, texture, last)


@part(lean=True, into_caller=True)
def lit(planes: F64, face: int, px: float, py: float, w: float, channel: int) -> float:
    """How bright a face is at a place in a channel, 0 to 1, over 256; ``w`` is its distance there."""
    k = 12 + 3 * channel
    light = (planes[face, k] * px + planes[face, k + 1] * py + planes[face, k + 2]) * w
    return float(min(max(light, 0.0), 1.0) / 256.0)


@part(lean=True, into_caller=True)
def brightness(planes: F64, even: bool, face: int, px: float, py: float, least: float) -> tuple[float, float, float]:
    """How bright a face is at a place, red, green and blue, 0 to 1, over 256."""
    if even:
        return planes[face, 12] / 256.0, planes[face, 15] / 256.0, planes[face, 18] / 256.0
    w = 1.0 / max(planes[face, 3] * px + (planes[face, 4] * py + planes[face, 5]), least)
    return lit(planes, face, px, py, w, 0), lit(planes, face, px, py, w, 1), lit(planes, face, px, py, w, 2)


@part(lean=True, into_caller=True)
def looked_up(strip: U32, slot: int) -> tuple[float, float, float]:
    """What a lookup found, red, green and blue, 0 to 65280; white where there was none."""
    if slot < 0:
        return WHITE, WHITE, WHITE
    two = strip[index(RED_BLUE + slot)]
    green = strip[index(GREEN + slot)]
    return float(np.int32(two & LOW)), float(np.int32(green)), float(np.int32(two >> HIGH))


@part(lean=True, into_caller=True)
def paint(
    stretches: I64,
    stretch_count: int,
    strip: U32,
    planes: F64,
    kind: I32,
    sky: F64,
    y: int,
    least: float,
    line: NDArray[np.uint8],
) -> None:
    """Colour the pixels of some stretches in a row; their lookups have been blended."""
    py = y + 0.5
    covered = 0
    red_sum = green_sum = blue_sum = 0.0
    for k in range(stretch_count):
        face, start, count = stretches[k, FACE], stretches[k, START], stretches[k, COUNT]
        slot, weight = stretches[k, SLOT], stretches[k, WEIGHT]
        even = True
        if face < 0:
            r, g, b = sky[0] / 256.0, sky[1] / 256.0, sky[2] / 256.0
        else:
            even = kind[face, 1] == 1
            r, g, b = brightness(planes, even, face, start + 0.5, py, least)
        if weight < 4:
            red, green, blue = looked_up(strip, slot)
            red_sum += weight * (red * r)
            green_sum += weight * (green * g)
            blue_sum += weight * (blue * b)
            covered += weight
            if covered == 4:
                line[start, 0] = np.uint8(red_sum * 0.25 + 0.5)
                line[start, 1] = np.uint8(green_sum * 0.25 + 0.5)
                line[start, 2] = np.uint8(blue_sum * 0.25 + 0.5)
                red_sum = green_sum = blue_sum = 0.0
                covered = 0
        elif even and slot < 0:
            red_8, green_8, blue_8 = np.uint8(WHITE * r + 0.5), np.uint8(WHITE * g + 0.5), np.uint8(WHITE * b + 0.5)
            for x in range(start, start + count):
                line[index(x), 0], line[index(x), 1], line[index(x), 2] = red_8, green_8, blue_8
        elif even:
            for i in range(count):
                red, green, blue = looked_up(strip, slot + i)
                at = index(start + i)
                line[at, 0] = np.uint8(red * r + 0.5)
                line[at, 1] = np.uint8(green * g + 0.5)
                line[at, 2] = np.uint8(blue * b + 0.5)
        else:
            for i in range(count):
                r, g, b = brightness(planes, even, face, (start + i) + 0.5, py, least)
                red, green, blue = looked_up(strip, slot + i if slot >= 0 else slot)
                at = index(start + i)
                line[at, 0] = np.uint8(red * r + 0.5)
                line[at, 1] = np.uint8(green * g + 0.5)
                line[at, 2] = np.uint8(blue * b + 0.5)


@kernel(lean=True, slots=int64, stretch_count=int64, done=int64)
def colour(
    owner: I32,
    planes: F64,
    kind: I32,
    texels: U32,
    sizes: I64,
    level_count: I64,
    sky: F64,
    least: float,
    strip: U32,
    scratch: F64,
    bits: I64,
    stretches: I64,
    samples: I32,
    picture: NDArray[np.uint8],
) -> None:
    """What ``resolve`` does, in arrays that it has made; ``bits`` are those of the last third of ``scratch``."""
    width = picture.shape[1]
    for y in range(picture.shape[0]):
        row0, row1, row2, row3 = owner[4 * y], owner[4 * y + 1], owner[4 * y + 2], owner[4 * y + 3]
        line = picture[y]
        done = stretch_count = slots = 0
        while done < width:
            x = done
            samples[0], samples[1], samples[2], samples[3] = row0[x], row1[x], row2[x], row3[x]
            face = samples[0]
            x += 1
            whole = samples[1] == face and samples[2] == face and samples[3] == face
            if whole:
                most = min(width, done + STRIP - slots)
                while x < most:
                    at = index(x)
                    if row0[at] != face or row1[at] != face or row2[at] != face or row3[at] != face:
                        break
                    x += 1
            for s in range(1 if whole else 4):
                face = samples[s]
                if face == TAKEN:
                    continue
                weight = 0
                for t in range(s, 4):
                    if samples[t] == face:
                        weight += 1
                        samples[t] = TAKEN
                texture = -1 if face < 0 else kind[face, 0]
                k = index(stretch_count)
                stretches[k, FACE], stretches[k, START], stretches[k, COUNT] = face, done, x - done
                stretches[k, SLOT], stretches[k, WEIGHT] = slots if texture >= 0 else -1, weight
                stretch_count += 1
                if texture >= 0:
                    last = level_count[texture] - 1
                    prepare(planes, face, sizes, texture, last, y, done, x - done, least, scratch, bits, strip, slots)
                    slots += x - done
            done = x
            if done == width or slots > STRIP - 4 or stretch_count > MOST_STRETCHES - 4:
                fetch(strip, texels, slots)
                blend(strip, (slots + 7) & -8)
                paint(stretches, stretch_count, strip, planes, kind, sky, y, least, line)
                stretch_count = slots = 0


def resolve(
    owner: I32,
    planes: F64,
    kind: I32,
    textures: Textures,
    sky: F64,
    least: float,
    picture: NDArray[np.uint8],
) -> None:
    """Colour every pixel. Where one face covers a pixel whole, so it often does its neighbours: they go together."""
    strip, scratch = np.zeros(STRIP_ROWS * STRIP, np.uint32), np.empty(3 * STRIP)
    bits = scratch[2 * STRIP :].view(np.int64)
    stretches, samples = np.empty((MOST_STRETCHES, 5), np.int64), np.empty(4, np.int32)
    texels, sizes, level_count = textures
    colour(
        owner,
        planes,
        kind,
        texels,
        sizes,
        level_count,
        sky,
        least,
        strip,
        scratch,
        bits,
        stretches,
        samples,
        picture,
    )
