"""Belief: a state as far as an agent has seen it. What it has not seen is wall, and holds nothing.

Only the agent moves things, so what was seen once stays known. What boxes contain is not known.
"""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    CLOSED,
    DOOR,
    EMPTY,
    FLOOR,
    GOAL,
    GREY_WALL,
    LAVA,
    OPEN,
    WALL,
    in_state,
    kind_of,
    state_of,
)
from minihuman.worlds.grid.core.directions import ahead
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
HALF_VIEW = 4 / 3 * math.tan(math.radians(30))  # of who sees a grid from inside: the tangent of half the angle of view
BACK = 0.4  # cells that the eye stands behind the middle of its own


@part()
def look_into(row: Row, image: NDArray[np.uint8], seen: Seen) -> int:
    """Mark the cells that the image shows; how many of them are new."""
    size = image.shape[0]
    width, height = row[WIDTH], row[HEIGHT]
    direction = row[DIRECTION]
    forward_x, forward_y = ahead(0, 0, direction)
    new = 0
    for i in range(size):
        for j in range(size):
            if image[i, j, 0] != 0:
                far, aside = size - 1 - j, i - size // 2
                x = row[X] + forward_x * far - forward_y * aside
                y = row[Y] + forward_y * far + forward_x * aside
                if x >= 0 and y >= 0 and x < width and y < height and not seen[x * height + y]:
                    seen[x * height + y] = True
                    new += 1
    return new


@part()
def as_from_inside(image: NDArray[np.uint8]) -> None:
    """Leave in an image what somebody sees who stands in the grid: cells within the angle of view, past nothing."""
    size = image.shape[0]
    half = size // 2
    for i in range(size):
        for j in range(size):
            far, aside = size - 1 - j, i - half
            if image[i, j, 0] == 0 or (far == 0 and aside == 0):
                continue
            if abs(aside) > HALF_VIEW * (far + BACK):
                image[i, j, 0] = 0
                continue
            parts = 8 * size
            for k in range(parts):
                across = half + aside * k / parts
                along = size - 1 + BACK - (far + BACK) * k / parts
                c, r = math.floor(across + 0.5), math.floor(along + 0.5)
                if r > size - 1 or (c == i and r == j) or (c == half and r == size - 1):
                    continue
                kind, state = image[c, r, 0], image[c, r, 2]
                if kind == 0 or not (
                    kind == EMPTY or kind == FLOOR or kind == GOAL or kind == LAVA or (kind == DOOR and state == OPEN)
                ):
                    image[i, j, 1] = 255  # hidden; its kind still hides what is behind it
                    break
    for i in range(size):
        for j in range(size):
            if image[i, j, 1] == 255:
                image[i, j, 0] = 0


@kernel()
def remember(row: Row, image: NDArray[np.uint8], seen: Seen, inside: bool) -> int:
    """Add what the agent sees now to what it has seen; how many cells are new. ``image`` is filled.

    From ``inside`` it sees less than Minigrid's view shows.
    """
    see(row, image)
    if inside:
        as_from_inside(image)
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
def prospects(
    row: Row,
    seen: Seen,
    steps: NDArray[np.int32],
    image: NDArray[np.uint8],
    inside: bool,
    straight: int,
    floor: float,
    wall: float,
) -> NDArray[np.float64]:
    """For each pose that can be reached how much would be seen for the first time, (width, height, 4).

    What is not known hides nothing; a closed door ahead is opened first. After ``straight`` cells of wall in a line
    the wall is expected to go on; with 0 none is. A cell counts ``floor``, and ``wall`` where one is expected.
    """
    world = believe(row, seen, EMPTY)
    if straight > 0:
        expect_walls(world, seen, straight)
    width, height = row[WIDTH], row[HEIGHT]
    size = image.shape[0]
    gains = np.zeros((width, height, 4))
    for x in range(width):
        for y in range(height):
            for direction in range(4):
                if steps[x, y, direction] >= FAR or not seen[x * height + y]:
                    continue
                world[X], world[Y], world[DIRECTION] = x, y, direction
                forward_x, forward_y = ahead(0, 0, direction)
                i, j = x + forward_x, y + forward_y
                faced = -1
                code = 0
                if i >= 0 and j >= 0 and i < width and j < height:
                    faced = HEADER + i * height + j
                    code = int(world[faced])
                    if kind_of(code) == DOOR and state_of(code) == CLOSED:
                        world[faced] = in_state(code, OPEN)
                see(world, image)
                if inside:
                    as_from_inside(image)
                for across in range(size):
                    for down in range(size):
                        if image[across, down, 0] != 0:
                            far, aside = size - 1 - down, across - size // 2
                            i = x + forward_x * far - forward_y * aside
                            j = y + forward_y * far + forward_x * aside
                            if i >= 0 and j >= 0 and i < width and j < height and not seen[i * height + j]:
                                expected = kind_of(world[HEADER + i * height + j])
                                gains[x, y, direction] += wall if expected == WALL else floor
                if faced >= 0:
                    world[faced] = code
    return gains


@part()
def expect_walls(row: Row, seen: Seen, straight: int) -> None:
    """Put walls where they are expected and nothing was seen: around the grid, and where a line of them would go on."""
    width, height = row[WIDTH], row[HEIGHT]
    for line in range(2 * (width + height)):  # each column and each line, there and back
        upright = line < 2 * width
        number = (line if upright else line - 2 * width) // 2
        length = height if upright else width
        walls = 0
        for k in range(length):
            along = k if line % 2 == 0 else length - 1 - k
            cell = number * height + along if upright else along * height + number
            kind = kind_of(row[HEADER + cell])
            if not seen[cell]:
                if walls >= straight or k == 0 or k == length - 1:
                    row[HEADER + cell] = GREY_WALL
                if walls < straight:
                    walls = 0
            elif kind == WALL or kind == DOOR:
                walls += 1
            else:
                walls = 0


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
                    i, j = ahead(x, y, direction)
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
