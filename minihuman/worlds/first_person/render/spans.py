"""Spans: which face owns each sample of the picture, in lists of disjoint spans from left to right.

Corners lie on a grid of 1/256 pixel and below 2**23 of its steps, so every product in coverage is a whole number below
2**53 and exact in a double: of two faces that share an edge, exactly one covers each sample on it.
"""

from typing import Any

import numpy as np
from numpy import uint64 as index  # never negative, so kernels need not handle indices from the end

from minihuman.worlds.first_person.render.kernel_tables import BEGIN, END, F64, FACE, DrawBuffers
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
    """Write to ``side`` where an edge crosses eight sample rows, as pixels from ``low`` to ``high``.

    The rows are those from ``row``, a multiple of 4, which are also from ``first`` to below ``last``. The edge begins
    at (xa, ya) and spans ``width`` and ``height``, in 1/256 pixel.
    """
    rows = ops.count_from(row, 8, 1)
    right = ops.all_of(xa, 8) - ops.these([160.0, 32.0, 224.0, 96.0] * 2)  # `SAMPLE_X` of two rows of pixels
    down = rows * ROW_STEP + 32.0 - ops.all_of(ya, 8)
    high_by = ops.all_of(height, 8)
    bound = ops.ceil((right * high_by + ops.all_of(width, 8) * down) / (high_by * 256.0))
    bound = ops.cut(ops.smaller(ops.larger(bound, ops.all_of(low, 8)), ops.all_of(high, 8)))
    crossed = (rows > ops.all_of(first, 8) - 1.0) & (rows < ops.all_of(last, 8))
    ops.store(side, row, ops.where(crossed, bound, ops.load(side, row, 8)))


@device_function(nogil=True, force_inline=True)
def outline(buffers: DrawBuffers, corner_count: int, window: F64) -> tuple[int, int]:
    """Compute the start and end of the samples inside a face's corners and a window, for each sample row.

    ``window`` is x0, y0, x1, y1 in whole pixels. A sample on an edge belongs to the face on the edge's right or, if the
    edge is level, above it: the rule of OpenGL's pictures turned upside down.

    Returns the first sample row that has any sample, and one past the last; the same number twice if none has.
    """
    left = buffers.left
    right = buffers.right
    screen = buffers.screen
    low = screen[0, 1]
    high = low
    for i in range(1, corner_count):
        low = min(low, screen[i, 1])
        high = max(high, screen[i, 1])
    first = int(max(np.floor((low - 32.0) / ROW_STEP), window[1] * 4.0))
    last = int(min(np.floor((high - 32.0) / ROW_STEP) + 1.0, window[3] * 4.0))
    for row in range(first, last):
        left[index(row)], right[index(row)] = int(window[2]), int(window[0])
    for i in range(corner_count):
        j = i + 1 if i + 1 < corner_count else 0
        xa = screen[i, 0]
        ya = screen[i, 1]
        xb = screen[j, 0]
        yb = screen[j, 1]
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
def put(buffers: DrawBuffers, row: int, at: int, begin: int, end: int, face: int) -> None:
    """Write a span into a row of samples, at index ``at``."""
    span = buffers.spans[index(row), index(at)]
    span[BEGIN], span[END], span[FACE] = begin, end, face


@device_function(nogil=True, force_inline=True)
def shift(buffers: DrawBuffers, row: int, first: int, last: int, by: int) -> None:
    """Move the spans of a row from index ``first`` to below ``last`` by a number of indices, which can be negative."""
    spans = buffers.spans
    for i in range(last - first):
        k = last - 1 - i if by > 0 else first + i
        for column in range(3):
            spans[index(row), index(k + by), column] = spans[index(row), index(k), column]


@device_function(nogil=True, force_inline=True)
def add(merged: Any, count: int, begin: int, end: int, face: int) -> int:
    """Add a span to a list of replacement spans, or extend the last one; return the length of the list."""
    if count > 0 and merged[count - 1, FACE] == face and merged[count - 1, END] == begin:
        merged[count - 1, END] = end
        return count
    merged[count, BEGIN], merged[count, END], merged[count, FACE] = begin, end, face
    return count + 1


@device_function(nogil=True, got=int64, merged_count=int64, x=int64, j=int64)
def share(buffers: DrawBuffers, face: int, row: int, k: int, begin: int, end: int) -> int:
    """Claim a row's samples from ``begin`` to ``end`` for ``face`` where others own some, from the row's span ``k`` on.

    Returns the number of claimed samples; -1 if the row has no room for more spans.
    """
    spans = buffers.spans[row]
    planes = buffers.planes
    merged = buffers.merged
    count = buffers.counts[row]
    y = (ROW_STEP * row + 32.0) / 256.0
    shifted = SAMPLE_X[row & 3] / 256.0
    a = planes[face, 0]
    intercept = planes[face, 1] * y + planes[face, 2]
    got = merged_count = 0
    x = begin
    j = k
    while j < count and spans[j, BEGIN] < end:
        rival = int64(spans[j, FACE])
        rival_begin = int64(spans[j, BEGIN])
        rival_end = int64(spans[j, END])
        if x < rival_begin:
            merged_count = add(merged, merged_count, x, rival_begin, face)
            got += rival_begin - x
            x = rival_begin
        elif rival_begin < x:
            merged_count = add(merged, merged_count, rival_begin, x, rival)
        stop = min(rival_end, end)
        rival_a = planes[rival, 0]
        rival_intercept = planes[rival, 1] * y + planes[rival, 2]
        low = x
        high = stop - 1
        wins = a * (low + shifted) + intercept > rival_a * (low + shifted) + rival_intercept
        if wins != (a * (high + shifted) + intercept > rival_a * (high + shifted) + rival_intercept):
            while high - low > 1:  # they cross in between
                middle = (low + high) >> 1
                if wins == (a * (middle + shifted) + intercept > rival_a * (middle + shifted) + rival_intercept):
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
            shift(buffers, row, j, int64(count), more)
        for i in range(merged_count):
            put(buffers, row, k + i, int64(merged[i, BEGIN]), int64(merged[i, END]), int64(merged[i, FACE]))
        buffers.counts[row] = count + more
    return got


@device_function(nogil=True, force_inline=True)
def loses(planes: F64, face: int, rival: int, row: int, begin: int, end: int) -> bool:
    """Return whether ``rival`` is at least as near as ``face`` at all samples of a row from ``begin`` to ``end``."""
    y = (ROW_STEP * row + 32.0) / 256.0
    shifted = SAMPLE_X[row & 3] / 256.0
    a = planes[face, 0]
    intercept = planes[face, 1] * y + planes[face, 2]
    rival_a = planes[rival, 0]
    rival_intercept = planes[rival, 1] * y + planes[rival, 2]
    first = begin + shifted
    last = end - 1 + shifted
    return not (
        a * first + intercept > rival_a * first + rival_intercept
        or a * last + intercept > rival_a * last + rival_intercept
    )


@device_function(nogil=True, force_inline=True, claimed=int64, k=int64, begin=int64, end=int64)
def claim(buffers: DrawBuffers, face: int, first: int, last: int, only: int) -> int:
    """Claim for ``face`` the samples inside its outline that no nearer face owns.

    If ``only`` is 0 to 3, it claims just that sample of each pixel.

    Returns the number of claimed samples; -1 if a row has no room for more spans, so that the claim is incomplete.
    """
    spans = buffers.spans
    counts = buffers.counts
    left = buffers.left
    right = buffers.right
    planes = buffers.planes
    claimed = k = 0
    for row in range(first, last):
        begin = int64(left[index(row)])
        end = int64(right[index(row)])
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
            shift(buffers, row, k, int64(count), int64(1))
            put(buffers, row, k, begin, end, face)
            counts[index(row)] = count + 1
            claimed += end - begin
        else:
            got = share(buffers, face, row, k, begin, end)
            if got < 0:
                return -1
            claimed += got
    return claimed
