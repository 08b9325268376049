"""Which samples a face covers: four a pixel, at the places OpenGL drivers agree on. Exact integer arithmetic.

Corners lie on a grid of 1/256 pixel and stay below 2**23 of it, so every product here is a whole number below 2**53 and
exact in a double. Two faces that share an edge therefore never both cover a sample, and never both leave it out.
"""

import numpy as np
from numpy import uint64 as index  # which cannot count from the end

from minihuman.worlds.first_person.render.tables import F64, Drawn
from minihuman.worlds.kernels import part

SAMPLE_X = np.array([160.0, 32.0, 224.0, 96.0])  # of the four sample rows of a pixel, in 1/256 pixel from its left
ROW_STEP = 64.0  # between sample rows, in 1/256 pixel; the first is half a step down


@part(lean=True, into_caller=True)
def outline(drawn: Drawn, corner_count: int, window: F64) -> tuple[int, int]:
    """Where the samples inside a face's corners and the window begin and end in each sample row.

    ``window`` is x0, y0, x1, y1 in whole pixels. Edges that run through a sample belong to the face on their right or,
    if level, above: the rule of OpenGL's pictures turned upside down.

    Returns the first sample row that has any, and one past the last; the same twice if none has.
    """
    left, right, screen = drawn.left, drawn.right, drawn.screen
    low = screen[0, 1]
    high = low
    for i in range(1, corner_count):
        low = min(low, screen[i, 1])
        high = max(high, screen[i, 1])
    first = int(max(np.floor((low - 32.0) / ROW_STEP), window[1] * 4.0))
    last = int(min(np.floor((high - 32.0) / ROW_STEP) + 1.0, window[3] * 4.0))
    for row in range(first, last):
        left[row] = int(window[2])
        right[row] = int(window[0])
    for i in range(corner_count):
        j = i + 1 if i + 1 < corner_count else 0
        xa, ya, xb, yb = screen[i, 0], screen[i, 1], screen[j, 0], screen[j, 1]
        if ya == yb:
            continue
        leftward = yb > ya
        if not leftward:
            xa, ya, xb, yb = xb, yb, xa, ya
        top = int(max(np.floor((ya - 32.0) / ROW_STEP) + 1.0, float(first)))
        end = int(min(np.floor((yb - 32.0) / ROW_STEP) + 1.0, float(last)))
        height = yb - ya
        width = xb - xa
        for row in range(top, end):
            across = (xa - SAMPLE_X[row & 3]) * height + width * (ROW_STEP * row + 32.0 - ya)
            bound = int(min(max(np.ceil(across / (256.0 * height)), window[0]), window[2]))
            if leftward:
                left[row] = bound
            else:
                right[row] = bound
    while first < last and left[first] >= right[first]:
        first += 1
    while first < last and left[last - 1] >= right[last - 1]:
        last -= 1
    return first, last


@part(lean=True, into_caller=True)
def claim(drawn: Drawn, face: int, first: int, last: int) -> int:
    """Claim for ``face`` the samples of its outline that nothing nearer owns; how many it got."""
    owner, planes, left, right = drawn.owner, drawn.planes, drawn.left, drawn.right
    a, b, c = planes[face, 0], planes[face, 1], planes[face, 2]
    claimed = 0
    for row in range(first, last):
        y = (ROW_STEP * row + 32.0) / 256.0
        shift = SAMPLE_X[row & 3] / 256.0
        here = b * y + c
        begin, end = left[row], right[row]
        taken = np.int32(-1)
        for x in range(begin, end):
            taken = max(taken, owner[index(row), index(x)])
        if taken < 0:
            for x in range(begin, end):
                owner[index(row), index(x)] = face
            claimed += max(end - begin, 0)  # corners are rounded: a sliver may be crossed
            continue
        rival = -1
        rival_a = there = 0.0
        for x in range(begin, end):
            other = owner[index(row), index(x)]
            if other >= 0:
                if other != rival:
                    rival, k = other, index(other)
                    rival_a, there = planes[k, 0], planes[k, 1] * y + planes[k, 2]
                at = x + shift
                if a * at + here <= rival_a * at + there:
                    continue
            owner[index(row), index(x)] = face
            claimed += 1
    return claimed
