"""Belief state: a grid as far as an agent has seen it, and where the agent would look next.

Cells that have not been seen are treated as walls that hold nothing. Only the agent moves objects, so cells that were
seen once stay known; the contents of boxes are unknown. The code never uses more than the agent was shown.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

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
    STEPS,
    WALL,
    ahead,
    identity_of,
    in_state,
    kind_of,
    kinds_of,
    state_of,
    states_of,
)
from minihuman.worlds.grid.core.rewards import FORWARD, LEFT, RIGHT, TOGGLE
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import (
    DIRECTION,
    HEADER,
    HEIGHT,
    NOWHERE,
    OBJECTS,
    WIDTH,
    Row,
    State,
    X,
    Y,
    contents_index,
    place_index,
    where_is,
)
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.kernels import device_function, kernel

SeenCells = NDArray[np.bool_]  # by cell, x * height + y
HALF_VIEW = 4 / 3 * math.tan(math.radians(30))  # from inside the grid: the tangent of half the angle of view
BACK = 0.4  # cells by which the eye is behind the middle of the agent's cell


@device_function()
def look_into(row: Row, image: NDArray[np.uint8], explored: SeenCells) -> int:
    """Mark the cells that an image of the agent's view shows as explored; return the number of newly explored ones."""
    size = image.shape[0]
    width = row[WIDTH]
    height = row[HEIGHT]
    direction = row[DIRECTION]
    forward_x, forward_y = ahead(0, 0, direction)
    new = 0
    for i in range(size):
        for j in range(size):
            if image[i, j, 0] != 0:
                far = size - 1 - j
                aside = i - size // 2
                x = row[X] + forward_x * far - forward_y * aside
                y = row[Y] + forward_y * far + forward_x * aside
                if x >= 0 and y >= 0 and x < width and y < height and not explored[x * height + y]:
                    explored[x * height + y] = True
                    new += 1
    return new


@device_function()
def as_from_inside(image: NDArray[np.uint8]) -> None:
    """Remove from an image of the agent's view the cells that are not visible from inside the grid.

    The kind of a removed cell becomes 0. The cells that stay are within the angle of view, and nothing hides them.
    """
    size = image.shape[0]
    half = size // 2
    for i in range(size):
        for j in range(size):
            far = size - 1 - j
            aside = i - half
            if image[i, j, 0] == 0 or (far == 0 and aside == 0):
                continue
            if abs(aside) > HALF_VIEW * (far + BACK):
                image[i, j, 0] = 0
                continue
            parts = 8 * size  # of the line from the eye to the cell, on which other cells may hide it
            for k in range(parts):
                across = half + aside * k / parts
                along = size - 1 + BACK - (far + BACK) * k / parts
                c = math.floor(across + 0.5)
                r = math.floor(along + 0.5)
                if r > size - 1 or (c == i and r == j) or (c == half and r == size - 1):
                    continue
                kind = image[c, r, 0]
                state = image[c, r, 2]
                if kind == 0 or not (
                    kind == EMPTY or kind == FLOOR or kind == GOAL or kind == LAVA or (kind == DOOR and state == OPEN)
                ):
                    image[i, j, 1] = 255  # hidden; its kind still hides what is behind it
                    break
    for i in range(size):
        for j in range(size):
            if image[i, j, 1] == 255:
                image[i, j, 0] = 0


@kernel("(int32[::1], uint8[:, :, ::1], boolean[::1], boolean)")
def remember(row: Row, image: NDArray[np.uint8], explored: SeenCells, inside: bool) -> int:
    """Mark the cells that the agent now sees as explored; return the number of newly explored cells.

    ``image``, uint8[view, view, 3], receives the agent's view: Minigrid's, or with ``inside`` only what is visible from
    inside the grid.
    """
    see(row, image)
    if inside:
        as_from_inside(image)
    return look_into(row, image, explored)


@kernel("(int32[::1], boolean[::1], int64)")
def believe(row: Row, explored: SeenCells, hidden: int) -> Row:
    """Return a copy of the state in which all unexplored cells have the code ``hidden``, and all boxes are empty."""
    known = row.copy()
    cells = row[WIDTH] * row[HEIGHT]
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell != NOWHERE and not explored[cell]:
            known[place_index(row, identity)] = NOWHERE
        known[contents_index(row, identity)] = 0
    for cell in range(cells):
        if not explored[cell]:
            known[HEADER + cell] = hidden
    return known


@device_function()
def value_of_new_cells(row: Row, explored: SeenCells, image: NDArray[np.uint8], floor: float, wall: float) -> float:
    """Return the total value of the cells that an image of the agent's view would show for the first time.

    A cell is worth ``floor``, or ``wall`` if it is a wall in ``row``, in which expected walls have been put.
    """
    size = image.shape[0]
    width = row[WIDTH]
    height = row[HEIGHT]
    forward_x, forward_y = ahead(0, 0, row[DIRECTION])
    gain = 0.0
    for across in range(size):
        for down in range(size):
            if image[across, down, 0] != 0:
                far = size - 1 - down
                aside = across - size // 2
                x = row[X] + forward_x * far - forward_y * aside
                y = row[Y] + forward_y * far + forward_x * aside
                if x >= 0 and y >= 0 and x < width and y < height and not explored[x * height + y]:
                    gain += wall if kind_of(row[HEADER + x * height + y]) == WALL else floor
    return gain


@kernel("(int32[::1], boolean[::1], int32[:, :, ::1], uint8[:, :, ::1], boolean, int64, float64, float64)")
def prospects(
    row: Row,
    explored: SeenCells,
    steps: NDArray[np.int32],
    image: NDArray[np.uint8],
    inside: bool,
    straight: int,
    floor: float,
    wall: float,
) -> NDArray[np.float64]:
    """Return the value of the cells that each reachable pose would show for the first time, float64[width, height, 4].

    Unknown cells hide nothing, and a closed door ahead is opened first. ``steps`` is of `walk`, ``image`` is scratch
    space, and ``straight`` is as in `FrontierWeights`. A cell is worth ``floor``, or ``wall`` if a wall is expected.
    """
    world = believe(row, explored, EMPTY)
    if straight > 0:
        expect_walls(world, explored, straight)
    width = row[WIDTH]
    height = row[HEIGHT]
    gains = np.zeros((width, height, 4))
    for x in range(width):
        for y in range(height):
            for direction in range(4):
                if steps[x, y, direction] >= FAR or not explored[x * height + y]:
                    continue
                world[X] = x
                world[Y] = y
                world[DIRECTION] = direction
                forward_x, forward_y = ahead(0, 0, direction)
                i = x + forward_x
                j = y + forward_y
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
                gains[x, y, direction] = value_of_new_cells(world, explored, image, floor, wall)
                if faced >= 0:
                    world[faced] = code
    return gains


@device_function()
def expect_walls(row: Row, explored: SeenCells, straight: int) -> None:
    """Put walls where they are expected in unexplored cells: around the grid, and in line with known walls.

    Args:
        row: the state, which is changed.
        explored: whether each cell was explored.
        straight: the number of known wall cells in a line after which the wall is expected to continue.
    """
    width = row[WIDTH]
    height = row[HEIGHT]
    for line in range(2 * (width + height)):  # columns, then rows: twice each one's number, plus 1 to go backwards
        upright = line < 2 * width
        number = (line if upright else line - 2 * width) // 2
        length = height if upright else width
        walls = 0
        for k in range(length):
            along = k if line % 2 == 0 else length - 1 - k
            if upright:
                cell = number * height + along
            else:
                cell = along * height + number
            kind = kind_of(row[HEADER + cell])
            if not explored[cell]:
                if walls >= straight or k == 0 or k == length - 1:
                    row[HEADER + cell] = GREY_WALL
                if walls < straight:
                    walls = 0
            elif kind == WALL or kind == DOOR:
                walls += 1
            else:
                walls = 0


@kernel("(int32[::1], int64)")
def walk(row: Row, passing: int) -> NDArray[np.int32]:
    """Return the number of actions from the agent's pose to each pose, int32[width, height, 4]; FAR without a path.

    Closed doors are opened on the way. Passing an object costs ``passing`` more actions; with 0, objects block the way.
    """
    width = np.int64(row[WIDTH])
    height = np.int64(row[HEIGHT])
    steps = np.full(width * height * 4, FAR, np.int32)
    start = (row[X] * height + row[Y]) * 4 + row[DIRECTION]
    steps[start] = 0
    span = 64
    queue = np.empty((span, len(steps)), np.int32)
    waiting = np.zeros(span, np.int64)
    queue[0, 0] = start
    waiting[0] = 1
    last = 0
    distance = 0
    while distance <= last:
        place = distance % span
        while waiting[place] > 0:
            waiting[place] -= 1
            pose = queue[place, waiting[place]]
            if steps[pose] != distance:
                continue
            direction = pose & 3
            x = (pose >> 2) // height
            y = (pose >> 2) % height
            for move in range(3):
                after = -1
                cost = 1
                if move < 2:
                    after = (pose >> 2) * 4 + ((direction + 1 + 2 * move) & 3)
                else:
                    i, j = ahead(x, y, direction)
                    if i >= 0 and j >= 0 and i < width and j < height:
                        code = row[HEADER + i * height + j]
                        cost = _entering(code, passing)
                        if cost > 0:
                            after = (i * height + j) * 4 + direction
                        else:
                            after = -1
                if after >= 0 and distance + cost < steps[after]:
                    steps[after] = distance + cost
                    slot = (distance + cost) % span
                    if waiting[slot] < queue.shape[1]:
                        queue[slot, waiting[slot]] = after
                        waiting[slot] += 1
                    last = max(last, distance + cost)
        distance += 1
    return steps.reshape((width, height, 4))


@device_function()
def _entering(code: int, passing: int) -> int:
    """Return the number of actions to enter a cell with this code from the next cell; 0 if it blocks the way.

    Passing an object costs ``passing`` more actions; with 0, objects block the way.
    """
    kind = kind_of(code)
    if kind == EMPTY or kind == FLOOR or kind == GOAL:
        return 1
    if kind == DOOR:
        if state_of(code) == OPEN:
            return 1
        if state_of(code) == CLOSED:
            return 2
        return 0
    if identity_of(code) > 0 and passing > 0:
        return 1 + passing
    return 0


# the default of `FrontierWeights.enough`, in cells: a fixed number, or in smaller grids a sixteenth of all cells
ENOUGH = 30
SMALL = 250  # cells; a grid with fewer is small
LEAST_ENOUGH = 8

Noise = Callable[[int], NDArray[np.float64]]  # takes a number of poses; returns an error for each, in actions


@dataclass(frozen=True, slots=True)
class FrontierWeights:
    """The weights by which the next pose to look from is chosen.

    Attributes:
        worth: the number of actions that one more seen cell is worth.
        enough: the number of cells up to which ``worth`` applies; None for a number that depends on the grid's size.
        share: the share of the grid's cells up to which ``worth`` applies.
        beyond: the number of actions that each seen cell is worth without an upper limit.
        opening: the number of actions that opening a door costs.
        straight: the number of wall cells in a line after which the wall is expected to continue; walls are then also
            expected around the grid. With 0, no wall is expected where none was seen.
        floor: the value of a cell.
        wall: the value of a cell in which a wall is expected.
    """

    worth: float
    enough: int | None = None
    share: float = 1.0
    beyond: float = 0.0
    opening: float = 1.0
    straight: int = 0
    floor: float = 1.0
    wall: float = 1.0


# fitted on the levels: what the expert goes by, and where only a door is looked for, and what people go by
EXPERT_WEIGHTS = FrontierWeights(0.6, share=0.2, beyond=0.05, straight=3, wall=0.8)
DOOR_WEIGHTS = FrontierWeights(0.8, 6, beyond=0.02, opening=4.0, straight=2, floor=0.35)
PEOPLE_WEIGHTS = FrontierWeights(0.3)


def no_noise(count: int) -> NDArray[np.float64]:
    """Return an error of 0 for each of ``count`` poses, as a `Noise` that does nothing."""
    return np.zeros(count)


class ExploredGrid:
    """The part of a grid that an agent has seen in one episode.

    Args:
        row: the world's state at the beginning of the episode.
        view_size: the number of cells on a side of the agent's view.
        inside: whether the view is first-person instead of from above.
    """

    def __init__(self, row: Row, view_size: int = 7, *, inside: bool = False) -> None:
        self._inside = inside
        state = State(row)
        self.seen = np.zeros(state.width * state.height, np.bool_)  # by cell, x * height + y
        cells = len(self.seen)
        if cells >= SMALL:
            self._enough = ENOUGH
        else:
            self._enough = max(LEAST_ENOUGH, cells // 16)
        self._image = np.zeros((view_size, view_size, 3), np.uint8)
        self.look(row)

    def look(self, row: Row) -> int:
        """Remember the cells that are visible now; return the number of newly seen cells."""
        return int(remember(row, self._image, self.seen, self._inside))

    def in_view(self, row: Row) -> NDArray[np.bool_]:
        """Return which cells are visible now, bool[width * height], by cell x * height + y."""
        is_visible = np.zeros_like(self.seen)
        remember(row, self._image, is_visible, self._inside)
        return is_visible

    def forget(self, chance: float, rng: np.random.Generator) -> None:
        """Forget each cell with probability ``chance``; visible cells are remembered again at the next look."""
        self.seen &= rng.random(len(self.seen)) >= chance

    def known(self, row: Row) -> Row:
        """Return a copy of the state as far as it was seen; the other cells are walls, and all boxes are empty."""
        seen_row: Row = believe(row, self.seen, GREY_WALL)
        return seen_row

    def frontier(
        self, known: Row, *, passing: int = 0, judgement: FrontierWeights = EXPERT_WEIGHTS, noise: Noise = no_noise
    ) -> tuple[list[int], list[int], float] | None:
        """Plan the way to the pose from which it is best to look next, by the actions it takes and what it shows.

        Args:
            known: the state that `known` returned.
            passing: the cost of passing an object in actions; 0 if objects block the way.
            judgement: the weights by which the pose to look from is chosen.
            noise: a function that takes a number of poses and returns an error for each, which is added to its cost.

        Returns:
            The actions, with the opening of a door that the pose faces last; the numbers of the cells that they enter
                (x * height + y); and the cost of the path in actions. None if no more can be seen.
        """
        steps = walk(known, passing)
        gains = prospects(
            known, self.seen, steps, self._image, self._inside, judgement.straight, judgement.floor, judgement.wall
        )
        opening = _faces_closed(State(known))
        possible = (gains > 0) & (steps < FAR) & ((steps > 0) | opening)
        if judgement.enough is None:
            enough = self._enough
        else:
            enough = judgement.enough
        enough = min(enough, int(judgement.share * len(self.seen)))
        worth = judgement.worth * np.minimum(gains, enough) + judgement.beyond * gains
        net_costs = np.where(possible, steps - worth, np.inf)
        net_costs[opening] += judgement.opening
        net_costs += noise(net_costs.size).reshape(net_costs.shape)
        best = np.unravel_index(int(np.argmin(net_costs)), net_costs.shape)
        if not np.isfinite(net_costs[best]):
            return None
        pose = (int(best[0]), int(best[1]), int(best[2]))
        actions, path_cells = _trace_path(known, steps, pose)
        if opening[pose]:
            actions.append(TOGGLE)
        return actions, path_cells, float(steps[pose])


def _faces_closed(state: State) -> NDArray[np.bool_]:
    """Return which poses face a closed door, bool[width, height, 4]."""
    closed = (state.kinds == DOOR) & (state.states == CLOSED)
    faces = np.zeros((*closed.shape, 4), bool)
    for direction, (dx, dy) in enumerate(STEPS):
        for x, y in np.argwhere(closed):
            if 0 <= x - dx < state.width and 0 <= y - dy < state.height:
                faces[x - dx, y - dy, direction] = True
    return faces


def _trace_path(known: Row, steps: NDArray[np.int32], pose: tuple[int, int, int]) -> tuple[list[int], list[int]]:
    """Return the actions to a pose and the numbers of the cells that they enter, tracing the path back from the pose.

    Args:
        known: the state, as far as it is known.
        steps: the number of actions from the agent's pose to each pose, as `walk` returns them.
        pose: the column, row and direction at the end of the path.
    """
    state = State(known)
    actions: list[int] = []
    path_cells: list[int] = []
    x, y, direction = pose
    while steps[x, y, direction] > 0:
        steps_left = int(steps[x, y, direction])
        if steps[x, y, (direction + 1) % 4] == steps_left - 1:
            direction = (direction + 1) % 4
            actions.append(LEFT)
        elif steps[x, y, (direction + 3) % 4] == steps_left - 1:
            direction = (direction + 3) % 4
            actions.append(RIGHT)
        else:
            code = int(state.cells[x, y])
            path_cells.append(x * state.height + y)
            actions.append(FORWARD)
            if kinds_of(code) == DOOR and states_of(code) == CLOSED:
                actions.append(TOGGLE)  # before the step forward, as the actions are reversed below
            x = x - STEPS[direction][0]
            y = y - STEPS[direction][1]
    return actions[::-1], path_cells[::-1]
