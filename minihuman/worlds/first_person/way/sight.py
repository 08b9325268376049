"""How far it is at least: the shortest way of a point round the ends of walls."""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import kernel


@kernel()
def shortest_way(barriers: NDArray[np.float64], nodes: NDArray[np.float64]) -> float:
    """The length of the shortest line from the first node to the second that crosses no barrier; infinite if none.

    ``barriers`` is (n, 4): x0, z0, x1, z1, and may be touched; ``nodes`` is (m, 2): x, z, where the line may bend.
    """
    count = nodes.shape[0]
    reached = np.full(count, np.inf)
    done = np.zeros(count, np.bool_)
    reached[0] = 0.0
    while True:
        here = -1
        for node in range(count):
            if not done[node] and reached[node] < np.inf and (here < 0 or reached[node] < reached[here]):
                here = node
        if here < 0 or here == 1:
            return float(reached[1])
        done[here] = True
        for node in range(count):
            length = math.hypot(nodes[node, 0] - nodes[here, 0], nodes[node, 1] - nodes[here, 1])
            if not done[node] and reached[here] + length < reached[node] and _sees(barriers, nodes[here], nodes[node]):
                reached[node] = reached[here] + length


@kernel()
def lies_on(barriers: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points lie on a barrier, not at its ends."""
    found = np.zeros(points.shape[0], np.bool_)
    for place in range(points.shape[0]):
        x, z = points[place, 0], points[place, 1]
        for index in range(barriers.shape[0]):
            ax, az, bx, bz = barriers[index, 0], barriers[index, 1], barriers[index, 2], barriers[index, 3]
            length = math.hypot(bx - ax, bz - az)
            along = ((x - ax) * (bx - ax) + (z - az) * (bz - az)) / length
            across = ((x - ax) * (bz - az) - (z - az) * (bx - ax)) / length
            if abs(across) < 1e-9 and 1e-6 < along < length - 1e-6:
                found[place] = True
    return found


@kernel()
def _sees(barriers: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    for index in range(barriers.shape[0]):
        c, d = barriers[index, :2], barriers[index, 2:]
        if _side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0:
            return False
    return True


@kernel()
def _side(a: NDArray[np.float64], b: NDArray[np.float64], p: NDArray[np.float64]) -> float:
    """Above 0 left of the line, below 0 right of it, and 0 where rounding could not tell."""
    turn = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    return 0.0 if abs(turn) < 1e-9 else turn
