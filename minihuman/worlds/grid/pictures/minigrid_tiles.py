"""Minigrid's tiles: its shapes and colours (minigrid 3.2, `core/world_object.py`), with its sampling.

Each pixel is the average of three samples in each direction; a lit tile is lightened before averaging. Every pixel is
therefore the same as Minigrid's, and a policy that was trained on its pictures sees the same ones.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core import cells
from minihuman.worlds.grid.core.cells import kind_of, state_of
from minihuman.worlds.grid.core.state import FIRST_OWN_KIND
from minihuman.worlds.grid.pictures.tiles import Canvas, colour_rgb

if TYPE_CHECKING:
    from minihuman.worlds.grid.object_kinds import ObjectKind

FINE = 3  # samples along a pixel's side
LIT = 0.30  # how much lighter a lit tile is, from 0 to 1 for white
# the lines between tiles: their colour, and their width in tiles
LINE = (100, 100, 100)
EDGE = 0.031
Samples = NDArray[np.uint8]  # (3 px, 3 px, 3)
Inside = NDArray[np.bool_]  # (3 px, 3 px)


def minigrid_tile(
    code: int, size_px: int, *, facing: int | None = None, lit: bool = False, kinds: "Sequence[ObjectKind]" = ()
) -> NDArray[np.uint8]:
    """Return the picture of a cell as Minigrid draws it, uint8[size_px, size_px, 3].

    Args:
        code: the code of the cell.
        size_px: the number of pixels on a side.
        facing: the direction of the agent in the cell: 0 right, 1 down, 2 left, 3 up; None for no agent.
        lit: whether the agent sees the cell, which is then lighter.
        kinds: the world's own kinds.
    """
    board = _Board(FINE * size_px)
    board.fill(board.box(0, EDGE, 0, 1), LINE)
    board.fill(board.box(0, 1, 0, EDGE), LINE)
    _draw_object(board, code, kinds)
    if facing is not None:
        board.fill(board.arrow(facing), (255, 0, 0))
    samples = board.samples
    if lit:
        samples = (samples + LIT * (255 - samples)).astype(np.uint8)
    fine = samples.reshape(size_px, FINE, size_px, FINE, 3)
    return fine.mean(axis=3).mean(axis=1).astype(np.uint8)


class _Board:
    """A tile that is being drawn, as samples. Coordinates are 0 to 1 across the tile, x to the right and y down."""

    def __init__(self, size: int) -> None:
        self.x, self.y = _sample_centres(size)
        self.samples: Samples = np.zeros((size, size, 3), np.uint8)

    def fill(self, inside: Inside, colour: Sequence[float]) -> None:
        self.samples[inside] = np.array(colour).astype(np.uint8)

    def box(self, left: float, right: float, top: float, bottom: float) -> Inside:
        inside: Inside = (self.x >= left) & (self.x <= right) & (self.y >= top) & (self.y <= bottom)
        return inside

    def disc(self, x: float, y: float, radius: float) -> Inside:
        inside: Inside = (self.x - x) * (self.x - x) + (self.y - y) * (self.y - y) <= radius * radius
        return inside

    def bar(self, x0: float, y0: float, x1: float, y1: float, radius: float) -> Inside:
        """Return the samples within ``radius`` of the line from (x0, y0) to (x1, y1), as Minigrid computes them.

        The ends of the line are rounded to single precision.
        """
        start = np.array([x0, y0], np.float32)
        end = np.array([x1, y1], np.float32)
        along = end - start
        length = np.linalg.norm(along)
        along = along / length
        x = self.x - start[0].astype(float)
        y = self.y - start[1].astype(float)
        projection = np.clip(x * along[0] + y * along[1], 0, length)
        near: Inside = np.hypot(x - projection * along[0], y - projection * along[1]) <= radius
        return near & self.box(min(x0, x1) - radius, max(x0, x1) + radius, min(y0, y1) - radius, max(y0, y1) + radius)

    def arrow(self, facing: int) -> Inside:
        """Return the samples inside the agent, a triangle that points right (0), down (1), left (2) or up (3)."""
        turn = -0.5 * np.pi * facing
        x = self.x - 0.5
        y = self.y - 0.5
        x, y = 0.5 + x * np.cos(turn) - y * np.sin(turn), 0.5 + y * np.cos(turn) + x * np.sin(turn)
        # barycentric coordinates u and v, computed as Minigrid computes them
        a, b, c = np.array([(0.12, 0.19), (0.87, 0.50), (0.12, 0.81)], np.float32)
        to_c = c - a
        to_b = b - a
        x = x - a[0].astype(float)
        y = y - a[1].astype(float)
        cc = np.dot(to_c, to_c)
        cb = np.dot(to_c, to_b)
        bb = np.dot(to_b, to_b)
        cp = to_c[0] * x + to_c[1] * y
        bp = to_b[0] * x + to_b[1] * y
        scale = 1 / (cc * bb - cb * cb)
        u = (bb * cp - cb * bp) * scale
        v = (cc * bp - cb * cp) * scale
        inside: Inside = (u >= 0) & (v >= 0) & (u + v < 1)
        return inside


@cache
def _sample_centres(size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    centres = (np.arange(size) + 0.5) / size
    y, x = np.meshgrid(centres, centres, indexing="ij")
    return x, y


def _draw_object(board: _Board, code: int, kinds: "Sequence[ObjectKind]") -> None:
    """Draw what a cell with this code contains, over the floor; ``kinds`` are the world's own kinds."""
    colour = colour_rgb(code, "minigrid")
    kind = kind_of(code)
    state = state_of(code)
    if kind >= FIRST_OWN_KIND:
        canvas = Canvas(len(board.samples))
        kinds[kind - FIRST_OWN_KIND].draw(canvas, colour, cells.DOOR_STATES[state])
        under = board.samples * (1 - canvas.alpha[..., None])
        board.samples = (under + canvas.rgb * canvas.alpha[..., None]).astype(np.uint8)
    for shape, measures, share in _DOORS[state] if kind == cells.DOOR else _OBJECTS.get(kind, ()):
        board.fill(shape(board, *measures), [share * part for part in colour])


Part = tuple[Callable[..., Inside], tuple[float, ...], float]  # a shape, its measures, how much of the colour it has
_WHOLE: Part = (_Board.box, (0, 1, 0, 1), 1)
_OBJECTS: Mapping[int, tuple[Part, ...]] = MappingProxyType(
    {
        cells.WALL: (_WHOLE,),
        cells.GOAL: (_WHOLE,),
        cells.FLOOR: ((_Board.box, (EDGE, 1, EDGE, 1), 0.5),),
        cells.LAVA: (
            _WHOLE,
            *(
                (_Board.bar, (*start, *end, 0.03), 0)
                for low, high in ((0.3 + 0.2 * i, 0.3 + 0.2 * i + 0.1) for i in range(3))
                for start, end in pairwise(((0.1, low), (0.3, high), (0.5, low), (0.7, high), (0.9, low)))
            ),
        ),
        cells.KEY: (
            (_Board.box, (0.50, 0.63, 0.31, 0.88), 1),
            (_Board.box, (0.38, 0.50, 0.59, 0.66), 1),
            (_Board.box, (0.38, 0.50, 0.81, 0.88), 1),
            (_Board.disc, (0.56, 0.28, 0.190), 1),
            (_Board.disc, (0.56, 0.28, 0.064), 0),
        ),
        cells.BALL: ((_Board.disc, (0.5, 0.5, 0.31), 1),),
        cells.BOX: (
            (_Board.box, (0.12, 0.88, 0.12, 0.88), 1),
            (_Board.box, (0.18, 0.82, 0.18, 0.82), 0),
            (_Board.box, (0.16, 0.84, 0.47, 0.53), 1),
        ),
    }
)
_DOORS: Mapping[int, tuple[Part, ...]] = MappingProxyType(
    {
        cells.OPEN: ((_Board.box, (0.88, 1.00, 0.00, 1.00), 1), (_Board.box, (0.92, 0.96, 0.04, 0.96), 0)),
        cells.CLOSED: (
            _WHOLE,
            (_Board.box, (0.04, 0.96, 0.04, 0.96), 0),
            (_Board.box, (0.08, 0.92, 0.08, 0.92), 1),
            (_Board.box, (0.12, 0.88, 0.12, 0.88), 0),
            (_Board.disc, (0.75, 0.50, 0.08), 1),
        ),
        cells.LOCKED: (
            _WHOLE,
            (_Board.box, (0.06, 0.94, 0.06, 0.94), 0.45),
            (_Board.box, (0.52, 0.75, 0.50, 0.56), 1),
        ),
    }
)
