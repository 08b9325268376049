"""The passes over a batch of a user's own worlds that apply the grid's rules before the user's rules."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.bodies import HIDE, act_team, see_body, step_team
from minihuman.worlds.grid.core.rules import TERMINATED, TRUNCATED, act_inline
from minihuman.worlds.grid.core.state import ACTIONS, DIRECTION, OVER, PHASE, PLAYING, TASK
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.kernels import kernel


@kernel(
    "(int32[:, ::1], int64[::1], uint64[:, ::1], float64[::1], boolean[::1], boolean[::1], boolean[::1], boolean)",
    nogil=True,
)
def act_many(
    rows: NDArray[np.int32],
    actions: NDArray[np.int64],
    rng_states: NDArray[np.uint64],
    rewards: NDArray[np.float64],
    terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
    stepped: NDArray[np.bool_],
    skips_ended: bool,
) -> int:
    """Apply one action in each world by the grid's rules alone, without observations.

    With ``skips_ended``, a world whose episode has ended is not stepped. ``stepped`` receives which worlds were.

    Returns:
        0; or the complement (~) of the index of the first world that refuses its action or is not in an episode. In
            that case no world is stepped.
    """
    for i in range(len(rows)):
        phase = rows[i, PHASE]
        ready = phase == PLAYING or (skips_ended and phase == OVER)
        if not ready or actions[i] < 0 or actions[i] >= rows[i, ACTIONS]:
            return ~i
    for i in range(len(rows)):
        status = 0
        rewards[i] = 0.0
        stepped[i] = rows[i, PHASE] != OVER
        if stepped[i]:
            status, rewards[i] = act_inline(rows[i], actions[i], rng_states[i])
        terminated[i] = status & TERMINATED != 0
        truncated[i] = status & TRUNCATED != 0
    return 0


@kernel("(int32[:, ::1], uint8[:, :, :, ::1], int64[::1])", nogil=True)
def see_many(rows: NDArray[np.int32], images: NDArray[np.uint8], directions: NDArray[np.int64]) -> None:
    """Write the agent's view and direction in each world into ``images`` and ``directions``."""
    for i in range(len(rows)):
        see(rows[i], images[i])
        directions[i] = rows[i, DIRECTION]


@kernel(
    "(int32[:, ::1], int64[:, ::1], uint8[:, :, :, :, ::1], float64[:, ::1], boolean[::1], boolean[::1], boolean[::1],"
    " boolean)",
    nogil=True,
)
def act_teams(
    rows: NDArray[np.int32],
    actions: NDArray[np.int64],
    images: NDArray[np.uint8],
    rewards: NDArray[np.float64],
    terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
    stepped: NDArray[np.bool_],
    skips_ended: bool,
) -> int:
    """Make one joint step in each world; the arguments and the result are as in `act_many`.

    ``images`` are written only for the task HIDE, whose rewards depend on what the bodies see.
    """
    for i in range(len(rows)):
        phase = rows[i, PHASE]
        ready = phase == PLAYING or (skips_ended and phase == OVER)
        for body in range(actions.shape[1]):
            ready = ready and 0 <= actions[i, body] < rows[i, ACTIONS]
        if not ready:
            return ~i
    for i in range(len(rows)):
        status = 0
        rewards[i, :] = 0.0
        stepped[i] = rows[i, PHASE] != OVER
        if stepped[i] and rows[i, TASK] == HIDE:
            status = step_team(rows[i], actions[i], images[i], rewards[i])
        elif stepped[i]:
            status = act_team(rows[i], actions[i], rewards[i])
        terminated[i] = status & TERMINATED != 0
        truncated[i] = status & TRUNCATED != 0
    return 0


@kernel("(int32[:, ::1], uint8[:, :, :, :, ::1], boolean[::1])", nogil=True)
def see_teams(rows: NDArray[np.int32], images: NDArray[np.uint8], selected: NDArray[np.bool_]) -> None:
    """Write the views of all bodies of the worlds that ``selected`` marks into ``images``, by world and body."""
    for i in range(len(rows)):
        if selected[i]:
            for body in range(images.shape[1]):
                see_body(rows[i], body, images[i, body])
