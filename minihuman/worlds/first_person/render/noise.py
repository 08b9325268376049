"""Noise and patterns from which textures are painted: seeded, repeating, and the same on every machine.

Only +, -, x, / and comparisons of single elements are used, for sines and sums over arrays differ between machines.
All functions work on arrays in 0 to 1 over a square of ``SIZE`` texels that joins itself at its edges.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.tables import F64

SIZE = 512
Grid = NDArray[np.int64]
_WEIGHTS = np.array([2126, 7152, 722])  # how bright red, green and blue are, by sRGB


def grid() -> tuple[Grid, Grid]:
    """Column and row of every texel; rows grow downwards."""
    rows, columns = np.meshgrid(np.arange(SIZE, dtype=np.int64), np.arange(SIZE, dtype=np.int64), indexing="ij")
    return columns, rows


def scatter(x: Grid, y: Grid, seed: int) -> F64:
    """An even random number for each pair of whole numbers, 0 to 1."""
    value = (x * 0x9E3779B1 + y * 0x85EBCA77 + seed * 0xC2B2AE3D) & 0xFFFFFFFF
    value = ((value ^ (value >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    value = ((value ^ (value >> 12)) * 0x297A2D39) & 0xFFFFFFFF
    return ((value ^ (value >> 15)) & 0xFFFF) / 65536.0


def smooth(part: F64) -> F64:
    """From 0 to 1 with level ends."""
    part = np.clip(part, 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)


def soft(cells_x: int, cells_y: int, seed: int) -> F64:
    """Random numbers on a coarse grid, blended smoothly between, and repeating."""
    lattice_x, lattice_y = np.meshgrid(np.arange(cells_x), np.arange(cells_y))
    lattice = scatter(lattice_x.astype(np.int64), lattice_y.astype(np.int64), seed)
    at_x, at_y = (
        np.arange(SIZE, dtype=np.float64) * (cells_x / SIZE),
        np.arange(SIZE, dtype=np.float64) * (cells_y / SIZE),
    )
    left, low = at_x.astype(np.int64), at_y.astype(np.int64)
    fx, fy = smooth(at_x - left)[None, :], smooth(at_y - low)[:, None]
    right, high = (left + 1) % cells_x, (low + 1) % cells_y
    first, second = lattice[low], lattice[high]
    top = first[:, left] + fx * (first[:, right] - first[:, left])
    bottom = second[:, left] + fx * (second[:, right] - second[:, left])
    return top + fy * (bottom - top)


def cloud(cells: int, seed: int, octaves: int = 5) -> F64:
    """Soft noise with ever finer detail, around 0.5."""
    total, weight, amplitude = np.zeros((SIZE, SIZE)), 0.0, 1.0
    for octave in range(octaves):
        total = total + amplitude * soft(cells << octave, cells << octave, seed + octave)
        weight += amplitude
        amplitude *= 0.5
    return total / weight


def grain(seed: int) -> F64:
    """A random number a texel."""
    return scatter(*grid(), seed)


def tiles(columns: int, rows: int, joint: int, *, offset: bool = False) -> tuple[F64, Grid, Grid]:
    """Tiles in rows, every other row moved by half a tile if ``offset``: 1 on a tile, 0 in a joint, and which tile."""
    x, y = grid()
    row = y * rows // SIZE
    moved = (x + (row % 2) * (SIZE // columns // 2) if offset else x) * columns
    column = moved // SIZE % columns
    in_x, in_y = moved % SIZE // columns, y * rows % SIZE // rows
    from_edge: Grid = np.minimum(
        np.minimum(in_x, SIZE // columns - 1 - in_x), np.minimum(in_y, SIZE // rows - 1 - in_y)
    )
    part: F64 = (from_edge.astype(np.float64) - joint / 2 + 1.0) / 3.0
    return smooth(part), column, row


def mix(low: tuple[int, int, int], high: tuple[int, int, int], part: F64) -> F64:
    """Between two colours (0 to 255), (h, w, 3)."""
    a, b = np.array(low, np.float64), np.array(high, np.float64)
    picture = np.clip(part, 0.0, 1.0)[..., None] * (b - a)
    picture += a
    return picture


def as_bright(colour: F64, wanted: float) -> NDArray[np.uint8]:
    """What a texture holds: so bright on average, 0 to 255, and rounded.

    The mean is taken of whole numbers, for sums of others differ between machines.
    """
    colour = np.clip(colour, 0.0, 255.0)
    for _ in range(3):  # what would be brighter than white is cut off, and then a little is missing
        mean = int((pixels(colour).astype(np.int64) * _WEIGHTS).sum()) / (SIZE * SIZE * 10_000)
        colour *= wanted / mean
        np.clip(colour, 0.0, 255.0, out=colour)
    return pixels(colour)


def pixels(colour: F64) -> NDArray[np.uint8]:
    """Rounded to what a texture holds."""
    rounded = np.clip(colour, 0.0, 255.0)
    rounded += 0.5
    return rounded.astype(np.uint8)
