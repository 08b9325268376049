"""Shading: from covered samples to colours.

Each face in a pixel is textured and lit once, and weighted by its samples. Samples without a face get the sky's colour.
"""

import numpy as np
from numpy import uint64 as index
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.draw_buffers import (
    FRAGMENT_GROUPS,
    LIGHTS,
    LINE,
    MAX_FRAGMENT_GROUPS,
    PLACES,
    SIZES,
    SPANS,
    TAPS,
    drawn_in,
    occluders_of,
)
from minihuman.worlds.first_person.render.kernel_tables import AROUND, BEGIN, END, F64, FACE, I32, DrawBuffers
from minihuman.worlds.first_person.render.rasterisation import BOTTOM, LEAST, LOOK, SKY, TOP
from minihuman.worlds.first_person.render.texture import (
    BLOCK,
    DOWN,
    LANES,
    MOST_SIZES,
    ONE,
    SCANLINE_BUFFER,
    TAP,
    U32,
    WHITE,
    copy,
    darken,
    fill,
    fit,
    light,
    look_up_2,
    look_up_4,
    look_up_8,
    look_up_16,
    occlude,
    pack,
    place,
    place_each,
    shade,
)
from minihuman.worlds.kernels import device_function, int64, kernel

# The columns of a fragment group, adjacent pixels in each of which a face covers the same number of samples (WEIGHT).
# RUN is -1 for a face of one colour.
OF = 0  # the face
START = 1
COUNT = 2
RUN = 3
WEIGHT = 4
# More columns of a run, adjacent pixels at which a face's texture is looked up: one past its last pixel, and the index
# of its first one in the scanline.
STOP = 2
SLOT = 3
MOST_MIXED = 16  # the maximum number of adjacent pixels in a group of pixels that several faces cover alike
MOST_LOOKUPS = SCANLINE_BUFFER - 4 * (MOST_MIXED + LANES)  # with more lookups, they are done before the next group
AHEAD = 8.0  # rows further down, whose texels are prefetched
MOST_APART = 2  # if the sizes that fit at both ends of sixteen pixels differ by more, each pixel has its own size
FULL = 65535  # full light, in 1/65536: the missing part changes no rounded colour
# the distance up to which a joint of two faces darkens them, and a thing the floor, as a multiple of the thing's radius
JOINT_M = 0.8
CONTACT = 2.0
BELOW = 0.3  # the part of the square of that distance within which the floor is as dark as at a joint
RED_BLUE = 0xFF00FF
GREEN = 0x00FF00


@device_function(nogil=True, force_inline=True)
def plain_colour(planes: F64, face: int) -> int:
    """Return the colour, 0x00BBGGRR, of an evenly lit face without a texture."""
    plane = planes[face]
    return int(plane[12] * 255.0 + 0.5) | int(plane[15] * 255.0 + 0.5) << 8 | int(plane[18] * 255.0 + 0.5) << 16


@device_function(nogil=True, force_inline=True)
def span_at(buffers: DrawBuffers, row: int, k: int, x: int, width: int) -> tuple[int, int, int]:
    """Return the face at pixel ``x`` of a sample row (-1: sky), its end, and the next span; ``k`` is that so far."""
    spans = buffers.spans
    if k == buffers.counts[index(row)]:
        return -1, width, k
    if spans[index(row), index(k), BEGIN] > x:
        return -1, int(spans[index(row), index(k), BEGIN]), k
    return int(spans[index(row), index(k), FACE]), int(spans[index(row), index(k), END]), k + 1


@device_function(nogil=True, force_inline=True)
def place_run(
    run: I32, y: int, plane: F64, texture: int, table: U32, texels: U32, least: float, display: bool, memory: U32
) -> None:
    """Compute the texture positions of the pixels in a run of a row, if the face has a texture."""
    sizes = memory[SIZES:]
    places = memory[PLACES:]
    moves = memory[SIZES + LANES :].view(np.float32)
    count = int64(run[STOP] - run[START])
    slot = int64(run[SLOT])
    px = run[START] + 0.5
    py = y + 0.5
    inverse_x = plane[3]
    inverse_y = plane[4]
    inverse = inverse_x * px + (inverse_y * py + plane[5])
    if texture >= 0:
        u = plane[6] * px + (plane[7] * py + plane[8])
        v = plane[9] * px + (plane[10] * py + plane[11])
        # whole repeats are taken away where the face is nearest: there its texels are largest
        span = float(count - 1) if inverse_x > 0.0 else 0.0
        near = max(inverse + inverse_x * span, least)
        whole_u = np.floor((u + plane[6] * span) / near)
        whole_v = np.floor((v + plane[9] * span) / near)
        u = u - whole_u * inverse
        u_x = plane[6] - whole_u * inverse_x
        u_y = plane[7] - whole_u * inverse_y
        v = v - whole_v * inverse
        v_x = plane[9] - whole_v * inverse_x
        v_y = plane[10] - whole_v * inverse_y
        first = 2 * MOST_SIZES * texture
        wide = float(table[first + 1] & 0xFFFF)
        high = float(table[first + 1] >> 16)
        last = int64(table[first + 2 * MOST_SIZES - 1])
        pixels_right = float(y & 3)  # only every fourth pixel's are asked for, so others from row to row
        for begin in range(0, count, BLOCK):
            end = min(begin + BLOCK, count)
            fit(
                sizes,
                inverse + inverse_x * begin,
                inverse_x,
                inverse_y,
                u + u_x * begin,
                u_x,
                u_y,
                v + v_x * begin,
                v_x,
                v_y,
                wide,
                high,
                least,
                count - 1.0 - begin,
                last,
                pixels_right,
                AHEAD,
            )
            for i in range(begin, end, LANES):
                k = index((i - begin) // LANES)
                size = int64(sizes[k])
                next_size = int64(sizes[k + index(1)])
                taps = tap_flags = int64(1)
                if display:
                    size = int64(sizes[k + index(3 * LANES)])
                    next_size = int64(sizes[k + index(3 * LANES + 1)])
                    tap_flags = int64(sizes[k + index(4 * LANES)])
                    taps = max(tap_flags & 7, int64(sizes[k + index(4 * LANES + 1)]) & 7)
                    memory[index(TAPS + (slot + i) // LANES)] = taps
                if display or abs(size - next_size) <= MOST_APART:
                    at = first + ((size + next_size) & -2)
                    extents = int64(table[at + 1])
                    width = extents & 0xFFFF
                    height = extents >> 16
                    ahead = int(moves[k] * width) + int(moves[k + index(LANES)] * height) * (width + 2)
                    for tap in range(taps):
                        by = (tap + 0.5) / taps - 0.5
                        right, below = (i + 0.0, by) if tap_flags & DOWN else (i + by, 0.0)
                        place(
                            places,
                            4 * (slot + i) + TAP * tap,
                            table[at],
                            width,
                            height,
                            inverse + inverse_x * right + inverse_y * below,
                            inverse_x,
                            u + u_x * right + u_y * below,
                            u_x,
                            v + v_x * right + v_y * below,
                            v_x,
                            least,
                            texels,
                            ahead,
                        )
                else:
                    place_each(
                        places,
                        4 * (slot + i),
                        table,
                        first,
                        last,
                        inverse + inverse_x * i,
                        inverse_x,
                        inverse_y,
                        u + u_x * i,
                        u_x,
                        u_y,
                        v + v_x * i,
                        v_x,
                        v_y,
                        wide,
                        high,
                        least,
                    )


@device_function(nogil=True, force_inline=True)
def look_up_run(
    run: I32, y: int, plane: F64, texture: int, even: bool, texels: U32, least: float, display: bool, memory: U32
) -> None:
    """Compute the colours of the pixels in a run, whose texture positions `place_run` has computed."""
    scanline = memory
    lights = memory[LIGHTS:]
    places = memory[PLACES:]
    count = int64(run[STOP] - run[START])
    slot = int64(run[SLOT])
    if texture < 0:
        for i in range(0, count, LANES):
            fill(scanline, slot + i, WHITE)
    else:
        red = FULL
        green = FULL
        blue = FULL
        if even:
            red = min(int(plane[12] * 65536.0 + 0.5), FULL)
            green = min(int(plane[15] * 65536.0 + 0.5), FULL)
            blue = min(int(plane[18] * 65536.0 + 0.5), FULL)
        light(lights, red, green, blue)
        for i in range(slot, slot + count if display else slot, LANES):
            taps = int64(memory[index(TAPS + i // LANES)])
            light(lights, red // taps, green // taps, blue // taps)
            if taps == 1:
                look_up_16(texels, places, 4 * i, lights, scanline, i)
            elif taps == 2:
                look_up_2(texels, places, 4 * i, lights, scanline, i)
            else:
                look_up_4(texels, places, 4 * i, lights, scanline, i)
        for i in range(slot, slot if display else slot + count - 8, LANES):
            look_up_16(texels, places, 4 * i, lights, scanline, i)
        if 0 < count % LANES <= 8 and not display:
            i = slot + (count & -LANES)
            look_up_8(texels, places, 4 * i, lights, scanline, i)
    if not even:
        px = run[START] + 0.5
        py = y + 0.5
        inverse_x = plane[3]
        inverse = inverse_x * px + (plane[4] * py + plane[5])
        red = plane[12] * px + (plane[13] * py + plane[14])
        green = plane[15] * px + (plane[16] * py + plane[17])
        blue = plane[18] * px + (plane[19] * py + plane[20])
        for i in range(0, count, LANES):
            shade(
                scanline,
                slot + i,
                inverse + inverse_x * i,
                inverse_x,
                least,
                red + plane[12] * i,
                plane[12],
                green + plane[15] * i,
                plane[15],
                blue + plane[18] * i,
                plane[18],
            )


@device_function(nogil=True)
def shade_run(run: I32, y: int, plane: F64, segments: F64, things: F64, places: F64, least: float, memory: U32) -> None:
    """Darken a run of a room's face by distance and at joints with other faces, and a floor around entities on it."""
    count = int64(run[STOP] - run[START])
    slot = int64(run[SLOT])
    px = run[START] + 0.5
    py = y + 0.5
    near = memory[PLACES:].view(np.float32)
    at = 4 * slot
    known = segments.shape[0]
    last = count - 1.0
    inverse = plane[3] * px + (plane[4] * py + plane[5])
    inverse_x = plane[3]
    for i in range(0, count, LANES):
        fill(memory[PLACES:], at + i, ONE)
    closest = 1.0 / max(inverse, least)
    farthest = 1.0 / max(inverse + inverse_x * last, least)
    for k in range(known + (places.shape[0] if segments[0, 7] == 1.0 else 0)):
        thing = max(k - known, 0)
        segment = segments[min(k, known - 1)]
        x, z, right, up, length = segment[0], segment[1], segment[2], segment[3], segment[4]
        reach = JOINT_M
        inner = 0.0
        if k >= known:
            x = places[thing, 0]
            z = places[thing, 2]
            right = 1.0
            up = 0.0
            length = 0.0
            inner = BELOW
            reach = CONTACT * things[thing, AROUND] if places[thing, 1] == 0.0 else 0.0
        u = segment[5] * (plane[6] * px + (plane[7] * py + plane[8])) - x * inverse
        u_x = segment[5] * plane[6]
        v = segment[6] * (plane[9] * px + (plane[10] * py + plane[11])) - z * inverse
        v_x = segment[6] * plane[9]
        u_x = u_x - x * inverse_x
        v_x = v_x - z * inverse_x
        along = right * u + up * v
        along_x = right * u_x + up * v_x
        aside = right * v - up * u
        aside_x = right * v_x - up * u_x
        ends = (
            along * closest,
            (along + along_x * last) * farthest,
            aside * closest,
            (aside + aside_x * last) * farthest,
        )
        if max(ends[0], ends[1]) < -reach or min(ends[0], ends[1]) > length + reach:
            continue
        if not (max(ends[2], ends[3]) > -reach and min(ends[2], ends[3]) < reach):
            continue
        for i in range(0, count, LANES):
            occlude(
                near,
                at + i,
                inverse + inverse_x * i,
                inverse_x,
                along + along_x * i,
                along_x,
                aside + aside_x * i,
                aside_x,
                length,
                (1.0 + inner) / (reach * reach),
                inner,
                least,
            )
    for i in range(0, count, LANES):
        darken(memory, slot + i, near, at + i, inverse + inverse_x * i, inverse_x, least)


@device_function(
    nogil=True, force_inline=True, k=int64, j=int64, covered=int64, red_blue=int64, green=int64, colour=int64
)
def paint_row(
    groups: I32, group_count: int, runs: I32, scanline: U32, buffers: DrawBuffers, sky: int, line: U32
) -> None:
    """Compose the colours of the pixels in a row from some fragment groups."""
    planes = buffers.planes
    k = 0
    while k < group_count:
        start = int64(groups[k, START])
        count = int64(groups[k, COUNT])
        if groups[k, WEIGHT] == 4:
            face = int64(groups[k, OF])
            run = int64(groups[k, RUN])
            if run >= 0:
                slot = int64(runs[run, SLOT] + start - runs[run, START])
                for i in range(0, count, LANES):
                    copy(line, start + i, scanline, slot + i)
            else:
                colour = sky if face < 0 else plain_colour(planes, face)
                for i in range(0, count, LANES):
                    fill(line, start + i, colour)
            k += 1
            continue
        for x in range(start, start + count):
            covered = 0
            j = k
            red_blue = green = 2
            red_blue = 0x20002  # half of 4 in each channel, so that the quotient by 4 is rounded
            green = 0x00200
            while covered < 4:
                face = int64(groups[j, OF])
                run = int64(groups[j, RUN])
                weight = int64(groups[j, WEIGHT])
                if run >= 0:
                    colour = int64(scanline[index(runs[run, SLOT] + x - runs[run, START])])
                else:
                    colour = sky if face < 0 else plain_colour(planes, face)
                red_blue += weight * (colour & RED_BLUE)
                green += weight * (colour & GREEN)
                covered += weight
                j += 1
            line[index(x)] = np.uint32((red_blue >> 2 & RED_BLUE) | (green >> 2 & GREEN))
        covered = 0
        while covered < 4:
            covered += groups[k, WEIGHT]
            k += 1


@kernel(
    "(uint32[::1], uint32[::1], float64[::1], int32[::1], float64[:, ::1], float64[:, ::1], float64[::1], "
    "float64[::1], int32[::1], uint8[:, :, ::1])",
    nogil=True,
    run_count=int64,
    group_count=int64,
    x=int64,
    lookups=int64,
    weight=int64,
    run=int64,
)
def colour(
    texels: U32,
    table: U32,
    room_floats: F64,
    room_wholes: I32,
    things: F64,
    places: F64,
    view: F64,
    floats: F64,
    wholes: I32,
    picture: NDArray[np.uint8],
) -> None:
    """Compute the colour of every pixel; a face is textured along a row wherever it covers a sample of a pixel."""
    buffers, _, _ = drawn_in(view, floats, wholes)
    first_occluder, occluders = occluders_of(room_floats, room_wholes)
    planes = buffers.planes
    kind = buffers.kind
    latest = buffers.run
    scanline = wholes[:FRAGMENT_GROUPS].view(np.uint32)
    rows = wholes[FRAGMENT_GROUPS:LINE].reshape(2 * MAX_FRAGMENT_GROUPS + 4, 5)
    groups = rows[:MAX_FRAGMENT_GROUPS]
    runs = rows[MAX_FRAGMENT_GROUPS : 2 * MAX_FRAGMENT_GROUPS]
    now = rows[2 * MAX_FRAGMENT_GROUPS :]  # for each sample row of a pixel row: the result of `span_at`
    line = wholes[LINE:SPANS].view(np.uint32)
    least = view[LEAST]
    display = view[LOOK] == 1.0
    dark = occluders.shape[0] > 0
    sky = int(view[SKY] * 255.0 + 0.5) | int(view[SKY + 1] * 255.0 + 0.5) << 8 | int(view[SKY + 2] * 255.0 + 0.5) << 16
    width = picture.shape[1]
    out = picture.reshape(picture.shape[0] * width * 3)
    for y in range(int(view[TOP]), int(view[BOTTOM])):
        for s in range(4):
            now[s, 0], now[s, 1], now[s, 2] = span_at(buffers, 4 * y + s, int64(0), int64(0), width)
        x = run_count = group_count = lookups = 0
        while x < width:
            face = now[0, 0]
            uniform = now[1, 0] == face and now[2, 0] == face and now[3, 0] == face
            end = min(min(now[0, 1], now[1, 1]), min(now[2, 1], now[3, 1]))
            if not uniform:
                end = min(end, x + MOST_MIXED)
            elif face >= 0:
                end = min(end, x + SCANLINE_BUFFER - LANES - lookups)
            for s in range(1 if uniform else 4):
                face = now[s, 0]
                weight = 4 if uniform else 1
                if not uniform:
                    known = False
                    for t in range(s):
                        known = known or now[t, 0] == face
                    if known:
                        continue
                    for t in range(s + 1, 4):
                        if now[t, 0] == face:
                            weight += 1
                run = -1
                if face >= 0 and (kind[face, 0] >= 0 or (kind[face, 1] & 1) == 0):
                    run = int64(latest[face])
                    if 0 <= run < run_count and runs[run, OF] == face and runs[run, STOP] == x:
                        lookups += end - x
                    else:
                        run = run_count
                        latest[face] = run
                        runs[run, OF], runs[run, START] = face, x
                        lookups += end - x + LANES
                        run_count += 1
                    runs[run, STOP] = end
                k = index(group_count)
                groups[k, OF], groups[k, START], groups[k, COUNT] = face, x, end - x
                groups[k, RUN], groups[k, WEIGHT] = run, weight
                group_count += 1
            x = end
            for s in range(4):
                if now[s, 1] == x:
                    now[s, 0], now[s, 1], now[s, 2] = span_at(buffers, 4 * y + s, int64(now[s, 2]), x, width)
            if x == width or lookups > MOST_LOOKUPS or group_count > MAX_FRAGMENT_GROUPS - 4:
                slot = 0
                for r in range(run_count):
                    runs[r, SLOT] = slot
                    face = runs[r, OF]
                    place_run(runs[r], y, planes[face], kind[face, 0], table, texels, least, display, scanline)
                    slot += (runs[r, STOP] - runs[r, START] + LANES - 1) & -LANES
                # a processor waits less for many short chains of instructions than for a few long ones
                for r in range(run_count):
                    face = runs[r, OF]
                    even = (kind[face, 1] & 1) == 1
                    room_face = int64(kind[face, 1] >> 1)
                    look_up_run(runs[r], y, planes[face], kind[face, 0], even, texels, least, display, scanline)
                    if room_face > 0 and dark:
                        segments = occluders[first_occluder[room_face - 1] : first_occluder[room_face]]
                    else:
                        segments = occluders[:0]
                    if segments.shape[0] > 0:
                        shade_run(runs[r], y, planes[face], segments, things, places, least, scanline)
                paint_row(groups, group_count, runs, scanline, buffers, sky, line)
                run_count = group_count = lookups = 0
        packed = width & -LANES
        for i in range(0, packed, LANES):
            pack(line, i, out, 3 * (y * width + i))
        for i in range(packed, width):
            packed_colour = line[index(i)]
            for channel in range(3):
                out[index(3 * (y * width + i) + channel)] = np.uint8(
                    packed_colour >> np.uint32(8 * channel) & np.uint32(255)
                )
