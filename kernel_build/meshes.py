"""Make the meshes that the package ships, from turned profiles, balls and boxes, fitted to Miniworld's sizes.

``python -m kernel_build.meshes`` writes them to the file that ``built_in_meshes`` reads and prints its digest.
Circles come from fractions, not from sines, so that every machine builds the same points.
"""

import hashlib
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from minihuman.worlds.first_person.render.assets import MeshData, unit_cube
from minihuman.worlds.first_person.render.built_in_meshes import MESH_FILE
from minihuman.worlds.first_person.render.kernel_tables import F64

Rgb = tuple[float, float, float]
Point = tuple[float, float, float]
Part = tuple[F64, F64, Rgb]  # corners (n, 3, 3), normals (n, 3, 3), colour

WHITE: Rgb = (1.0, 1.0, 1.0)  # to be tinted: balls and keys come in colours


def circle(quarter: int) -> F64:
    """Return points once around the unit circle, ``quarter`` of them in each quarter, (4 * quarter, 2)."""
    t = np.arange(quarter) / quarter
    x = (1 - t * t) / (1 + t * t)
    y = 2 * t / (1 + t * t)
    return np.concatenate([np.column_stack(pair) for pair in ((x, y), (-y, x), (-x, -y), (y, -x))])


def turned(profile: Sequence[tuple[float, float]], colour: Rgb, *, quarter: int = 5, smooth: bool = False) -> Part:
    """Turn a profile of (radius, height), from the bottom up, around the vertical axis."""
    around = circle(quarter)
    count = len(around)
    points = np.array(profile, np.float64)
    steps = np.diff(points, axis=0)
    slopes = np.column_stack([steps[:, 1], -steps[:, 0]])
    slopes /= np.sqrt(np.sum(slopes * slopes, axis=1, keepdims=True))
    corners = []
    normals = []
    for band in range(len(slopes)):
        first = slopes[band]
        last = slopes[band]
        if smooth:
            first = _unit(slopes[max(band - 1, 0)] + slopes[band])
            last = _unit(slopes[min(band + 1, len(slopes) - 1)] + slopes[band])
        for i in range(count):
            a = around[i]
            b = around[(i + 1) % count]
            low = points[band]
            high = points[band + 1]
            quad = [_turn(low, a), _turn(high, a), _turn(high, b), _turn(low, b)]
            facing = [_turn(first, a), _turn(last, a), _turn(last, b), _turn(first, b)]
            if high[0] > 0:
                corners.append([quad[0], quad[2], quad[1]])
                normals.append([facing[0], facing[2], facing[1]])
            if low[0] > 0:
                corners.append([quad[0], quad[3], quad[2]])
                normals.append([facing[0], facing[3], facing[2]])
    return np.array(corners), np.array(normals), colour


def ball(centre: Point, radii: Point, colour: Rgb, *, quarter: int = 4) -> Part:
    """Make a ball, longer along some axes than others."""
    half = circle(quarter)[: 2 * quarter + 1]
    profile = [(float(y), float(-x)) for x, y in half]
    profile[0], profile[-1] = (0.0, -1.0), (0.0, 1.0)
    corners, _, _ = turned(profile, colour, quarter=quarter)
    size = np.array(radii)
    normals = corners / size
    normals /= np.sqrt(np.sum(normals * normals, axis=2, keepdims=True))
    return corners * size + np.array(centre), normals, colour


def block(low: Point, high: Point, colour: Rgb) -> Part:
    """Make a box between two corners."""
    size = np.array(high) - np.array(low)
    base = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    corners = []
    normals = []
    for side in unit_cube():
        square = side * size + base
        normal = np.cross(square[1] - square[0], square[2] - square[0])
        normal /= np.sqrt(np.sum(normal * normal))
        corners += [square[[0, 1, 2]], square[[0, 2, 3]]]
        normals += [np.tile(normal, (3, 1))] * 2
    return np.array(corners), np.array(normals), colour


def assemble(parts: Sequence[Part], half_width: float, height: float, half_depth: float) -> MeshData:
    """Assemble parts into one mesh, stretched to a size and set on the floor."""
    corners = np.concatenate([part[0] for part in parts])
    normals = np.concatenate([part[1] for part in parts])
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    stretch = np.array([2 * half_width, height, 2 * half_depth]) / (high - low)
    middle = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    normals = normals / stretch
    normals /= np.sqrt(np.sum(normals * normals, axis=2, keepdims=True))
    count = len(corners)
    colours = np.concatenate([np.tile(np.array(part[2]), (len(part[0]), 1)) for part in parts])
    return MeshData((corners - middle) * stretch, normals, np.zeros((count, 3, 2)), colours, (None,) * count)


def build_meshes() -> dict[str, F64]:
    """Build every mesh: corners and normals (n, 3, 3) and colours (n, 3), as "NAME.corners" and so on."""
    arrays: dict[str, F64] = {}
    for name, shape in SHAPES.items():
        mesh = assemble(shape(), *_SIZES[name])
        arrays |= {f"{name}.corners": mesh.corners, f"{name}.normals": mesh.normals, f"{name}.colours": mesh.colours}
    return arrays


def _turn(point: F64, direction: F64) -> F64:
    return np.array([point[0] * direction[0], point[1], -point[0] * direction[1]])


def _unit(vector: F64) -> F64:
    return np.asarray(vector / np.sqrt(np.sum(vector * vector)))


def _key() -> list[Part]:
    ring: list[Part] = []
    around = circle(4)
    for i in range(len(around)):
        a = around[i]
        b = around[(i + 1) % len(around)]
        square = (a, b, b * 0.55, a * 0.55)
        ring += _slab([(float(p[0]) - 1.9, float(p[1]) + 1.0) for p in square], 0.2, WHITE)
    shaft = block((-0.2, 0.82, -0.95), (0.2, 1.18, 2.4), WHITE)
    teeth = [block((-0.2, 0.25, z), (0.2, 0.85, z + 0.3), WHITE) for z in (1.3, 1.8, 2.1)]
    return [*ring, shaft, *teeth]


def _slab(outline: list[tuple[float, float]], half: float, colour: Rgb) -> list[Part]:
    """Make a four-cornered plate across the x axis, its outline given as (z, y)."""
    front = np.array([[half, y, z] for z, y in outline])
    back = front * np.array([-1.0, 1.0, 1.0])
    quads = [front, back[::-1]]
    quads += [np.array([front[i], back[i], back[(i + 1) % 4], front[(i + 1) % 4]]) for i in (0, 2)]
    corners = []
    normals = []
    middle = (front.mean(axis=0) + back.mean(axis=0)) / 2
    for quad in quads:
        normal = _unit(np.cross(quad[1] - quad[0], quad[2] - quad[0]))
        if np.dot(normal, quad.mean(axis=0) - middle) < 0:
            quad = quad[::-1]
            normal = -normal
        corners += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
        normals += [np.tile(normal, (3, 1))] * 2
    return [(np.array(corners), np.array(normals), colour)]


def _barrel() -> list[Part]:
    wood = (0.52, 0.34, 0.18)
    hoop = (0.30, 0.31, 0.33)
    staves = turned(
        [(0.0, 0.0), (0.24, 0.0), (0.29, 0.25), (0.305, 0.44), (0.29, 0.63), (0.24, 0.88), (0.0, 0.86)], wood
    )
    hoops = [
        turned([(r, y), (r + 0.012, y), (r + 0.012, y + 0.05), (r, y + 0.05)], hoop)
        for r, y in ((0.262, 0.10), (0.298, 0.34), (0.298, 0.50), (0.265, 0.74))
    ]
    return [staves, *hoops]


def _barrier() -> list[Part]:
    orange = (0.93, 0.42, 0.10)
    white = (0.94, 0.94, 0.92)
    steel = (0.35, 0.36, 0.38)
    boards = [
        block((x, y, -0.06), (x + 0.5, y + 0.26, 0.06), orange if i % 2 else white)
        for y in (0.85, 0.45)
        for i, x in enumerate(np.arange(8) * 0.5 - 2.0)
    ]
    legs = [block((x - 0.05, 0.0, -0.4), (x + 0.05, 0.08, 0.4), steel) for x in (-1.8, 1.8)]
    posts = [block((x - 0.05, 0.0, -0.05), (x + 0.05, 1.1, 0.05), steel) for x in (-1.8, 1.8)]
    lamps = [ball((x, 1.15, 0.0), (0.1, 0.1, 0.1), (0.98, 0.80, 0.15), quarter=2) for x in (-1.8, 1.8)]
    return [*boards, *legs, *posts, *lamps]


def _building() -> list[Part]:
    stone = (0.72, 0.69, 0.63)
    pane = (0.26, 0.33, 0.42)
    roof = (0.42, 0.36, 0.33)
    parts = [block((-1.8, 0.0, -1.18), (1.8, 3.3, 1.18), stone), block((-1.84, 3.25, -1.22), (1.84, 3.45, 1.22), roof)]
    for floor in range(7):
        y = 0.25 + 0.43 * floor
        parts += [block((x - 0.12, y, -1.2), (x + 0.12, y + 0.28, 1.2), pane) for x in np.arange(7) * 0.5 - 1.5]
        parts += [block((-1.82, y, z - 0.12), (1.82, y + 0.28, z + 0.12), pane) for z in (-0.8, -0.27, 0.27, 0.8)]
    return parts


def _cone() -> list[Part]:
    orange = (0.95, 0.36, 0.08)
    white = (0.95, 0.95, 0.93)
    rings = ((7.0, 1.5), (5.2, 9.5), (4.3, 14.0), (3.2, 19.0), (2.3, 23.5), (1.0, 31.5))
    bands = [
        turned([low, high], white if index in (1, 3) else orange) for index, (low, high) in enumerate(pairwise(rings))
    ]
    return [block((-10.0, 0.0, -10.0), (10.0, 1.6, 10.0), orange), *bands, turned([(1.0, 31.5), (0.0, 31.5)], orange)]


def _doom_door() -> list[Part]:
    steel = (0.46, 0.44, 0.42)
    dark = (0.28, 0.27, 0.27)
    panels = [block((-0.05, y, -0.42), (0.05, y + 0.2, 0.42), dark) for y in (0.08, 0.4, 0.7)]
    return [block((-0.04, 0.0, -0.5), (0.04, 1.0, 0.5), steel), *panels]


def _duckie() -> list[Part]:
    yellow = (0.98, 0.82, 0.10)
    orange = (0.95, 0.45, 0.08)
    black = (0.05, 0.05, 0.06)
    return [
        ball((-0.1, 0.48, 0.0), (0.72, 0.48, 0.55), yellow, quarter=5),
        ball((-0.72, 0.72, 0.0), (0.22, 0.18, 0.26), yellow),
        ball((0.28, 1.08, 0.0), (0.42, 0.42, 0.42), yellow, quarter=5),
        ball((0.70, 1.00, 0.0), (0.24, 0.08, 0.22), orange),
        *(ball((0.55, 1.24, z), (0.09, 0.09, 0.07), black, quarter=2) for z in (-0.24, 0.24)),
        *(ball((-0.2, 0.55, z), (0.40, 0.26, 0.10), (0.93, 0.74, 0.06)) for z in (-0.50, 0.50)),
    ]


def _keycard() -> list[Part]:
    card = (0.85, 0.13, 0.12)
    stripe = (0.10, 0.10, 0.12)
    chip = (0.92, 0.80, 0.35)
    return [
        block((-0.06, 0.0, -0.9), (0.06, 2.3, 0.9), card),
        block((-0.085, 1.7, -0.9), (0.085, 2.05, 0.9), stripe),
        block((-0.085, 0.9, 0.25), (0.085, 1.35, 0.7), chip),
    ]


def _medkit() -> list[Part]:
    white = (0.95, 0.95, 0.95)
    red = (0.86, 0.10, 0.12)
    grey = (0.35, 0.35, 0.38)
    return [
        block((-28.0, 0.0, -14.5), (28.0, 43.0, 14.5), red),
        block((-5.0, 8.0, -15.6), (5.0, 36.0, 15.6), white),
        block((-14.0, 17.0, -15.6), (14.0, 27.0, 15.6), white),
        block((-10.0, 43.0, -2.5), (-6.0, 49.0, 2.5), grey),
        block((6.0, 43.0, -2.5), (10.0, 49.0, 2.5), grey),
        block((-10.0, 47.0, -2.5), (10.0, 51.0, 2.5), grey),
    ]


def _office_chair() -> list[Part]:
    cloth = (0.16, 0.22, 0.34)
    plastic = (0.14, 0.14, 0.15)
    feet = [block((-12.0, 0.0, -1.2), (12.0, 3.0, 1.2), plastic), block((-1.2, 0.0, -12.0), (1.2, 3.0, 12.0), plastic)]
    column = turned([(1.6, 2.0), (1.6, 19.0)], plastic, quarter=3)
    seat = block((-11.0, 19.0, -11.0), (11.0, 23.0, 11.0), cloth)
    back = block((-13.5, 25.0, -10.0), (-10.5, 47.0, 10.0), cloth)
    stem = block((-13.0, 20.0, -2.0), (-11.5, 28.0, 2.0), plastic)
    arms = [block((-8.0, 29.0, z - 1.2), (7.0, 31.0, z + 1.2), plastic) for z in (-12.5, 12.5)]
    props = [block((-2.0, 20.0, z - 0.8), (0.0, 30.0, z + 0.8), plastic) for z in (-12.5, 12.5)]
    return [*feet, column, seat, back, stem, *arms, *props]


def _office_desk() -> list[Part]:
    top = (0.66, 0.50, 0.33)
    side = (0.42, 0.43, 0.45)
    screen = (0.08, 0.09, 0.10)
    return [
        block((-33.0, 36.0, -16.0), (33.0, 39.0, 16.0), top),
        *(block((x - 1.0, 0.0, -15.0), (x + 1.0, 36.0, 15.0), side) for x in (-30.0, 30.0)),
        block((12.0, 8.0, -14.0), (29.0, 35.0, 14.0), side),
        block((-2.0, 39.0, -4.0), (2.0, 48.0, -2.0), screen),
        block((-16.0, 46.0, -4.0), (16.0, 63.0, -2.0), screen),
        block((-14.5, 47.5, -2.0), (14.5, 61.5, -1.7), (0.30, 0.50, 0.62)),
        block((-12.0, 39.0, 4.0), (12.0, 40.0, 11.0), side),
    ]


def _potion() -> list[Part]:
    glass = (0.72, 0.80, 0.86)
    cork = (0.60, 0.42, 0.24)
    juice = (0.75, 0.10, 0.62)
    bottle = turned([(0.0, 0.0), (0.42, 0.0), (0.62, 0.35), (0.64, 0.7), (0.52, 1.1)], juice, smooth=True)
    shoulder = turned([(0.52, 1.1), (0.34, 1.45), (0.22, 1.7), (0.22, 2.1)], glass, smooth=True)
    rim = turned([(0.22, 2.1), (0.28, 2.1), (0.28, 2.2), (0.16, 2.2)], glass)
    return [bottle, shoulder, rim, turned([(0.17, 2.2), (0.17, 2.5), (0.0, 2.5)], cork)]


def _tree() -> list[Part]:
    bark = (0.38, 0.27, 0.17)
    leaf = (0.20, 0.44, 0.14)
    light = (0.30, 0.55, 0.20)
    trunk = turned([(1.9, 0.0), (1.2, 2.5), (1.0, 12.0), (0.6, 17.0)], bark)
    crowns = (
        ((0.0, 19.0, 0.0), (8.0, 7.0, 7.5), leaf),
        ((-6.5, 15.5, 2.0), (6.5, 5.0, 5.0), light),
        ((6.5, 16.0, -2.5), (7.0, 5.5, 5.5), leaf),
        ((1.0, 15.0, 5.5), (6.0, 4.5, 4.5), light),
        ((0.5, 14.5, -5.5), (6.0, 4.5, 4.5), leaf),
    )
    return [trunk, *(ball(centre, radii, colour) for centre, radii, colour in crowns)]


def _tree_pine() -> list[Part]:
    bark = (0.36, 0.25, 0.16)
    needles = (0.12, 0.34, 0.18)
    tiers = [
        turned([(0.0, y), (r, y), (0.0, y + h)], needles)
        for r, y, h in ((2.1, 1.2, 3.0), (1.7, 2.9, 2.7), (1.2, 4.6, 2.9))
    ]
    return [turned([(0.35, 0.0), (0.3, 1.3)], bark, quarter=3), *tiers]


def _ball() -> list[Part]:
    return [ball((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), WHITE, quarter=5)]


SHAPES: dict[str, Callable[[], list[Part]]] = {
    "ball": _ball,
    "barrel": _barrel,
    "barrier": _barrier,
    "building": _building,
    "cone": _cone,
    "doom_door": _doom_door,
    "duckie": _duckie,
    "key": _key,
    "keycard": _keycard,
    "medkit": _medkit,
    "office_chair": _office_chair,
    "office_desk": _office_desk,
    "potion": _potion,
    "tree": _tree,
    "tree_pine": _tree_pine,
}
# Half the width, the height and half the depth that Miniworld's collision rules go by, to the digits that pictures have
# always been drawn with: `entities` has those of the rules, in single precision.
_SIZES: dict[str, tuple[float, float, float]] = {
    "ball": (1.284565, 2.564372, 1.285002),
    "barrel": (0.30539, 0.882287, 0.30539),
    "barrier": (2.032784, 1.143, 0.4064),
    "building": (1.84, 3.45, 1.22),
    "cone": (10.0, 31.5229, 10.0),
    "doom_door": (0.05, 1.0, 0.5),
    "duckie": (0.8303055, 1.518421, 0.58813),
    "key": (0.401406, 2.0, 2.4187405),
    "keycard": (0.085815, 2.3173308, 0.90595853),
    "medkit": (28.1319, 51.0648, 15.62425),
    "office_chair": (14.544351, 47.314598, 13.73),
    "office_desk": (33.45795, 63.6329, 16.451252),
    "potion": (0.64, 2.513775, 0.64),
    "tree": (13.99055, 26.541735, 10.40086),
    "tree_pine": (2.1321554, 7.543869, 2.1399379),
}


if __name__ == "__main__":
    meshes: dict[str, Any] = {**build_meshes()}
    np.savez_compressed(MESH_FILE, **meshes)
    print(hashlib.sha256(MESH_FILE.read_bytes()).hexdigest())
