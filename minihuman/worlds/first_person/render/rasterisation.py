"""Rasterisation: from a face in space to the samples that it covers in the picture.

The steps are lighting, perspective and clipping at the near plane, and then the coverage of four samples per pixel, at
the positions that OpenGL drivers share, claimed in spans (see `spans`).
"""

import numpy as np

from minihuman.worlds.first_person.render.kernel_tables import F64, SHADE, DrawBuffers, FaceTable
from minihuman.worlds.first_person.render.spans import ROW_STEP, claim, outline
from minihuman.worlds.kernels import device_function, int64

# The columns of a view's array, which describes a camera and a picture to the kernels.
# the eye's position, and unit vectors; three numbers each
EYE = 0
RIGHT = 3
UP = 6
FORWARD = 9
# pixels; FOCAL_X and FOCAL_Y are pixels per metre in a parallel view
FOCAL_X = 12
FOCAL_Y = 13
CENTRE_X = 14
CENTRE_Y = 15
# the near and the far plane, metres; 1.0 for the parallel view from above
NEAR = 16
FAR = 17
PARALLEL = 18
# the direction to the light, its colour and the ambient light; the sky's colour; three numbers each
LIGHT = 19
SKY = 28
LEAST = 31  # the lower bound of 1 / distance, which beyond a face's edge could be 0 or negative
# the rows to draw, and the size of the whole picture, pixels
TOP = 32
BOTTOM = 33
HEIGHT = 34
WIDTH = 35
ROOM = 36  # the memory: how many spans per row, faces, and corners per face; three numbers
LOOK = 39  # 1.0 for the style of a participant's display: smoother textures, and shade at the joints of faces
VIEW_SIZE = 40

TILES = 16  # across the picture and down; for each, `survey` finds the least nearness of what is drawn
GUARD_PX = 16384.0  # corners stay within this of the picture's middle, so that their products are exact

# The columns of a placement's array, which places a thing's own coordinates in the world.
PLACE = 0
COS = 3
SIN = 4
SCALE = 5
NORMAL_SCALE = 8
TINT = 9
# in the thing's own coordinates: the eye, and 1.0 if that is a position and not a direction; the direction to the light
OWN_EYE = 12
OWN_LIGHT = 16
PLACEMENT_SIZE = 19


@device_function(nogil=True, force_inline=True)
def cut(corners: F64, source: int, count: int, a: float, b: float, c: float, d: float) -> int:
    """Clip polygon ``source`` to a*x + b*y + c*z + d >= 0; return the number of its corners.

    The result is in row 2 if the source is row 1, and in row 1 otherwise. Row 0 is never written: the face's planes are
    computed from its corners before all clipping.
    """
    into = 2 if source == 1 else 1
    corner_count = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        distance = a * corners[source, i, 0] + b * corners[source, i, 1] + c * corners[source, i, 2] + d
        next_distance = a * corners[source, j, 0] + b * corners[source, j, 1] + c * corners[source, j, 2] + d
        if distance >= 0.0:
            for k in range(3):
                corners[into, corner_count, k] = corners[source, i, k]
            corner_count += 1
        if (distance >= 0.0) != (next_distance >= 0.0):
            # from the inner end to the outer one, so that both faces of an edge are cut at the same point
            if distance >= 0.0:
                part = distance / (distance - next_distance)
                for k in range(3):
                    corners[into, corner_count, k] = corners[source, i, k] + part * (
                        corners[source, j, k] - corners[source, i, k]
                    )
            else:
                part = next_distance / (next_distance - distance)
                for k in range(3):
                    corners[into, corner_count, k] = corners[source, j, k] + part * (
                        corners[source, i, k] - corners[source, j, k]
                    )
            corner_count += 1
    return corner_count


@device_function(nogil=True, force_inline=True)
def turn_to(view: F64, light: F64, placement: F64) -> None:
    """Write the eye's position and the light's direction, in an entity's own coordinates, into its placement."""
    co = placement[COS]
    si = placement[SIN]
    if view[PARALLEL] == 1.0:
        ex = -view[FORWARD]
        ey = -view[FORWARD + 1]
        ez = -view[FORWARD + 2]
    else:
        at = placement[PLACE : PLACE + 3]
        ex = view[EYE] - at[0]
        ey = view[EYE + 1] - at[1]
        ez = view[EYE + 2] - at[2]
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
    buffers: DrawBuffers,
    number: int,
    surveyed: bool,
) -> int:
    """Draw one face as number ``number``; return the number of samples that it claimed (0 leaves the number free).

    The result is -1 if a row has no room for more spans. ``window`` is x0, y0, x1, y1 in pixels.

    ``light`` contains the direction to the light, its colour, and the ambient light, three numbers each. If what was
    drawn before is ``surveyed``, a face that is certainly behind it is skipped at once.
    """
    # Seen from behind?
    side = faces.plane
    above = side[face, 0] * placement[OWN_EYE] + side[face, 1] * placement[OWN_EYE + 1]
    if above + side[face, 2] * placement[OWN_EYE + 2] + side[face, 3] * placement[OWN_EYE + 3] <= 0.0:
        return 0

    parallel = view[PARALLEL] == 1.0
    co = placement[COS]
    si = placement[SIN]
    sx = placement[SCALE]
    sy = placement[SCALE + 1]
    sz = placement[SCALE + 2]
    start = faces.start[face]
    count = faces.start[face + 1] - start
    corners = buffers.corners
    screen = buffers.screen
    near = view[NEAR]
    ahead = 0
    # all read before anything is written, for a compiler cannot know that the tables do not overlap
    eye_x = view[EYE]
    eye_y = view[EYE + 1]
    eye_z = view[EYE + 2]
    right_x = view[RIGHT]
    right_y = view[RIGHT + 1]
    right_z = view[RIGHT + 2]
    up_x = view[UP]
    up_y = view[UP + 1]
    up_z = view[UP + 2]
    forward_x = view[FORWARD]
    forward_y = view[FORWARD + 1]
    forward_z = view[FORWARD + 2]
    at_x = placement[PLACE]
    at_y = placement[PLACE + 1]
    at_z = placement[PLACE + 2]
    for i in range(count):
        corner = faces.position[start + i]
        px = corner[0] * sx
        py = corner[1] * sy
        pz = corner[2] * sz
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
        screen[i, 0], screen[i, 1] = x, y
        x0, x1, y0, y1 = (x, x, y, y) if i == 0 else (min(x0, x), max(x1, x), min(y0, y), max(y1, y))
    if x1 <= window[0] * 256.0 or x0 >= window[2] * 256.0 or y1 <= window[1] * 256.0 or y0 >= window[3] * 256.0:
        return 0
    if not nearness(faces, face, view, buffers, number):
        return 0
    if surveyed and hidden(buffers, number, view, window, x0, y0, x1, y1):
        return 0
    first, last = outline(buffers, count, window)
    if first == last:
        return 0
    samples = int(claim(buffers, number, first, last, SHADE - faces.texture[face]))
    if samples > 0:
        vary(faces, face, view, placement, light, buffers, number)
    return samples


@device_function(nogil=True, force_inline=True)
def tile_size(view: F64) -> tuple[int, int]:
    """Return the width of a tile in pixels and its height in sample rows."""
    return int(view[WIDTH]) // TILES + 1, 4 * int(view[HEIGHT]) // TILES + 1


@device_function(nogil=True, force_inline=True)
def hidden(
    buffers: DrawBuffers, number: int, view: F64, window: F64, x0: float, y0: float, x1: float, y1: float
) -> bool:
    """Return whether a face is certainly behind the picture so far at every sample.

    Its corners lie between (x0, y0) and (x1, y1), in 1/256 of a pixel; ``window`` is x0, y0, x1, y1 in pixels.
    """
    planes = buffers.planes
    tiles = buffers.tiles
    left = max(int(x0 / 256.0), int(window[0]))
    right = min(int(x1 / 256.0) + 1, int(window[2]))
    top = max(int(y0 / ROW_STEP), 4 * int(window[1]))
    bottom = min(int(y1 / ROW_STEP) + 1, 4 * int(window[3]))
    a = planes[number, 0]
    b = planes[number, 1]
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
def nearness(faces: FaceTable, face: int, view: F64, buffers: DrawBuffers, number: int) -> bool:
    """Compute the plane of a face's nearness over the picture; return False if the face is seen edge-on.

    Three corners before clipping determine it. The inverse of the matrix of their positions also gives the planes of
    everything else that varies linearly over a flat face.
    """
    count = faces.start[face + 1] - faces.start[face]
    p = buffers.corners[0]
    inverse = buffers.inverse
    i1 = count // 3
    i2 = (2 * count) // 3
    parallel = view[PARALLEL] == 1.0
    x0 = p[0, 0]
    y0 = p[0, 1]
    x1 = p[i1, 0]
    y1 = p[i1, 1]
    x2 = p[i2, 0]
    y2 = p[i2, 1]
    z0, z1, z2 = (1.0, 1.0, 1.0) if parallel else (p[0, 2], p[i1, 2], p[i2, 2])
    ax = y1 * z2 - z1 * y2
    ay = z1 * x2 - x1 * z2
    az = x1 * y2 - y1 * x2
    bx = y2 * z0 - z2 * y0
    by = z2 * x0 - x2 * z0
    bz = x2 * y0 - y2 * x0
    cx = y0 * z1 - z0 * y1
    cy = z0 * x1 - x0 * z1
    cz = x0 * y1 - y0 * x1
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
    plane(buffers, view, number, int64(0), v0, v1, v2)
    return True


@device_function(nogil=True, force_inline=True)
def plane(buffers: DrawBuffers, view: F64, number: int, column: int, first: float, second: float, third: float) -> None:
    """Write the plane number ``column`` of a face, of a value over the picture, from its values at three corners."""
    inverse = buffers.inverse
    planes = buffers.planes
    gx = (first * inverse[0, 0] + second * inverse[0, 1] + third * inverse[0, 2]) * inverse[3, 0]
    gy = (first * inverse[1, 0] + second * inverse[1, 1] + third * inverse[1, 2]) * inverse[3, 1]
    gz = (first * inverse[2, 0] + second * inverse[2, 1] + third * inverse[2, 2]) * inverse[3, 2]
    planes[number, 3 * column], planes[number, 3 * column + 1] = gx, -gy
    planes[number, 3 * column + 2] = gz - gx * view[CENTRE_X] + gy * view[CENTRE_Y]


@device_function(nogil=True, force_inline=True)
def vary(faces: FaceTable, face: int, view: F64, placement: F64, light: F64, buffers: DrawBuffers, number: int) -> None:
    """Write a face's texture, and the planes of 1, its texture coordinates and its light, each divided by distance."""
    start = faces.start[face]
    count = faces.start[face + 1] - start
    planes = buffers.planes
    kind = buffers.kind
    lit = buffers.lit
    long = placement[NORMAL_SCALE]
    same = True
    lx = placement[OWN_LIGHT]
    ly = placement[OWN_LIGHT + 1]
    lz = placement[OWN_LIGHT + 2]
    for k in range(3):
        corner = start + (k * count) // 3
        normal = faces.normal
        facing = long * (normal[corner, 0] * lx + normal[corner, 1] * ly + normal[corner, 2] * lz)
        for channel in range(3):
            bright = light[6 + channel] + light[3 + channel] * max(facing, 0.0)
            lit[channel, k] = min(faces.colour[face, channel] * placement[TINT + channel] * bright, 1.0)
            same = same and lit[channel, k] == lit[channel, 0]
    kind[number, 0], kind[number, 1] = faces.texture[face], 1 if same else 0
    c0 = start
    c1 = start + count // 3
    c2 = start + (2 * count) // 3
    place = faces.texture_place
    for column in range(1, 7):
        if column == 1:
            v0 = v1 = v2 = 1.0
        elif column < 4:
            v0 = place[c0, column - 2]
            v1 = place[c1, column - 2]
            v2 = place[c2, column - 2]
        else:
            v0 = lit[column - 4, 0]
            v1 = lit[column - 4, 1]
            v2 = lit[column - 4, 2]
            if same:
                planes[number, 3 * column] = v0  # the colour itself, as it does not vary
                continue
        plane(buffers, view, number, column, v0, v1, v2)
