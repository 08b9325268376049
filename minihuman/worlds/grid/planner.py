"""The expert: shortest action sequences on the real rules, turns counted."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.grid.cells import GOAL, LAVA, kind_of, lets_pass
from minihuman.worlds.grid.state import HEADER, HEIGHT, WIDTH, Row, State
from minihuman.worlds.grid.tasks import FORWARD, LEFT, RIGHT

FAR = np.iinfo(np.int32).max


def plan(state: State) -> list[int] | None:
    """The shortest list of actions that succeeds from this state; None if there is none. The state is not changed."""
    row = state.row
    steps = distances(row, np.flatnonzero(kind_of(state.cells.ravel()) == GOAL))
    (x, y), direction = state.position, state.direction
    if steps[x, y, direction] == FAR:
        return None
    actions = []
    while steps[x, y, direction] > 0:
        action, x, y, direction = _next(steps, x, y, direction)
        actions.append(action)
    return actions


def _next(steps: NDArray[np.int32], x: int, y: int, direction: int) -> tuple[int, int, int, int]:
    dx, dy = (1, 0, -1, 0)[direction], (0, 1, 0, -1)[direction]
    choices = (
        (FORWARD, x + dx, y + dy, direction),
        (LEFT, x, y, (direction + 3) % 4),
        (RIGHT, x, y, (direction + 1) % 4),
    )
    return next(choice for choice in choices if steps[choice[1:]] == steps[x, y, direction] - 1)


@njit(cache=True)
def distances(row: Row, targets: NDArray[np.int64]) -> NDArray[np.int32]:
    """Actions from each pose (x, y, direction) to any of the target cells (x * height + y), turning and walking only.

    Lava is never walked on, and nothing is opened or moved; FAR where there is no way.
    """
    width, height = row[WIDTH], row[HEIGHT]
    steps = np.full((width, height, 4), FAR, np.int32)
    queue = np.empty((width * height * 4, 3), np.int64)
    head = tail = 0
    for target in targets:
        for direction in range(4):
            x, y = target // height, target % height
            steps[x, y, direction] = 0
            queue[tail] = x, y, direction
            tail += 1
    while head < tail:
        x, y, direction = queue[head]
        head += 1
        ahead = steps[x, y, direction] + 1
        for turn in (1, 3):
            other = (direction + turn) % 4
            if steps[x, y, other] == FAR:
                steps[x, y, other] = ahead
                queue[tail] = x, y, other
                tail += 1
        from_x = x - (1 - direction) * (1 - direction % 2)
        from_y = y - (2 - direction) * (direction % 2)
        if 0 <= from_x < width and 0 <= from_y < height and steps[from_x, from_y, direction] == FAR:
            code = row[HEADER + from_x * height + from_y]
            kind = kind_of(code)
            if lets_pass(code) and kind != GOAL and kind != LAVA:
                steps[from_x, from_y, direction] = ahead
                queue[tail] = from_x, from_y, direction
                tail += 1
    return steps
