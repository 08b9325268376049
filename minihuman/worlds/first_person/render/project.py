"""From a face in space to a face on the picture: light, perspective, cuts at the near plane, and how it varies."""

import numpy as np

from minihuman.worlds.first_person.render.raster import ROW_STEP, claim, outline
from minihuman.worlds.first_person.render.tables import F64, SHADE, Drawn, Faces
from minihuman.worlds.kernels import int64, part

# The columns of a view's array: what the kernels know of a camera.
EYE, RIGHT, UP, FORWARD = 0, 3, 6, 9  # three numbers each
FOCAL_X, FOCAL_Y, CENTRE_X, CENTRE_Y = 12, 13, 14, 15  # pixels; pixels a metre where nothing shrinks with distance
NEAR, FAR, PARALLEL = 16, 17, 18  # metres, metres, 1.0 for a view from above
LIGHT, SKY = 19, 28  # the way to the light, its colour and the ambient light; the sky's colour; three numbers each
LEAST = 31  # of 1 / distance: beyond a face's edge it may reach nonsense
TOP, BOTTOM, HEIGHT, WIDTH = 32, 33, 34, 35  # which rows to draw, and the whole picture, pixels
ROOM = 36  # how many spans of a row, faces and corners of a face there is memory for, three numbers
VIEW_SIZE = 39

TILES = 16  # across the picture and down, in which is known how near what was drawn is at least
GUARD_PX = 16384.0  # corners stay within this of the picture's middle, so that their products are exact

# The columns of a placement's array: how a thing's own coordinates lie in the world.
PLACE, COS, SIN, SCALE, NORMAL_SCALE, TINT = 0, 3, 4, 5, 8, 9
OWN_EYE, OWN_LIGHT = 12, 16  # the eye, and 1.0 where it is a place and not a direction; the way to the light
PLACEMENT_SIZE = 19


@part(lean=True, into_caller=True)
def cut(corners: F64, source: int, count: int, a: float, b: float, c: float, d: float) -> int:
    """Keep the part of polygon ``source`` where a*x + b*y + c*z + d >= 0; how many corners it has.

    It goes into row 2 if the source is row 1, else into row 1. Row 0 is never written to: how a face varies is told
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


@part(lean=True, into_caller=True)
def turn_to(view: F64, light: F64, placement: F64) -> None:
    """Work out where a thing's eye and light are, in the thing's own coordinates, from where it is and how it lies."""
    co, si = placement[COS], placement[SIN]
    if view[PARALLEL] == 1.0:
        ex, ey, ez = -view[FORWARD], -view[FORWARD + 1], -view[FORWARD + 2]
    else:
        ex = view[EYE] - placement[PLACE]
        ey = view[EYE + 1] - placement[PLACE + 1]
        ez = view[EYE + 2] - placement[PLACE + 2]
    placement[OWN_EYE] = (co * ex - si * ez) / placement[SCALE]
    placement[OWN_EYE + 1] = ey / placement[SCALE + 1]
    placement[OWN_EYE + 2] = (si * ex + co * ez) / placement[SCALE + 2]
    placement[OWN_EYE + 3] = 1.0 - view[PARALLEL]
    placement[OWN_LIGHT] = co * light[0] - si * light[2]
    placement[OWN_LIGHT + 1] = light[1]
    placement[OWN_LIGHT + 2] = si * light[0] + co * light[2]


@part(lean=True, into_caller=True, current=int64)
def draw_face(
    faces: Faces,
    face: int,
    view: F64,
    placement: F64,
    light: F64,
    window: F64,
    drawn: Drawn,
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

    parallel = view[PARALLEL] == 1.0
    co, si = placement[COS], placement[SIN]
    sx, sy, sz = placement[SCALE], placement[SCALE + 1], placement[SCALE + 2]
    start = faces.start[face]
    count = faces.start[face + 1] - start
    corners, screen = drawn.corners, drawn.screen
    near = view[NEAR]
    ahead = 0
    # all read before anything is written, for a compiler cannot know that the tables do not overlap
    eye_x, eye_y, eye_z = view[EYE], view[EYE + 1], view[EYE + 2]
    right_x, right_y, right_z = view[RIGHT], view[RIGHT + 1], view[RIGHT + 2]
    up_x, up_y, up_z = view[UP], view[UP + 1], view[UP + 2]
    forward_x, forward_y, forward_z = view[FORWARD], view[FORWARD + 1], view[FORWARD + 2]
    at_x, at_y, at_z = placement[PLACE], placement[PLACE + 1], placement[PLACE + 2]
    for i in range(count):
        px = faces.position[start + i, 0] * sx
        py = faces.position[start + i, 1] * sy
        pz = faces.position[start + i, 2] * sz
        wx = at_x + (co * px + si * pz) - eye_x
        wy = at_y + py - eye_y
        wz = at_z + (co * pz - si * px) - eye_z
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
        limit_x = GUARD_PX / view[FOCAL_X]
        limit_y = GUARD_PX / view[FOCAL_Y]
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
        screen[i, 0] = x
        screen[i, 1] = y
        x0 = x if i == 0 else min(x0, x)
        x1 = x if i == 0 else max(x1, x)
        y0 = y if i == 0 else min(y0, y)
        y1 = y if i == 0 else max(y1, y)
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


@part(lean=True, into_caller=True)
def tile_size(view: F64) -> tuple[int, int]:
    """How many pixels a tile is wide, and how many sample rows high."""
    return int(view[WIDTH]) // TILES + 1, 4 * int(view[HEIGHT]) // TILES + 1


@part(lean=True, into_caller=True)
def hidden(drawn: Drawn, number: int, view: F64, window: F64, x0: float, y0: float, x1: float, y1: float) -> bool:
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


@part(lean=True, into_caller=True)
def nearness(faces: Faces, face: int, view: F64, drawn: Drawn, number: int) -> bool:
    """Work out how nearness varies over the picture; False where the face is seen edge-on.

    Three corners, not yet cut, say how; the inverse of the matrix of their positions holds it, and all else that varies
    evenly over a flat face.
    """
    count = faces.start[face + 1] - faces.start[face]
    p, inverse = drawn.corners[0], drawn.inverse
    i1, i2 = count // 3, (2 * count) // 3
    parallel = view[PARALLEL] == 1.0
    x0, y0 = p[0, 0], p[0, 1]
    x1, y1 = p[i1, 0], p[i1, 1]
    x2, y2 = p[i2, 0], p[i2, 1]
    z0 = 1.0 if parallel else p[0, 2]
    z1 = 1.0 if parallel else p[i1, 2]
    z2 = 1.0 if parallel else p[i2, 2]
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
    v0 = -p[0, 2] if parallel else 1.0
    v1 = -p[i1, 2] if parallel else 1.0
    v2 = -p[i2, 2] if parallel else 1.0
    plane(drawn, view, number, int64(0), v0, v1, v2)
    return True


@part(lean=True, into_caller=True)
def plane(drawn: Drawn, view: F64, number: int, column: int, first: float, second: float, third: float) -> None:
    """Write down how something varies over the picture that is so and so much at the three corners."""
    inverse, planes = drawn.inverse, drawn.planes
    gx = (first * inverse[0, 0] + second * inverse[0, 1] + third * inverse[0, 2]) * inverse[3, 0]
    gy = (first * inverse[1, 0] + second * inverse[1, 1] + third * inverse[1, 2]) * inverse[3, 1]
    gz = (first * inverse[2, 0] + second * inverse[2, 1] + third * inverse[2, 2]) * inverse[3, 2]
    planes[number, 3 * column] = gx
    planes[number, 3 * column + 1] = -gy
    planes[number, 3 * column + 2] = gz - gx * view[CENTRE_X] + gy * view[CENTRE_Y]


@part(lean=True, into_caller=True)
def vary(faces: Faces, face: int, view: F64, placement: F64, light: F64, drawn: Drawn, number: int) -> None:
    """Work out how texture and light vary over the picture, divided by distance."""
    start = faces.start[face]
    count = faces.start[face + 1] - start
    planes, kind, lit = drawn.planes, drawn.kind, drawn.lit
    same = True
    long = placement[NORMAL_SCALE]
    lx, ly, lz = placement[OWN_LIGHT], placement[OWN_LIGHT + 1], placement[OWN_LIGHT + 2]
    for k in range(3):
        corner = start + (k * count) // 3
        normal = faces.normal
        facing = long * (normal[corner, 0] * lx + normal[corner, 1] * ly + normal[corner, 2] * lz)
        for channel in range(3):
            bright = light[6 + channel] + light[3 + channel] * max(facing, 0.0)
            lit[channel, k] = min(faces.colour[face, channel] * placement[TINT + channel] * bright, 1.0)
            same = same and lit[channel, k] == lit[channel, 0]
    kind[number, 0] = faces.texture[face]
    kind[number, 1] = 1 if same else 0
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
