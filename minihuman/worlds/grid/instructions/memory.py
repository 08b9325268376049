"""Memory: what an agent has seen of a grid, and where it would look next. It never looks behind what it has seen."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import CLOSED, DOOR, GREY_WALL
from minihuman.worlds.grid.core.directions import STEPS
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import Row, State
from minihuman.worlds.grid.core.tasks import FORWARD, LEFT, RIGHT, TOGGLE
from minihuman.worlds.grid.instructions.belief import believe, prospects, remember, walk

SMALL = 250  # cells of a grid where a sixteenth of them is enough
ENOUGH = 30  # cells


Noise = Callable[[int], NDArray[np.float64]]  # for so many judgements


@dataclass(frozen=True, slots=True)
class Judgement:
    """How it is judged from where to look.

    Attributes:
        worth: Actions that seeing one more cell is worth.
        enough: Cells of which that is true; None: as many as the size of the grid says.
        share: Of the grid's cells, which are enough too.
        beyond: Actions that each further cell is worth.
        opening: Actions that opening a door costs.
        straight: Cells of wall in a line after which the wall is expected to go on, and so it is around the grid; 0:
            no wall is expected where none was seen.
        floor: What a cell counts.
        wall: What a cell counts where a wall is expected.
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
EXPERT = Judgement(0.6, share=0.2, beyond=0.05, straight=3, wall=0.8)
FOR_DOORS = Judgement(0.8, 6, beyond=0.02, opening=4.0, straight=2, floor=0.35)
PEOPLE = Judgement(0.3)


def exact(count: int) -> NDArray[np.float64]:
    """No noise: everything is judged as it is."""
    return np.zeros(count)


class Memory:
    """What was seen in one episode.

    Args:
        row: The world's state at its beginning.
        view_size: Cells on a side of the agent's view.
        inside: It is seen from inside, not from above.
    """

    def __init__(self, row: Row, view_size: int = 7, *, inside: bool = False) -> None:
        self._inside = inside
        state = State(row)
        self.seen = np.zeros(state.width * state.height, np.bool_)  # by cell, x * height + y
        cells = len(self.seen)
        self._enough = ENOUGH if cells >= SMALL else max(8, cells // 16)
        self._image = np.zeros((view_size, view_size, 3), np.uint8)
        self.look(row)

    def look(self, row: Row) -> int:
        """Remember what is seen now; how many cells are new."""
        return int(remember(row, self._image, self.seen, self._inside))

    def in_view(self, row: Row) -> NDArray[np.bool_]:
        """The cells that are seen now, by cell."""
        now = np.zeros_like(self.seen)
        remember(row, self._image, now, self._inside)
        return now

    def forget(self, chance: float, rng: np.random.Generator) -> None:
        """Each cell is forgotten with this chance; what is in view is remembered at the next look."""
        self.seen &= rng.random(len(self.seen)) >= chance

    def known(self, row: Row) -> Row:
        """The state as far as it was seen; the rest is wall, and boxes hold nothing."""
        known: Row = believe(row, self.seen, GREY_WALL)
        return known

    def frontier(
        self, known: Row, *, passing: int = 0, judgement: Judgement = EXPERT, noise: Noise = exact
    ) -> tuple[list[int], list[int], float] | None:
        """How to see more: the actions, the cells on the way, what it costs; None if nothing more can be seen.

        Args:
            known: What `known` gave.
            passing: What a thing in the way costs; 0 bars the way.
            judgement: What seeing more is worth.
            noise: How far off each judgement of a pose is, in actions.
        """
        steps = walk(known, passing)
        gains = prospects(
            known, self.seen, steps, self._image, self._inside, judgement.straight, judgement.floor, judgement.wall
        )
        opening = _faces_closed(State(known))
        possible = (gains > 0) & (steps < FAR) & ((steps > 0) | opening)
        enough = self._enough if judgement.enough is None else judgement.enough
        enough = min(enough, int(judgement.share * len(self.seen)))
        value = judgement.worth * np.minimum(gains, enough) + judgement.beyond * gains
        worth = np.where(possible, steps - value, np.inf)
        worth[opening] += judgement.opening
        worth += noise(worth.size).reshape(worth.shape)
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
