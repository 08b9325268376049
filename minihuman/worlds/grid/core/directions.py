"""Directions: 0 right, 1 down, 2 left, 3 up, and the cell that lies there."""

from minihuman.worlds.kernels import inlined

STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))  # by direction: columns, rows


@inlined
def ahead(x: int, y: int, direction: int) -> tuple[int, int]:
    """The next cell in a direction, in the grid or not; ``direction ^ 2`` is the opposite one."""
    return x + (1 - direction) * (1 - direction % 2), y + (2 - direction) * (direction % 2)
