"""Rasterisation: from a face in space to the samples that it covers on the picture.

Light, perspective, cuts at the near plane; then coverage of four samples per pixel at the places that OpenGL drivers
agree on. Corners lie on a grid of 1/256 pixel and stay below 2**23 of it, so every product of coverage is a whole
number below 2**53 and exact in a double: two faces that share an edge never both cover a sample, and never both leave
it out. What has been claimed stands in each sample row as a list of spans from left to right, which do not overlap.
"""

from typing import Any

import numpy as np
from numpy import uint64 as index  # which cannot count from the end

from minihuman.worlds.first_person.render.kernel_tables import BEGIN, END, F64, FACE, SHADE, DrawBuffers, FaceTable
from minihuman.worlds.kernels import device_function, int64
from minihuman.worlds.simd import Array, simd_function

SAMPLE_X = np.array([160.0, 32.0, 224.0, 96.0])  # of the four sample rows of a pixel, in 1/256 pixel from its left
ROW_STEP = 64.0  # between sample rows, in 1/256 pixel; the first is half a step down


@simd_function()
def cross(
    ops: Any,
    side: Array,
    row: int,
    first: float,
    last: float,
    xa: float,
    ya: float,
    width: float,
    height: float,
    low: float,
    high: float,
) -> None:
    """Where an edge crosses eight sample rows from ``row``, a multiple of 4, of those from ``first`` to ``last``."""
    rows = ops.count_from(row, 8, 1)
    right = ops.all_of(xa, 8) - ops.these([160.0, 32.0, 224.0, 96.0] * 2)
    down = rows * ROW_STEP + 32.0 - ops.all_of(ya, 8)
    high_by = ops.all_of(height, 8)
    bound = ops.ceil((right * high_by + ops.all_of(width, 8) * down) / (high_by * 256.0))
    bound = ops.cut(ops.smaller(ops.larger(bound, ops.all_of(low, 8)), ops.all_of(high, 8)))
    crossed = (rows > ops.all_of(first, 8) - 1.0) & (rows < ops.all_of(last, 8))
    ops.store(side, row, ops.where(crossed, bound, ops.load(side, row, 8)))


@device_function(nogil=True, force_inline=True)
def outline(drawn: DrawBuffers, corner_count: int, window: F64) -> tuple[int, int]:
    """Where the samples inside a face's corners and the window begin and end in each sample row.

    ``window`` is x0, y0, x1, y1 in whole pixels. Edges that run through a sample belong to the face on their right or,
    if level, above: the rule of OpenGL's pictures turned upside down.

    Returns the first sample row that has any, and one past the last; the same twice if none has.
    """
    left, right, screen = drawn.left, drawn.right, drawn.screen
    low = screen[0, 1]
    high = low
    for i in range(1, corner_count):
        low, high = min(low, screen[i, 1]), max(high, screen[i, 1])
    first = int(max(np.floor((low - 32.0) / ROW_STEP), window[1] * 4.0))
    last = int(min(np.floor((high - 32.0) / ROW_STEP) + 1.0, window[3] * 4.0))
    for row in range(first, last):
        left[index(row)], right[index(row)] = int(window[2]), int(window[0])
    for i in range(corner_count):
        j = i + 1 if i + 1 < corner_count else 0
        xa, ya, xb, yb = screen[i, 0], screen[i, 1], screen[j, 0], screen[j, 1]
        if ya == yb:
            continue
        leftward = yb > ya
        if not leftward:
            xa, ya, xb, yb = xb, yb, xa, ya
        top = max(np.floor((ya - 32.0) / ROW_STEP) + 1.0, float(first))
        end = min(np.floor((yb - 32.0) / ROW_STEP) + 1.0, float(last))
        for row in range(int(top) & -4, int(end), 8):
            if leftward:
                cross(left, row, top, end, xa, ya, xb - xa, yb - ya, window[0], window[2])
            else:
                cross(right, row, top, end, xa, ya, xb - xa, yb - ya, window[0], window[2])
    while first < last and left[index(first)] >= right[index(first)]:
        first += 1
    while first < last and left[index(last - 1)] >= right[index(last - 1)]:
        last -= 1
    return first, last


@device_function(nogil=True, force_inline=True)
def put(drawn: DrawBuffers, row: int, at: int, begin: int, end: int, face: int) -> None:
    """Write a span down."""
    span = drawn.spans[index(row), index(at)]
    span[BEGIN], span[END], span[FACE] = begin, end, face


@device_function(nogil=True, force_inline=True)
def shift(drawn: DrawBuffers, row: int, first: int, last: int, by: int) -> None:
    """Move some spans of a row to the right, or to the left."""
    spans = drawn.spans
    for i in range(last - first):
        k = last - 1 - i if by > 0 else first + i
        for column in range(3):
            spans[index(row), index(k + by), column] = spans[index(row), index(k), column]


@device_function(nogil=True, force_inline=True)
def add(merged: Any, count: int, begin: int, end: int, face: int) -> int:
    """Add a span to those that replace some, or let the last one grow; how many there are."""
    if count > 0 and merged[count - 1, FACE] == face and merged[count - 1, END] == begin:
        merged[count - 1, END] = end
        return count
    merged[count, BEGIN], merged[count, END], merged[count, FACE] = begin, end, face
    return count + 1


@device_function(nogil=True, got=int64, merged_count=int64, x=int64, j=int64)
def share(drawn: DrawBuffers, face: int, row: int, k: int, begin: int, end: int) -> int:
    """Claim the samples of a row from ``begin`` to ``end`` where others own some, from the row's span ``k`` on.

    Returns how many it got; -1 where the row has no room for more spans.
    """
    spans, planes, merged, count = drawn.spans[row], drawn.planes, drawn.merged, drawn.counts[row]
    y, shifted = (ROW_STEP * row + 32.0) / 256.0, SAMPLE_X[row & 3] / 256.0
    a, here = planes[face, 0], planes[face, 1] * y + planes[face, 2]
    got = merged_count = 0
    x, j = begin, k
    while j < count and spans[j, BEGIN] < end:
        rival = int64(spans[j, FACE])
        rival_begin, rival_end = int64(spans[j, BEGIN]), int64(spans[j, END])
        if x < rival_begin:
            merged_count = add(merged, merged_count, x, rival_begin, face)
            got += rival_begin - x
            x = rival_begin
        elif rival_begin < x:
            merged_count = add(merged, merged_count, rival_begin, x, rival)
        stop = min(rival_end, end)
        rival_a, there = planes[rival, 0], planes[rival, 1] * y + planes[rival, 2]
        low, high = x, stop - 1
        wins = a * (low + shifted) + here > rival_a * (low + shifted) + there
        if wins != (a * (high + shifted) + here > rival_a * (high + shifted) + there):
            while high - low > 1:  # they cross in between
                middle = (low + high) >> 1
                if wins == (a * (middle + shifted) + here > rival_a * (middle + shifted) + there):
                    low = middle
                else:
                    high = middle
            merged_count = add(merged, merged_count, x, high, face if wins else rival)
            got += high - x if wins else stop - high
            merged_count = add(merged, merged_count, high, stop, rival if wins else face)
        else:
            merged_count = add(merged, merged_count, x, stop, face if wins else rival)
            got += stop - x if wins else 0
        if stop < rival_end:
            merged_count = add(merged, merged_count, stop, rival_end, rival)
        x = stop
        j += 1
    if x < end:
        merged_count = add(merged, merged_count, x, end, face)
        got += end - x
    if got > 0:
        more = merged_count - (j - k)
        if count + more > spans.shape[0]:
            return -1
        if more != 0:
            shift(drawn, row, j, int64(count), more)
        for i in range(merged_count):
            put(drawn, row, k + i, int64(merged[i, BEGIN]), int64(merged[i, END]), int64(merged[i, FACE]))
        drawn.counts[row] = count + more
    return got


@device_function(nogil=True, force_inline=True)
def loses(planes: F64, face: int, rival: int, row: int, begin: int, end: int) -> bool:
    """Is ``rival`` at least as near as ``face`` at every sample of a row from ``begin`` to ``end``?"""
    y, shifted = (ROW_STEP * row + 32.0) / 256.0, SAMPLE_X[row & 3] / 256.0
    a, here = planes[face, 0], planes[face, 1] * y + planes[face, 2]
    rival_a, there = planes[rival, 0], planes[rival, 1] * y + planes[rival, 2]
    first, last = begin + shifted, end - 1 + shifted
    return not (a * first + here > rival_a * first + there or a * last + here > rival_a * last + there)


@device_function(nogil=True, force_inline=True, claimed=int64, k=int64, begin=int64, end=int64)
def claim(drawn: DrawBuffers, face: int, first: int, last: int, only: int) -> int:
    """Claim for ``face`` the samples of its outline that nothing nearer owns.

    If ``only`` is 0 to 3, it has one sample of each pixel.

    Returns how many it got; -1 where a row has no room for more spans, and then what is claimed is not complete.
    """
    spans, counts, left, right, planes = drawn.spans, drawn.counts, drawn.left, drawn.right, drawn.planes
    claimed = k = 0
    for row in range(first, last):
        begin, end = int64(left[index(row)]), int64(right[index(row)])
        if begin >= end or (only >= 0 and row & 3 != only):  # corners are rounded: a sliver may be crossed
            continue
        count = counts[index(row)]
        k = min(k, count)  # where it was in the row above is not far
        while k < count and spans[index(row), index(k), END] <= begin:
            k += 1
        while k > 0 and spans[index(row), index(k - 1), END] > begin:
            k -= 1
        # most of what is taken already is behind one or two faces that are nearer all along
        while k < count and begin < end and spans[index(row), index(k), BEGIN] <= begin:
            stop = min(int64(spans[index(row), index(k), END]), end)
            if not loses(planes, face, spans[index(row), index(k), FACE], row, begin, stop):
                break
            begin = stop
            k += 1
        if k < count and begin < spans[index(row), index(k), BEGIN] < end <= spans[index(row), index(k), END]:
            start = int64(spans[index(row), index(k), BEGIN])
            if loses(planes, face, spans[index(row), index(k), FACE], row, start, end):
                end = start
        if begin >= end:
            continue
        if k == count or spans[index(row), index(k), BEGIN] >= end:
            if count == spans.shape[1]:
                return -1
            shift(drawn, row, k, int64(count), int64(1))
            put(drawn, row, k, begin, end, face)
            counts[index(row)] = count + 1
            claimed += end - begin
        else:
            got = share(drawn, face, row, k, begin, end)
            if got < 0:
                return -1
            claimed += got
    return claimed


# The columns of a view's array: what the kernels know of a camera.
EYE, RIGHT, UP, FORWARD = 0, 3, 6, 9  # three numbers each
FOCAL_X, FOCAL_Y, CENTRE_X, CENTRE_Y = 12, 13, 14, 15  # pixels; pixels a metre where nothing shrinks with distance
NEAR, FAR, PARALLEL = 16, 17, 18  # metres, metres, 1.0 for a view from above
LIGHT, SKY = 19, 28  # the way to the light, its colour and the ambient light; the sky's colour; three numbers each
LEAST = 31  # of 1 / distance: beyond a face's edge it may reach nonsense
TOP, BOTTOM, HEIGHT, WIDTH = 32, 33, 34, 35  # which rows to draw, and the whole picture, pixels
ROOM = 36  # how many spans of a row, faces and corners of a face there is memory for, three numbers
LOOK = 39  # 1.0 for the look of a display
VIEW_SIZE = 40

TILES = 16  # across the picture and down, in which is known how near what was drawn is at least
GUARD_PX = 16384.0  # corners stay within this of the picture's middle, so that their products are exact

# The columns of a placement's array: how a thing's own coordinates lie in the world.
PLACE, COS, SIN, SCALE, NORMAL_SCALE, TINT = 0, 3, 4, 5, 8, 9
OWN_EYE, OWN_LIGHT = 12, 16  # the eye, and 1.0 where it is a place and not a direction; the way to the light
PLACEMENT_SIZE = 19


@device_function(nogil=True, force_inline=True)
def cut(corners: F64, source: int, count: int, a: float, b: float, c: float, d: float) -> int:
    """Keep the part of polygon ``source`` where a*x + b*y + c*z + d >= 0; how many corners it has.

    It goes into row 2 if the source is row 1, else into row 1. Row 0 is never written to: how a face varies is computed
    from its corners before all cuts.
    """
    into = 2 if source == 1 else 1
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here = a * corners[source, i, 0] + b * corners[source, i, 1] + c * corners[source, i, 2] + d
        there = a * corners[source, j, 0] + b * corners[source, j, 1] + c * corners[source, j, 2] + d
        if here >= 0.0:
            for k in range(3):
                corners[into, kept, k] = corners[source, i, k]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            # from the inner end to the outer one, so that both faces of an edge are cut at the same point
            if here >= 0.0:
                part = here / (here - there)
                for k in range(3):
                    corners[into, kept, k] = corners[source, i, k] + part * (
                        corners[source, j, k] - corners[source, i, k]
                    )
            else:
                part = there / (there - here)
                for k in range(3):
                    corners[into, kept, k] = corners[source, j, k] + part * (
                        corners[source, i, k] - corners[source, j, k]
                    )
            kept += 1
    return kept


@device_function(nogil=True, force_inline=True)
def turn_to(view: F64, light: F64, placement: F64) -> None:
    """Work out where a thing's eye and light are, in the thing's own coordinates, from where it is and how it lies."""
    co, si = placement[COS], placement[SIN]
    if view[PARALLEL] == 1.0:
        ex, ey, ez = -view[FORWARD], -view[FORWARD + 1], -view[FORWARD + 2]
    else:
        at = placement[PLACE : PLACE + 3]
        ex, ey, ez = view[EYE] - at[0], view[EYE + 1] - at[1], view[EYE + 2] - at[2]
    placement[OWN_EYE] = (co * ex - si * ez) / placement[SCALE]
    placement[OWN_EYE + 1] = ey / placement[SCALE + 1]
    placement[OWN_EYE + 2] = (si * ex + co * ez) / placement[SCALE + 2]
    placement[OWN_EYE + 3] = 1.0 - view[PARALLEL]
    placement[OWN_LIGHT] = co * light[0] - si * light[2]
    placement[OWN_LIGHT + 1] = light[1]
    placement[OWN_LIGHT + 2] = si * light[0] + co * light[2]


@device_function(nogil=True, force_inline=True, current=int64)
def draw_face(
    faces: FaceTable,
    face: int,
    view: F64,
    placement: F64,
    light: F64,
    window: F64,
    drawn: DrawBuffers,
    number: int,
    surveyed: bool,
) -> int:
    """Draw one face as number ``number``; how many samples it claimed: if none, the number is still free.

    It is -1 where a row has no room for more spans.

    ``light`` holds the direction to the light, its colour, and the ambient light, three numbers each. Where what was
    drawn before is ``surveyed``, a face that is sure to be behind it is left out at once.
    """
    # Seen from behind?
    side = faces.plane
    above = side[face, 0] * placement[OWN_EYE] + side[face, 1] * placement[OWN_EYE + 1]
    if above + side[face, 2] * placement[OWN_EYE + 2] + side[face, 3] * placement[OWN_EYE + 3] <= 0.0:
        return 0

    parallel, co, si = view[PARALLEL] == 1.0, placement[COS], placement[SIN]
    sx, sy, sz = placement[SCALE], placement[SCALE + 1], placement[SCALE + 2]
    start = faces.start[face]
    count = faces.start[face + 1] - start
    corners, screen, near = drawn.corners, drawn.screen, view[NEAR]
    ahead = 0
    # all read before anything is written, for a compiler cannot know that the tables do not overlap
    eye_x, eye_y, eye_z = view[EYE], view[EYE + 1], view[EYE + 2]
    right_x, right_y, right_z = view[RIGHT], view[RIGHT + 1], view[RIGHT + 2]
    up_x, up_y, up_z = view[UP], view[UP + 1], view[UP + 2]
    forward_x, forward_y, forward_z = view[FORWARD], view[FORWARD + 1], view[FORWARD + 2]
    at_x, at_y, at_z = placement[PLACE], placement[PLACE + 1], placement[PLACE + 2]
    for i in range(count):
        corner = faces.position[start + i]
        px, py, pz = corner[0] * sx, corner[1] * sy, corner[2] * sz
        wx, wy, wz = at_x + (co * px + si * pz) - eye_x, at_y + py - eye_y, at_z + (co * pz - si * px) - eye_z
        ahead_by = forward_x * wx + forward_y * wy + forward_z * wz
        corners[0, i, 0] = right_x * wx + right_y * wy + right_z * wz
        corners[0, i, 1] = up_x * wx + up_y * wy + up_z * wz
        corners[0, i, 2] = ahead_by
        if ahead_by >= near:
            ahead += 1
    if ahead == 0 and not parallel:
        return 0

    current = 0
    if ahead < count and not parallel:
        count = cut(corners, current, count, 0.0, 0.0, 1.0, -near)
        current = 1
    if not parallel:
        limit_x, limit_y = GUARD_PX / view[FOCAL_X], GUARD_PX / view[FOCAL_Y]
        wide = False
        for i in range(count):
            z = corners[current, i, 2]
            wide = wide or abs(corners[current, i, 0]) > limit_x * z or abs(corners[current, i, 1]) > limit_y * z
        if wide:
            for end in range(4):
                a, b = (1.0, 0.0) if end < 2 else (0.0, 1.0)
                sign = 1.0 - 2.0 * (end & 1)
                count = cut(corners, current, count, sign * a, sign * b, limit_x if end < 2 else limit_y, 0.0)
                current = 2 if current == 1 else 1
    if count < 3:
        return 0
    x0 = x1 = y0 = y1 = 0.0
    for i in range(count):
        shrink = 1.0 if parallel else 1.0 / corners[current, i, 2]
        x = np.floor((view[CENTRE_X] + view[FOCAL_X] * corners[current, i, 0] * shrink) * 256.0 + 0.5)
        y = np.floor((view[CENTRE_Y] - view[FOCAL_Y] * corners[current, i, 1] * shrink) * 256.0 + 0.5)
        screen[i, 0], screen[i, 1] = x, y
        x0, x1, y0, y1 = (x, x, y, y) if i == 0 else (min(x0, x), max(x1, x), min(y0, y), max(y1, y))
    if x1 <= window[0] * 256.0 or x0 >= window[2] * 256.0 or y1 <= window[1] * 256.0 or y0 >= window[3] * 256.0:
        return 0
    if not nearness(faces, face, view, drawn, number):
        return 0
    if surveyed and hidden(drawn, number, view, window, x0, y0, x1, y1):
        return 0
    first, last = outline(drawn, count, window)
    if first == last:
        return 0
    samples = int(claim(drawn, number, first, last, SHADE - faces.texture[face]))
    if samples > 0:
        vary(faces, face, view, placement, light, drawn, number)
    return samples


@device_function(nogil=True, force_inline=True)
def tile_size(view: F64) -> tuple[int, int]:
    """How many pixels a tile is wide, and how many sample rows high."""
    return int(view[WIDTH]) // TILES + 1, 4 * int(view[HEIGHT]) // TILES + 1


@device_function(nogil=True, force_inline=True)
def hidden(drawn: DrawBuffers, number: int, view: F64, window: F64, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Is a face sure to be behind what was drawn before, wherever its corners, in 1/256 pixel, let it have samples?"""
    planes, tiles = drawn.planes, drawn.tiles
    left, right = max(int(x0 / 256.0), int(window[0])), min(int(x1 / 256.0) + 1, int(window[2]))
    top, bottom = max(int(y0 / ROW_STEP), 4 * int(window[1])), min(int(y1 / ROW_STEP) + 1, 4 * int(window[3]))
    a, b = planes[number, 0], planes[number, 1]
    # rounding keeps the order, so no sample is nearer
    row = bottom if b > 0.0 else top
    nearest = a * (right if a > 0.0 else left) + (b * (row * ROW_STEP / 256.0) + planes[number, 2])
    wide, high = tile_size(view)
    for row in range(top // high, (bottom - 1) // high + 1):
        for column in range(left // wide, (right - 1) // wide + 1):
            if nearest > tiles[row, column]:
                return False
    return True


@device_function(nogil=True, force_inline=True)
def nearness(faces: FaceTable, face: int, view: F64, drawn: DrawBuffers, number: int) -> bool:
    """Work out how nearness varies over the picture; False where the face is seen edge-on.

    Three corners, not yet cut, say how; the inverse of the matrix of their positions holds it, and all else that varies
    evenly over a flat face.
    """
    count, p, inverse = faces.start[face + 1] - faces.start[face], drawn.corners[0], drawn.inverse
    i1, i2 = count // 3, (2 * count) // 3
    parallel = view[PARALLEL] == 1.0
    x0, y0, x1, y1, x2, y2 = p[0, 0], p[0, 1], p[i1, 0], p[i1, 1], p[i2, 0], p[i2, 1]
    z0, z1, z2 = (1.0, 1.0, 1.0) if parallel else (p[0, 2], p[i1, 2], p[i2, 2])
    ax, ay, az = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
    bx, by, bz = y2 * z0 - z2 * y0, z2 * x0 - x2 * z0, x2 * y0 - y2 * x0
    cx, cy, cz = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
    determinant = x0 * ax + y0 * ay + z0 * az
    if abs(determinant) < 1e-12:
        return False
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = ax, bx, cx
    inverse[1, 0], inverse[1, 1], inverse[1, 2] = ay, by, cy
    inverse[2, 0], inverse[2, 1], inverse[2, 2] = az, bz, cz
    inverse[3, 0] = 1.0 / (determinant * view[FOCAL_X])
    inverse[3, 1] = 1.0 / (determinant * view[FOCAL_Y])
    inverse[3, 2] = 1.0 / determinant
    v0, v1, v2 = (-p[0, 2], -p[i1, 2], -p[i2, 2]) if parallel else (1.0, 1.0, 1.0)
    plane(drawn, view, number, int64(0), v0, v1, v2)
    return True


@device_function(nogil=True, force_inline=True)
def plane(drawn: DrawBuffers, view: F64, number: int, column: int, first: float, second: float, third: float) -> None:
    """Write down how a value varies over the picture, given what it is at the three corners."""
    inverse, planes = drawn.inverse, drawn.planes
    gx = (first * inverse[0, 0] + second * inverse[0, 1] + third * inverse[0, 2]) * inverse[3, 0]
    gy = (first * inverse[1, 0] + second * inverse[1, 1] + third * inverse[1, 2]) * inverse[3, 1]
    gz = (first * inverse[2, 0] + second * inverse[2, 1] + third * inverse[2, 2]) * inverse[3, 2]
    planes[number, 3 * column], planes[number, 3 * column + 1] = gx, -gy
    planes[number, 3 * column + 2] = gz - gx * view[CENTRE_X] + gy * view[CENTRE_Y]


@device_function(nogil=True, force_inline=True)
def vary(faces: FaceTable, face: int, view: F64, placement: F64, light: F64, drawn: DrawBuffers, number: int) -> None:
    """Work out how texture and light vary over the picture, divided by distance."""
    start = faces.start[face]
    count = faces.start[face + 1] - start
    planes, kind, lit, long = drawn.planes, drawn.kind, drawn.lit, placement[NORMAL_SCALE]
    same = True
    lx, ly, lz = placement[OWN_LIGHT], placement[OWN_LIGHT + 1], placement[OWN_LIGHT + 2]
    for k in range(3):
        corner, normal = start + (k * count) // 3, faces.normal
        facing = long * (normal[corner, 0] * lx + normal[corner, 1] * ly + normal[corner, 2] * lz)
        for channel in range(3):
            bright = light[6 + channel] + light[3 + channel] * max(facing, 0.0)
            lit[channel, k] = min(faces.colour[face, channel] * placement[TINT + channel] * bright, 1.0)
            same = same and lit[channel, k] == lit[channel, 0]
    kind[number, 0], kind[number, 1] = faces.texture[face], 1 if same else 0
    c0, c1, c2 = start, start + count // 3, start + (2 * count) // 3
    place = faces.texture_place
    for column in range(1, 7):
        if column == 1:
            v0 = v1 = v2 = 1.0
        elif column < 4:
            v0, v1, v2 = place[c0, column - 2], place[c1, column - 2], place[c2, column - 2]
        else:
            v0, v1, v2 = lit[column - 4, 0], lit[column - 4, 1], lit[column - 4, 2]
            if same:
                planes[number, 3 * column] = v0
                continue
        plane(drawn, view, number, column, v0, v1, v2)
