"""What is sure to be hidden, for things of many faces: where in the picture a thing is, and how near all that was drawn
there before is at least, in tiles."""

import numpy as np

from minihuman.worlds.first_person.render.project import (
    CENTRE_X,
    CENTRE_Y,
    COS,
    EYE,
    FOCAL_X,
    FOCAL_Y,
    FORWARD,
    NEAR,
    PLACE,
    RIGHT,
    SIN,
    UP,
    tile_size,
)
from minihuman.worlds.first_person.render.raster import ROW_STEP, SAMPLE_X
from minihuman.worlds.first_person.render.tables import BEGIN, END, F64, FACE, THING_BOX, Drawn
from minihuman.worlds.kernels import int64, part


@part(lean=True, beyond=int64, all_beyond=int64)
def narrow(things: F64, thing: int, placement: F64, view: F64, window: F64) -> bool:
    """Narrow a window to where a thing's box is; False if that is nowhere in it.

    A box that reaches behind the camera may be anywhere in front of it.
    """
    x0 = y0 = 1e9
    x1 = y1 = -1e9
    all_beyond, before = 31, 0
    # a pixel more on each side, for corners are moved by up to 1/512 pixel when they are drawn
    left, top, right, bottom = window[0] - 1.0, window[1] - 1.0, window[2] + 1.0, window[3] + 1.0
    for corner in range(8):
        x = things[thing, THING_BOX] * (1.0 - 2.0 * (corner & 1))
        y = things[thing, THING_BOX + 1 + (corner >> 1 & 1)]
        z = things[thing, THING_BOX + 3] * (1.0 - 2.0 * (corner >> 2))
        wx = placement[PLACE] + (placement[COS] * x + placement[SIN] * z) - view[EYE]
        wy = placement[PLACE + 1] + y - view[EYE + 1]
        wz = placement[PLACE + 2] + (placement[COS] * z - placement[SIN] * x) - view[EYE + 2]
        ahead = view[FORWARD] * wx + view[FORWARD + 1] * wy + view[FORWARD + 2] * wz
        across = view[FOCAL_X] * (view[RIGHT] * wx + view[RIGHT + 1] * wy + view[RIGHT + 2] * wz)
        down = -view[FOCAL_Y] * (view[UP] * wx + view[UP + 1] * wy + view[UP + 2] * wz)
        across, down = across + view[CENTRE_X] * ahead, down + view[CENTRE_Y] * ahead
        beyond = 1 if across < left * ahead else 0
        beyond += 2 if across > right * ahead else 0
        beyond += 4 if down < top * ahead else 0
        beyond += 8 if down > bottom * ahead else 0
        beyond += 16 if ahead < view[NEAR] else 0
        all_beyond &= beyond
        if ahead >= view[NEAR]:
            before += 1
            x0, x1 = min(x0, across / ahead), max(x1, across / ahead)
            y0, y1 = min(y0, down / ahead), max(y1, down / ahead)
    if all_beyond != 0:
        return False
    if before == 8:
        window[0], window[1] = max(window[0], np.floor(x0) - 1.0), max(window[1], np.floor(y0) - 1.0)
        window[2], window[3] = min(window[2], np.ceil(x1) + 1.0), min(window[3], np.ceil(y1) + 1.0)
    return bool(window[0] < window[2] and window[1] < window[3])


@part(lean=True, wide=int64, high=int64, reached=int64)
def survey(drawn: Drawn, view: F64, window: F64) -> None:
    """Write down for each tile how near at least what covers it is, of its samples in the window."""
    tiles, planes, spans = drawn.tiles, drawn.planes, drawn.spans
    tiles[:] = np.inf
    wide, high = tile_size(view)
    left, right = int(window[0]), int(window[2])
    for row in range(4 * int(window[1]), 4 * int(window[3])):
        y, shifted = (ROW_STEP * row + 32.0) / 256.0, SAMPLE_X[row & 3] / 256.0
        line = tiles[row // high]
        reached = left
        for k in range(drawn.counts[row]):
            begin, end = max(int64(spans[row, k, BEGIN]), left), min(int64(spans[row, k, END]), right)
            if begin >= end:
                continue
            for column in range(reached // wide, (begin - 1) // wide + 1 if reached < begin else reached // wide):
                line[column] = -np.inf
            plane = planes[spans[row, k, FACE]]
            here = plane[1] * y + plane[2]
            for column in range(begin // wide, (end - 1) // wide + 1):
                first, last = max(begin, column * wide) + shifted, min(end, (column + 1) * wide) - 1 + shifted
                line[column] = min(line[column], min(plane[0] * first + here, plane[0] * last + here))
            reached = end
        if reached < right:
            for column in range(reached // wide, (right - 1) // wide + 1):
                line[column] = -np.inf
