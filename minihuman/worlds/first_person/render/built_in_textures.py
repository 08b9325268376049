"""The built-in textures, each painted from noise and patterns when a scene first uses it.

The names, and the sizes that textures cover, are those to which Miniworld's worlds refer; the pictures are our own.
Noise is seeded and the same on every machine: only +, -, x, / and comparisons of single elements are used, since sines
and sums over arrays differ between machines. Functions work on arrays with values in 0 to 1, over a square of `SIZE`
texels whose opposite edges match.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.kernel_tables import F64

SIZE = 512
Grid = NDArray[np.int64]
_WEIGHTS = np.array([2126, 7152, 722])  # the parts of red, green and blue in brightness, of 10,000, by sRGB


def grid() -> tuple[Grid, Grid]:
    """Return the column and row of every texel; rows count downwards."""
    rows, columns = np.meshgrid(np.arange(SIZE, dtype=np.int64), np.arange(SIZE, dtype=np.int64), indexing="ij")
    return columns, rows


def scatter(x: Grid, y: Grid, seed: int) -> F64:
    """Return a uniform random number in 0 to 1 for each pair of whole numbers, by an integer hash of pair and seed."""
    value = (x * 0x9E3779B1 + y * 0x85EBCA77 + seed * 0xC2B2AE3D) & 0xFFFFFFFF
    value = ((value ^ (value >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    value = ((value ^ (value >> 12)) * 0x297A2D39) & 0xFFFFFFFF
    return ((value ^ (value >> 15)) & 0xFFFF) / 65536.0


def smooth(part: F64) -> F64:
    """Return smoothstep values: an S-curve from 0 to 1 with a slope of 0 at both ends."""
    part = np.clip(part, 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)


def soft(cells_x: int, cells_y: int, seed: int) -> F64:
    """Return smooth noise that repeats at the edges: random numbers on a grid of so many cells, interpolated."""
    lattice_x, lattice_y = np.meshgrid(np.arange(cells_x), np.arange(cells_y))
    lattice = scatter(lattice_x.astype(np.int64), lattice_y.astype(np.int64), seed)
    at_x = np.arange(SIZE, dtype=np.float64) * (cells_x / SIZE)
    at_y = np.arange(SIZE, dtype=np.float64) * (cells_y / SIZE)
    left = at_x.astype(np.int64)
    low = at_y.astype(np.int64)
    fx = smooth(at_x - left)[None, :]
    fy = smooth(at_y - low)[:, None]
    right = (left + 1) % cells_x
    high = (low + 1) % cells_y
    first = lattice[low]
    second = lattice[high]
    top = first[:, left] + fx * (first[:, right] - first[:, left])
    bottom = second[:, left] + fx * (second[:, right] - second[:, left])
    return top + fy * (bottom - top)


def cloud(cells: int, seed: int, octaves: int = 5) -> F64:
    """Return smooth noise around 0.5, with ``cells`` cells from side to side and several octaves of finer detail."""
    total = np.zeros((SIZE, SIZE))
    weight = 0.0
    amplitude = 1.0
    for octave in range(octaves):
        total = total + amplitude * soft(cells << octave, cells << octave, seed + octave)
        weight += amplitude
        amplitude *= 0.5
    return total / weight


def grain(seed: int) -> F64:
    """Return a random number in 0 to 1 for each texel."""
    return scatter(*grid(), seed)


def tiles(columns: int, rows: int, joint: int, *, offset: bool = False) -> tuple[F64, Grid, Grid]:
    """Return a mask of tiles (1) and joints (0), and the column and row of each texel's tile.

    The width ``joint`` of joints is in texels. If ``offset``, every other row of tiles is shifted by half a tile.
    """
    x, y = grid()
    row = y * rows // SIZE
    shifted_x = (x + (row % 2) * (SIZE // columns // 2) if offset else x) * columns
    column = shifted_x // SIZE % columns
    in_x = shifted_x % SIZE // columns
    in_y = y * rows % SIZE // rows
    from_edge: Grid = np.minimum(
        np.minimum(in_x, SIZE // columns - 1 - in_x), np.minimum(in_y, SIZE // rows - 1 - in_y)
    )
    part: F64 = (from_edge.astype(np.float64) - joint / 2 + 1.0) / 3.0
    return smooth(part), column, row


def mix(low: tuple[int, int, int], high: tuple[int, int, int], part: F64) -> F64:
    """Return a mixture (h, w, 3) of two colours with values in 0 to 255; ``part`` is the share of ``high``, 0 to 1."""
    a = np.array(low, np.float64)
    b = np.array(high, np.float64)
    picture = np.clip(part, 0.0, 1.0)[..., None] * (b - a)
    picture += a
    return picture


def scale_to_brightness(colour: F64, target_mean: float) -> NDArray[np.uint8]:
    """Return a texture scaled to a mean brightness (0 to 255) and rounded.

    The mean is taken of whole numbers, since sums of others differ between machines.
    """
    colour = np.clip(colour, 0.0, 255.0)
    for _ in range(3):  # repeated, as cutting off what is brighter than white lowers the mean
        mean = int((round_to_pixels(colour).astype(np.int64) * _WEIGHTS).sum()) / (SIZE * SIZE * 10_000)
        colour *= target_mean / mean
        np.clip(colour, 0.0, 255.0, out=colour)
    return round_to_pixels(colour)


def round_to_pixels(colour: F64) -> NDArray[np.uint8]:
    """Return a texture's values rounded to uint8."""
    rounded = np.clip(colour, 0.0, 255.0)
    rounded += 0.5
    return rounded.astype(np.uint8)


Recipe = Callable[[int], F64]  # a seed in, a picture (SIZE, SIZE, 3) of 0 to 255 out
Shade = tuple[int, int, int]


def _recipe(paint: Callable[..., F64]) -> Callable[..., Recipe]:
    """Turn a painter into a function that takes its settings and returns a recipe, which takes the seed."""
    return lambda *settings: partial(paint, *settings)


def _darken(picture: F64, part: F64, depth: float) -> F64:
    """Return a picture whose brightness is reduced by the share ``depth`` where ``part`` is 0, and unchanged at 1."""
    return picture * (1.0 - depth + depth * part)[..., None]


@_recipe
def _plaster(low: Shade, high: Shade, roughness: float, seed: int) -> F64:
    """Paint a plain surface with faint clouds, and with grain by its roughness."""
    part = cloud(4, seed) * 1.6 - 0.3 + roughness * (grain(seed + 50) - 0.5)
    return mix(low, high, part)


@_recipe
def _concrete(low: Shade, high: Shade, seed: int) -> F64:
    """Paint board-formed concrete: fine streaks and pores, without large features that would show the repetition."""
    streaks = 0.6 * soft(16, 256, seed) + 0.4 * soft(32, 128, seed + 1)
    part = 0.5 + 1.1 * (streaks - 0.5) + 0.5 * (cloud(48, seed + 2, 3) - 0.5) + 0.35 * (grain(seed + 9) - 0.5)
    pores = smooth((soft(128, 128, seed + 20) - 0.86) * 12.0)
    return _darken(mix(low, high, part), 1.0 - pores, 0.10)


@_recipe
def _slabs(low: Shade, high: Shade, columns: int, rows: int, joint: int, dark: float, seed: int) -> F64:
    """Paint a floor of slabs, each of its own shade, with dark joints."""
    tile_mask, column, row = tiles(columns, rows, joint)
    slab_shade = scatter(column, row, seed)
    part = 0.30 * slab_shade + 0.70 * cloud(32, seed, 3) + 0.15 * (grain(seed + 3) - 0.5)
    return _darken(mix(low, high, part), tile_mask, dark)


@_recipe
def _bricks(low: Shade, high: Shade, mortar: Shade, columns: int, rows: int, joint: int, seed: int) -> F64:
    """Paint worn bricks in mortar, every other row shifted by half a brick."""
    tile_mask, column, row = tiles(columns, rows, joint, offset=True)
    brick_shade = scatter(column, row, seed)
    part = 0.6 * brick_shade + 0.5 * cloud(32, seed + 5, 4) - 0.05 + 0.14 * (grain(seed + 4) - 0.5)
    brick = mix(low, high, part)
    bed = mix(mortar, (mortar[0] + 28, mortar[1] + 28, mortar[2] + 26), cloud(24, seed + 8, 3))
    worn = smooth((tile_mask - 0.25 * (cloud(32, seed + 7, 2) - 0.4)) * 1.3)
    return bed + worn[..., None] * (brick - bed)


def _checks(seed: int) -> F64:
    """Paint a chequered floor of black and white tiles with veins."""
    x, y = grid()
    side = SIZE // 4
    light = ((x // side + y // side) % 2).astype(np.float64)
    tile_mask, _, _ = tiles(4, 4, 3)
    veins = smooth(1.0 - np.abs(cloud(3, seed + 2, 5) - 0.5) * 26.0)
    picture = _darken(mix((206, 203, 196), (228, 226, 221), cloud(5, seed)), 1.0 - veins, 0.10)
    black = mix((34, 34, 37), (58, 58, 62), cloud(5, seed + 11) + 0.5 * veins)
    picture -= black  # in place, since a first picture takes the most memory here
    picture *= light[..., None]
    picture += black
    return _darken(picture, tile_mask, 0.45)


@_recipe
def _speckled(low: Shade, high: Shade, stones: Shade, seed: int) -> F64:
    """Paint speckled ground with stones."""
    picture = mix(low, high, 0.6 * cloud(8, seed, 4) + 0.4 * soft(170, 170, seed + 40))
    stone = smooth((soft(128, 128, seed + 60) - 0.72) * 8.0)
    picture = picture + (0.55 * stone)[..., None] * (np.array(stones, np.float64) - picture)
    return _darken(picture, grain(seed + 70), 0.20)


@_recipe
def _grass(low: Shade, high: Shade, seed: int) -> F64:
    """Paint grass with blades and darker patches."""
    blades = 0.5 * soft(128, 32, seed) + 0.3 * soft(256, 64, seed + 1) + 0.2 * grain(seed + 2)
    return _darken(mix(low, high, 0.75 * blades + 0.45 * cloud(4, seed + 3, 3) - 0.1), soft(200, 60, seed + 4), 0.35)


@_recipe
def _wood(low: Shade, high: Shade, planks: int, seed: int) -> F64:
    """Paint planks with rings and fibres; the joints between several planks are dark."""
    x, y = grid()
    width = SIZE // planks
    plank = x // width
    shift = (scatter(plank, plank * 0, seed) * SIZE).astype(np.int64)
    along = (y + shift) % SIZE
    bend = cloud(3, seed + 1, 3)[along, x]
    rings = x * (22.0 / SIZE) + 5.0 * bend + 3.0 * scatter(plank, plank * 0, seed + 2)
    ring = np.abs(2.0 * (rings - np.floor(rings)) - 1.0)
    fibre = soft(256, 8, seed + 3)[along, x]
    plank_shade = scatter(plank, plank * 0, seed + 4)
    picture = mix(low, high, 0.45 * ring + 0.30 * fibre + 0.35 * plank_shade - 0.05)
    edge = np.minimum(x % width, width - 1 - x % width)
    if planks > 1:
        return _darken(picture, smooth(edge / 3.0), 0.55)
    return picture


@_recipe
def _marble(low: Shade, high: Shade, vein: Shade, seed: int) -> F64:
    """Paint marble: clouds of two shades with fine veins."""
    picture = mix(low, high, cloud(3, seed, 5))
    fine = smooth(1.0 - np.abs(cloud(2, seed + 5, 6) - 0.5) * 34.0) + 0.6 * smooth(
        1.0 - np.abs(cloud(4, seed + 6, 6) - 0.5) * 40.0
    )
    return picture + np.clip(0.7 * fine, 0.0, 1.0)[..., None] * (np.array(vein, np.float64) - picture)


@_recipe
def _liquid(low: Shade, high: Shade, crest: Shade, cells: int, seed: int) -> F64:
    """Paint a liquid with bright crests."""
    bend = cloud(cells, seed, 5)
    ridge = smooth(1.0 - np.abs(bend - 0.5) * 11.0)
    picture = mix(low, high, cloud(cells, seed + 7, 4) * 1.5 - 0.25)
    return picture + (0.8 * ridge * ridge)[..., None] * (np.array(crest, np.float64) - picture)


def _ceiling_tiles(seed: int) -> F64:
    """Paint ceiling tiles with small holes and dark joints."""
    tile_mask, _, _ = tiles(4, 4, 5)
    holes = smooth((soft(110, 110, seed) - 0.74) * 14.0)
    return _darken(_darken(mix((196, 195, 190), (214, 213, 208), grain(seed + 1)), 1.0 - holes, 0.10), tile_mask, 0.65)


@_recipe
def _panel(base: Shade, inset: int, rows: int, seed: int) -> F64:
    """Paint a door or a box: a frame with sunken panels."""
    x, y = grid()
    height = SIZE // rows
    inside = np.minimum(np.minimum(x, SIZE - 1 - x), np.minimum(y % height, height - 1 - y % height)) - inset
    rim = smooth(1.0 - np.abs(inside.astype(np.float64)) / 5.0)
    colour = np.array(base, np.float64) * (0.92 + 0.12 * cloud(4, seed, 5))[..., None]
    return _darken(colour, 1.0 - rim, 0.40) * np.where(inside > 0, 0.95, 1.0)[..., None]


@_recipe
def _grille(bar: Shade, pitch: int, seed: int) -> F64:
    """Paint a grille of metal bars over dark holes."""
    x, y = grid()
    across = np.minimum(np.abs(x % pitch - pitch // 2), np.abs(y % pitch - pitch // 2)).astype(np.float64)
    metal = mix((bar[0] - 40, bar[1] - 40, bar[2] - 40), bar, 1.0 - across / (pitch * 0.25) + 0.2 * cloud(6, seed))
    hole = smooth((across - pitch * 0.2) / 3.0)
    return metal + hole[..., None] * (np.array((18.0, 19.0, 21.0)) - metal)


def _fence(seed: int) -> F64:
    """Paint a wooden fence with gaps that show grass."""
    x, y = grid()
    wood = _wood((196, 190, 178), (236, 232, 222), 4)(seed)
    # between the pickets, except where one of the two rails is behind
    gap = (x % 128 > 92) & ~((y > 130) & (y < 180)) & ~((y > 360) & (y < 410))
    return np.where(gap[..., None], np.array((74.0, 104.0, 62.0)), wood)


def _logo(seed: int) -> F64:
    """Paint a framed sign: a maze from above, with an agent and the path to its goal."""
    x, y = grid()
    picture = mix((236, 233, 224), (246, 244, 238), cloud(3, seed))
    for x0, y0, x1, y1 in (  # the walls of the maze
        *((40, 60, 472, 76), (40, 436, 472, 452), (40, 60, 56, 452), (456, 60, 472, 452)),
        *((180, 60, 196, 320), (320, 200, 336, 452), (180, 304, 260, 320)),
    ):
        picture[y0:y1, x0:x1] = (38.0, 52.0, 82.0)
    # the agent and its goal, and then the path in dots
    for cx, cy, r, colour in ((112, 360, 40, (214, 52, 44)), (398, 130, 44, (36, 158, 92))):
        picture[(x - cx) * (x - cx) + (y - cy) * (y - cy) < r * r] = colour
    for dot in range(6):
        cx = 170 + 36 * dot
        cy = 392 - 12 * dot if dot < 3 else 368 - 60 * (dot - 2)
        picture[(x - cx) * (x - cx) + (y - cy) * (y - cy) < 90] = (140.0, 140.0, 150.0)
    return picture


_GREY = ((140, 139, 135), (172, 171, 167))
_BOX = _panel((186, 148, 100), 8, 1)
_WATER = _liquid((18, 62, 104), (48, 116, 158), (170, 214, 230), 4)

# How many metres a picture covers, right and up, and its mean brightness, 0 to 255, by sRGB's weights. They are those
# of the picture of that name in Miniworld, so that motion and brightness look the same.
Kind = tuple[float, float, float]

# name: (recipe, its variants)
RECIPES: dict[str, tuple[Recipe, tuple[Kind, ...]]] = {
    "airduct_grate": (_grille((150, 152, 156), 64), ((1.0, 1.0, 162.0),)),
    "asphalt": (_speckled((52, 52, 55), (84, 84, 87), (128, 126, 122)), ((1.0, 1.0, 109.0),)),
    "brick_wall": (_bricks((112, 62, 50), (160, 104, 86), (140, 134, 124), 8, 24, 4), ((2.0, 2.0, 102.0),)),
    "cardboard": (_BOX, ((1.0, 1.0, 158.0), (1.0, 1.0, 158.0), (2.0, 2.0, 177.0), (0.5, 0.5, 188.0))),
    "ceiling_tile_noborder": (_plaster((196, 195, 190), (214, 213, 208), 0.5), ((1.0, 1.0, 217.0),)),
    "ceiling_tiles": (_ceiling_tiles, ((1.0, 1.0, 208.0),)),
    "cinder_blocks": (_bricks((128, 128, 124), (156, 156, 150), (80, 79, 75), 4, 8, 4), ((2.0, 2.0, 114.0),)),
    "concrete": (_concrete(*_GREY), ((1.0, 1.0, 152.0), (1.0, 1.0, 133.0), (1.5, 1.5, 176.0), (1.0, 1.0, 133.0))),
    "concrete_tiles": (_slabs((154, 154, 152), (176, 176, 173), 3, 3, 2, 0.40), ((1.5, 1.5, 161.0),)),
    "door_doom": (_panel((122, 118, 114), 36, 3), ((2.0, 2.0, 121.0), (2.0, 2.0, 122.0))),
    "door_garage_red": (_panel((208, 82, 84), 20, 8), ((2.0, 2.0, 110.0),)),
    "door_garage_white": (_panel((226, 226, 222), 20, 8), ((2.0, 2.0, 223.0),)),
    "door_steel_brown": (_panel((124, 88, 62), 44, 2), ((1.17, 2.2, 93.0),)),
    "door_steel_grey": (_panel((126, 138, 152), 44, 2), ((1.0, 2.0, 137.0),)),
    "door_steel_red": (_panel((198, 112, 102), 44, 2), ((1.0, 2.0, 132.0),)),
    "drywall": (_plaster((208, 209, 210), (220, 220, 220), 0.25), ((1.0, 1.0, 214.0),)),
    "floor_tiles_bw": (_checks, ((1.0, 1.0, 133.0),)),
    "floor_tiles_white": (_slabs((206, 206, 204), (232, 232, 230), 4, 4, 3, 0.25), ((1.0, 1.0, 227.0),)),
    "grass": (_grass((52, 82, 26), (132, 160, 66)), ((2.0, 2.0, 114.0), (2.0, 2.0, 82.0))),
    "lava": (_liquid((96, 16, 6), (204, 66, 12), (255, 214, 84), 4), ((1.0, 1.0, 121.0), (1.0, 1.0, 90.0))),
    "logo_mila": (_logo, ((2.0, 1.0, 219.0),)),
    "marble": (_marble((212, 208, 202), (238, 236, 232), (132, 130, 136)), ((1.0, 1.0, 188.0), (1.0, 1.0, 184.0))),
    "metal_grill": (_grille((142, 146, 152), 32), ((1.0, 1.0, 132.0), (2.0, 2.0, 120.0))),
    "picket_fence": (_fence, ((0.855, 1.273, 191.0),)),
    "rock": (_speckled((88, 86, 82), (150, 148, 142), (174, 172, 166)), ((2.0, 2.0, 117.0),)),
    "slime": (_liquid((40, 84, 10), (110, 160, 14), (190, 226, 40), 5), ((1.0, 1.0, 150.0),)),
    "stucco": (_plaster((182, 181, 178), (206, 205, 202), 0.9), ((1.0, 1.0, 194.0),)),
    "water": (_WATER, ((1.0, 1.0, 129.0), (1.0, 1.0, 136.0), (1.0, 1.0, 126.0))),
    "white": (_plaster((255, 255, 255), (255, 255, 255), 0.0), ((1.0, 1.0, 255.0),)),
    "wood": (_wood((112, 74, 40), (178, 128, 78), 1), ((1.0, 1.0, 118.0), (1.0, 1.0, 161.0))),
    "wood_planks": (_wood((104, 70, 42), (170, 124, 80), 8), ((2.0, 2.0, 88.0),)),
}
