"""Ways among obstacles that move by themselves: as they will move, by the world's own random stream.

Nobody who plays knows that stream; the way is what could have been done, and nothing shorter could.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.chance import Words
from minihuman.worlds.grid.core.rules import act
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import DIRECTION, MAX_STEPS, PHASE, PLAYING, STEP, Row, X, Y
from minihuman.worlds.grid.core.tasks import FORWARD, LEFT, RIGHT
from minihuman.worlds.look_ahead import back_to_start

MOST_STATES = 50_000  # a second or two
MOST_BYTES = 200_000_000  # of states: fewer are looked at in a world that is very large


def among_obstacles(start: Row, words: Words, bound: NDArray[np.int32]) -> list[int] | None:
    """The shortest list of turns and steps to the goal; None if there is no way even without obstacles.

    Args:
        start: The state; it is not changed.
        words: Where the random stream is; it is not changed.
        bound: For each pose at least how many actions the goal is away.

    Raises:
        WorldError: if the search gave up.
    """
    row = start.copy()
    row[MAX_STEPS], row[STEP], row[PHASE] = FAR, 0, PLAYING
    here = int(bound[row[X], row[Y], row[DIRECTION]])
    if here >= FAR:
        return None
    parents: list[tuple[int, int]] = [(-1, -1)]  # of each state: the one before, and the action between
    most = min(MOST_STATES, MOST_BYTES // row.nbytes)
    waiting = [(here, 0, 0, row, words.copy())]
    seen = set()
    while waiting:
        _, minus_cost, number, row, stream = heapq.heappop(waiting)
        for action in (FORWARD, LEFT, RIGHT):
            after, drawn = row.copy(), stream.copy()
            status, reward = act(after, action, drawn)
            if reward > 0:
                return back_to_start(parents, number, action)
            after[STEP] = 0
            known = after.tobytes() + drawn.tobytes()
            if status != 0 or known in seen:
                continue
            seen.add(known)
            parents.append((number, action))
            if len(parents) > most:
                raise WorldError(f"no way among the obstacles in {most} states; make the world smaller")
            cost = 1 - minus_cost
            left = int(bound[after[X], after[Y], after[DIRECTION]])
            heapq.heappush(waiting, (cost + left, -cost, len(parents) - 1, after, drawn))
    return None
