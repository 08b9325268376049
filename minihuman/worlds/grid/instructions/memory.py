"""Memory: what an agent has seen of a grid, and where it would look next. It never looks behind what it has seen."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import CLOSED, DOOR, GREY_WALL
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import Row, State
from minihuman.worlds.grid.core.tasks import FORWARD, LEFT, RIGHT, TOGGLE
from minihuman.worlds.grid.instructions.belief import believe, prospects, remember, walk

STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
WORTH = 0.3  # actions that seeing one more cell is worth; this and the next two were fitted on the levels
SMALL = 250  # cells of a grid where a sixteenth of them is enough
ENOUGH = 30  # cells; more at once are worth no more


class Memory:
    """What was seen in one episode.

    Args:
        row: The world's state at its beginning.
        view_size: Cells on a side of the agent's view.
    """

    def __init__(self, row: Row, view_size: int = 7) -> None:
        state = State(row)
        self.seen = np.zeros(state.width * state.height, np.bool_)  # by cell, x * height + y
        cells = len(self.seen)
        self._enough = ENOUGH if cells >= SMALL else max(8, cells // 16)
        self._image = np.zeros((view_size, view_size, 3), np.uint8)
        self.look(row)

    def look(self, row: Row) -> int:
        """Remember what is seen now; how many cells are new."""
        return int(remember(row, self._image, self.seen))

    def known(self, row: Row) -> Row:
        """The state as far as it was seen; the rest is wall, and boxes hold nothing."""
        known: Row = believe(row, self.seen, GREY_WALL)
        return known

    def frontier(self, known: Row, *, passing: int = 0) -> tuple[list[int], list[int], float] | None:
        """How to see more: the actions, the cells on the way, what it costs; None if nothing more can be seen.

        Args:
            known: What `known` gave.
            passing: What a thing in the way costs; 0 bars the way.
        """
        steps = walk(known, passing)
        gains = prospects(known, self.seen, steps, self._image)
        opening = _faces_closed(State(known))
        possible = (gains > 0) & (steps < FAR) & ((steps > 0) | opening)
        worth = np.where(possible, steps - WORTH * np.minimum(gains, self._enough), np.inf)
        worth[opening] += 1
        best = np.unravel_index(int(np.argmin(worth)), worth.shape)
        if not np.isfinite(worth[best]):
            return None
        pose = (int(best[0]), int(best[1]), int(best[2]))
        actions, way = _path(known, steps, pose, passing)
        if opening[pose]:
            actions.append(TOGGLE)
        return actions, way, float(steps[pose])


def _faces_closed(state: State) -> NDArray[np.bool_]:
    """Poses with a closed door ahead."""
    closed = (state.kinds == DOOR) & ((state.cells >> 7 & 3) == CLOSED)
    faces = np.zeros((*closed.shape, 4), bool)
    for direction, (dx, dy) in enumerate(STEPS):
        for x, y in np.argwhere(closed):
            if 0 <= x - dx < state.width and 0 <= y - dy < state.height:
                faces[x - dx, y - dy, direction] = True
    return faces


def _path(
    known: Row, steps: NDArray[np.int32], pose: tuple[int, int, int], passing: int
) -> tuple[list[int], list[int]]:
    """The actions to a pose and the cells entered, walked back from it."""
    state = State(known)
    actions: list[int] = []
    way: list[int] = []
    x, y, direction = pose
    while steps[x, y, direction] > 0:
        here = int(steps[x, y, direction])
        if steps[x, y, (direction + 1) % 4] == here - 1:
            direction = (direction + 1) % 4
            actions.append(LEFT)
        elif steps[x, y, (direction + 3) % 4] == here - 1:
            direction = (direction + 3) % 4
            actions.append(RIGHT)
        else:
            code = int(state.cells[x, y])
            way.append(x * state.height + y)
            actions.append(FORWARD)
            if code & 15 == DOOR and code >> 7 & 3 == CLOSED:
                actions.append(TOGGLE)
            x, y = x - STEPS[direction][0], y - STEPS[direction][1]
    return actions[::-1], way[::-1]
