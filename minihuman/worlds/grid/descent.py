"""Reads a list of actions from a table of distances."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core import rewards
from minihuman.worlds.grid.core.cells import STEPS


def descend(steps: NDArray[np.int32], x: int, y: int, direction: int) -> list[int]:
    """Return the actions, turns and steps, from a pose to the nearest pose with distance 0.

    Args:
        steps: the number of actions from each pose [x, y, direction] to the nearest of these poses, as
            `core.search.distances` returns them; the first pose must not have FAR.
        x: the column of the first pose.
        y: the row of the first pose.
        direction: the direction of the first pose.
    """
    actions = []
    while steps[x, y, direction] > 0:
        dx, dy = STEPS[direction]
        choices = {
            rewards.FORWARD: (x + dx, y + dy, direction),
            rewards.LEFT: (x, y, (direction + 3) % 4),
            rewards.RIGHT: (x, y, (direction + 1) % 4),
        }
        for action, pose in choices.items():
            is_inside = 0 <= pose[0] < len(steps) and 0 <= pose[1] < steps.shape[1]
            if is_inside and steps[pose] == steps[x, y, direction] - 1:
                actions.append(action)
                x, y, direction = pose
                break
    return actions
