"""Outlines: where the walls of a plan of cells are, as straight segments. Knows no world and compiles nothing."""

import numpy as np
from numpy.typing import NDArray


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
