"""Belief: a state as far as an agent has seen it. What it has not seen is wall, and holds nothing.

Only the agent moves things, so what was seen once stays known. What boxes contain is not known.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import CLOSED, DOOR, EMPTY, FLOOR, GOAL, OPEN, in_state, kind_of, state_of
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import (
    DIRECTION,
    HEADER,
    HEIGHT,
    NOWHERE,
    OBJECTS,
    WIDTH,
    Row,
    X,
    Y,
    where_is,
)
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.kernels import kernel, part

Seen = NDArray[np.bool_]  # by cell, x * height + y


@part()
def look_into(row: Row, image: NDArray[np.uint8], seen: Seen) -> int:
    """Mark the cells that the image shows; how many of them are new."""
    size = image.shape[0]
    width, height = row[WIDTH], row[HEIGHT]
    direction = row[DIRECTION]
    forward_x, forward_y = (1 - direction) * (1 - direction % 2), (2 - direction) * (direction % 2)
    new = 0
    for i in range(size):
        for j in range(size):
            if image[i, j, 0] != 0:
                ahead, aside = size - 1 - j, i - size // 2
                x = row[X] + forward_x * ahead - forward_y * aside
                y = row[Y] + forward_y * ahead + forward_x * aside
                if x >= 0 and y >= 0 and x < width and y < height and not seen[x * height + y]:
                    seen[x * height + y] = True
                    new += 1
    return new


@kernel()
def remember(row: Row, image: NDArray[np.uint8], seen: Seen) -> int:
    """Add what the agent sees now to what it has seen; how many cells are new. ``image`` is filled."""
    see(row, image)
    return look_into(row, image, seen)


@kernel()
def believe(row: Row, seen: Seen, hidden: int) -> Row:
    """The state as far as it was seen; cells not seen hold the code ``hidden``."""
    known = row.copy()
    cells = row[WIDTH] * row[HEIGHT]
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell != NOWHERE and not seen[cell]:
            known[HEADER + cells + identity - 1] = NOWHERE
        known[HEADER + 2 * cells + identity - 1] = 0
    for cell in range(cells):
        if not seen[cell]:
            known[HEADER + cell] = hidden
    return known


@kernel()
def prospects(row: Row, seen: Seen, steps: NDArray[np.int32], image: NDArray[np.uint8]) -> NDArray[np.int32]:
    """For each pose that can be reached how many cells would be seen for the first time, (width, height, 4).

    What is not known hides nothing; a closed door ahead is opened first.
    """
    open_world = believe(row, seen, EMPTY)
    width, height = row[WIDTH], row[HEIGHT]
    gains = np.zeros((width, height, 4), np.int32)
    guess = np.empty_like(seen)
    for x in range(width):
        for y in range(height):
            for direction in range(4):
                if steps[x, y, direction] >= FAR or not seen[x * height + y]:
                    continue
                open_world[X], open_world[Y], open_world[DIRECTION] = x, y, direction
                i, j = x + (1 - direction) * (1 - direction % 2), y + (2 - direction) * (direction % 2)
                ahead = -1
                code = 0
                if i >= 0 and j >= 0 and i < width and j < height:
                    ahead = HEADER + i * height + j
                    code = int(open_world[ahead])
                    if kind_of(code) == DOOR and state_of(code) == CLOSED:
                        open_world[ahead] = in_state(code, OPEN)
                see(open_world, image)
                guess[:] = seen
                gains[x, y, direction] = look_into(open_world, image, guess)
                if ahead >= 0:
                    open_world[ahead] = code
    return gains


@kernel()
def walk(row: Row, passing: int) -> NDArray[np.int32]:
    """Actions from the agent's pose to every other, (width, height, 4), closed doors opened on the way.

    Things in the way cost ``passing`` more actions; 0 bars the way.
    """
    width, height = np.int64(row[WIDTH]), np.int64(row[HEIGHT])
    steps = np.full(width * height * 4, FAR, np.int32)
    start = (row[X] * height + row[Y]) * 4 + row[DIRECTION]
    steps[start] = 0
    span = 64
    queue = np.empty((span, len(steps)), np.int32)
    waiting = np.zeros(span, np.int64)
    queue[0, 0] = start
    waiting[0] = 1
    last, distance = 0, 0
    while distance <= last:
        place = distance % span
        while waiting[place] > 0:
            waiting[place] -= 1
            pose = queue[place, waiting[place]]
            if steps[pose] != distance:
                continue
            direction = pose & 3
            x, y = (pose >> 2) // height, (pose >> 2) % height
            for move in range(3):
                after, cost = -1, 1
                if move < 2:
                    after = (pose >> 2) * 4 + ((direction + 1 + 2 * move) & 3)
                else:
                    i, j = x + (1 - direction) * (1 - direction % 2), y + (2 - direction) * (direction % 2)
                    if i >= 0 and j >= 0 and i < width and j < height:
                        code = row[HEADER + i * height + j]
                        cost = _entering(code, passing)
                        after = (i * height + j) * 4 + direction if cost > 0 else -1
                if after >= 0 and distance + cost < steps[after]:
                    steps[after] = distance + cost
                    slot = (distance + cost) % span
                    if waiting[slot] < queue.shape[1]:
                        queue[slot, waiting[slot]] = after
                        waiting[slot] += 1
                    last = max(last, distance + cost)
        distance += 1
    return steps.reshape((width, height, 4))


@part()
def _entering(code: int, passing: int) -> int:
    kind = kind_of(code)
    if kind == EMPTY or kind == FLOOR or kind == GOAL:
        return 1
    if kind == DOOR:
        return 1 if state_of(code) == OPEN else 2 if state_of(code) == CLOSED else 0
    if code >> 9 > 0 and passing > 0:
        return 1 + passing
    return 0
