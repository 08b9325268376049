"""The kernels that step and observe many worlds of rules at once."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.ruleset.dynamics import (
    DIRECTION,
    OVER,
    PHASE,
    PLAYING,
    POCKET,
    TERMINATED,
    TOGGLE,
    TRUNCATED,
    Row,
    earned,
    step_row,
    view_row,
)
from minihuman.worlds.kernels import device_function, kernel

NEXT_STEP, SAME_STEP, DISABLED = range(3)


@device_function()
def find_refusal(rows: Row, actions: NDArray[np.int64], mode: int) -> int:
    """Return the complement (~) of the index of the first world that cannot be stepped, or 0 if there is none.

    A world cannot be stepped if its action does not exist, or if it is not in an episode. In the mode NEXT_STEP, a
    world whose episode has ended can be stepped.
    """
    for i in range(len(rows)):
        phase = rows[i, PHASE]
        ready = phase == PLAYING or (mode == NEXT_STEP and phase == OVER)
        if not ready or actions[i] < 0 or actions[i] > TOGGLE:
            return ~i
    return 0


@device_function()
def observe_row(row: Row, image: NDArray[np.uint8], pocket: NDArray[np.uint8]) -> int:
    """Write the agent's view, and the kind and colour of the tile that it carries; return the agent's direction."""
    view_row(row, image)
    pocket[0] = row[POCKET] & 15
    pocket[1] = row[POCKET] >> 4
    return row[DIRECTION]


@kernel(
    "(int32[:, ::1], int64[::1], uint8[:, :, :, ::1], int64[::1], uint8[:, ::1], float64[::1], boolean[::1], "
    "boolean[::1], int64[::1], int64)",
    nogil=True,
)
def step_rulesets(
    rows: Row,
    actions: NDArray[np.int64],
    images: NDArray[np.uint8],
    directions: NDArray[np.int64],
    pockets: NDArray[np.uint8],
    rewards: NDArray[np.float64],
    terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
    over: NDArray[np.int64],
    mode: int,
) -> int:
    """Step all worlds and observe them.

    ``over`` receives the numbers of the worlds that autoreset must lay out anew in ``mode``; the other arrays have an
    entry per world. A world whose episode has already ended is not stepped and earns nothing.

    Returns:
        The number of worlds to lay out anew; or, if a world refuses its action or must not be stepped now, the
            complement (~) of the index of the first such world. No world is stepped then.
    """
    count = find_refusal(rows, actions, mode)
    if count < 0:
        return count
    for i in range(len(rows)):
        row = rows[i]
        status = 0
        stepped = row[PHASE] == PLAYING
        if stepped:
            status = step_row(row, actions[i])
        rewards[i] = earned(row, status)
        terminated[i] = status & TERMINATED != 0
        truncated[i] = status & TRUNCATED != 0
        ended = status & (TERMINATED | TRUNCATED) != 0
        if not stepped or (mode == SAME_STEP and ended):
            over[count] = i
            count += 1
        directions[i] = observe_row(row, images[i], pockets[i])
    return count


@kernel("(int32[:, ::1], int64[::1], uint8[:, :, :, ::1], int64[::1], uint8[:, ::1])", nogil=True)
def observe_rulesets(
    rows: Row,
    worlds: NDArray[np.int64],
    images: NDArray[np.uint8],
    directions: NDArray[np.int64],
    pockets: NDArray[np.uint8],
) -> None:
    """Write the observations of some worlds into ``images``, ``directions`` and ``pockets``, which are for all worlds.

    ``worlds`` has the numbers of these worlds, which index ``rows``.
    """
    for k in range(len(worlds)):
        i = worlds[k]
        row = rows[i]
        directions[i] = observe_row(row, images[i], pockets[i])
