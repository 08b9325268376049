"""The floor plan: a grid's walls as outlines and its things by name, enough to draw paths without the world."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.contract import Palette
from minihuman.worlds.grid.cells import COLOURS, EMPTY, KINDS, LAVA, WALL, colour_of, kind_of
from minihuman.worlds.grid.palettes import hex_colour
from minihuman.worlds.grid.state import State
from minihuman.worlds.pose import Map, Thing


def floor_plan(state: State, palette: Palette = "classic") -> Map:
    """The map of a state: wall outlines, and every thing that lies in a cell now."""
    kinds = kind_of(state.cells)
    walls = wall_outlines(kinds == WALL)
    things = []
    for x, y in np.argwhere((kinds != WALL) & (kinds != EMPTY)).tolist():
        code = int(state.cells[x, y])
        kind, colour = KINDS[kind_of(code)], COLOURS[colour_of(code)]
        name = kind if kind_of(code) == LAVA else f"{colour} {kind}"
        things.append(Thing(name, float(x), float(y), 0.5, hex_colour(code, palette)))
    bounds = (-0.5, -0.5, state.width - 0.5, state.height - 0.5)
    return Map("cell", bounds, walls, tuple(things))


def wall_outlines(is_wall: NDArray[np.bool_]) -> tuple[tuple[float, float, float, float], ...]:
    """Where wall meets no wall, as the longest straight segments x0, z0, x1, z1.

    Args:
        is_wall: bool[width, height], indexed column, row; cell (c, r) is the unit square centred on (c, r).
    """
    solid = np.pad(is_wall, 1)
    upright = _runs(solid[1:, 1:-1] != solid[:-1, 1:-1])
    level = _runs((solid[1:-1, 1:] != solid[1:-1, :-1]).T)
    walls = [(edge, start, edge, end) for edge, start, end in upright]
    walls += [(start, edge, end, edge) for edge, start, end in level]
    return tuple(walls)


def _runs(edges: NDArray[np.bool_]) -> list[tuple[float, float, float]]:
    """Where a wall's face is, joined into longest runs: line, start, end, in cells."""
    padded = np.pad(edges, ((0, 0), (1, 1))).astype(np.int8)
    turns = np.diff(padded, axis=1)
    starts, ends = np.argwhere(turns == 1), np.argwhere(turns == -1)
    return [(line - 0.5, start - 0.5, end - 0.5) for (line, start), (_, end) in zip(starts, ends, strict=True)]
