"""How far it is at least: the shortest way of a point round the ends of walls."""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import kernel, part


def shortest_way(barriers: NDArray[np.float64], nodes: NDArray[np.float64]) -> float:
    """The length of the shortest line from the first node to the second that crosses no barrier; infinite if none.

    ``barriers`` is (n, 4): x0, z0, x1, z1, and may be touched; ``nodes`` is (m, 2): x, z, where the line may bend.
    """
    return _shortest(barriers, nodes, np.full(len(nodes), np.inf), np.zeros(len(nodes), np.bool_))


def lies_on(barriers: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points lie on a barrier, not at its ends."""
    found = np.zeros(len(points), np.bool_)
    _mark(barriers, points, found)
    return found


@kernel(lean=True)
def _shortest(
    barriers: NDArray[np.float64], nodes: NDArray[np.float64], reached: NDArray[np.float64], done: NDArray[np.bool_]
) -> float:
    count = nodes.shape[0]
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
            if not done[node] and reached[here] + length < reached[node] and _sees(barriers, nodes, here, node):
                reached[node] = reached[here] + length


@kernel(lean=True)
def _mark(barriers: NDArray[np.float64], points: NDArray[np.float64], found: NDArray[np.bool_]) -> None:
    for place in range(points.shape[0]):
        x, z = points[place, 0], points[place, 1]
        for index in range(barriers.shape[0]):
            ax, az, bx, bz = barriers[index, 0], barriers[index, 1], barriers[index, 2], barriers[index, 3]
            length = math.hypot(bx - ax, bz - az)
            along = ((x - ax) * (bx - ax) + (z - az) * (bz - az)) / length
            across = ((x - ax) * (bz - az) - (z - az) * (bx - ax)) / length
            if abs(across) < 1e-9 and 1e-6 < along < length - 1e-6:
                found[place] = True


@part(lean=True)
def _sees(barriers: NDArray[np.float64], nodes: NDArray[np.float64], a: int, b: int) -> bool:
    ax, az, bx, bz = nodes[a, 0], nodes[a, 1], nodes[b, 0], nodes[b, 1]
    for index in range(barriers.shape[0]):
        cx, cz, dx, dz = barriers[index, 0], barriers[index, 1], barriers[index, 2], barriers[index, 3]
        if (
            _side(ax, az, bx, bz, cx, cz) * _side(ax, az, bx, bz, dx, dz) < 0
            and _side(cx, cz, dx, dz, ax, az) * _side(cx, cz, dx, dz, bx, bz) < 0
        ):
            return False
    return True


@part(lean=True)
def _side(ax: float, az: float, bx: float, bz: float, x: float, z: float) -> float:
    """Above 0 left of the line from a to b, below 0 right of it, and 0 where rounding could not tell."""
    turn = (bx - ax) * (z - az) - (bz - az) * (x - ax)
    return 0.0 if abs(turn) < 1e-9 else turn
