"""Circles against walls: the one test that every move and every placement makes."""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import kernel


@kernel()
def touches_wall(walls: NDArray[np.float64], x: float, z: float, radius: float) -> bool:
    """Does a circle reach a wall? ``walls`` is (n, 4): x0, z0, x1, z1; all metres. Just touching does not count."""
    for index in range(walls.shape[0]):
        ax, az = walls[index, 0], walls[index, 1]
        ab_x, ab_z = walls[index, 2] - ax, walls[index, 3] - az
        share = ((x - ax) * ab_x + (z - az) * ab_z) / (ab_x * ab_x + ab_z * ab_z)
        share = min(max(share, 0.0), 1.0)
        dx, dz = ax + share * ab_x - x, az + share * ab_z - z
        if math.sqrt(dx * dx + dz * dz) < radius:
            return True
    return False
