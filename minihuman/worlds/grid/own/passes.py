"""The passes over a user's own worlds that apply the grid's rules before the user's rules.

The author's rules of a batch are a pass of their own; `step_own` makes all three passes over one world in one call.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.bodies import HIDE, act_team, see_body, step_team
from minihuman.worlds.grid.core.rules import FAULTY, TERMINATED, TRUNCATED, act_inline
from minihuman.worlds.grid.core.state import ACTIONS, DIRECTION, OVER, PHASE, PLAYING, TASK
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.grid.own import entries
from minihuman.worlds.grid.own.entries import TABLE
from minihuman.worlds.kernels import array_at, kernel, llvm_function

int64_array_at = array_at(np.int64)
float64_array_at = array_at(np.float64)
uint8_array_at = array_at(np.uint8)


def _call(builder: Any, arguments: Any) -> Any:
    from minihuman.worlds.build.compilation import call_function

    (_, address), (_, argument) = arguments
    return call_function(builder, address, argument)


def _call_plain(function: int, argument: int) -> int:
    raise NotImplementedError("without compiled kernels no compiled rules are loaded; see library.can_load")


# Calls the compiled function at an address with one whole number; returns the whole number that the function returns.
call_address = llvm_function(_call, _call_plain, counts=True)


@kernel("(int64, int64, int32[::1], uint64[::1], int64, uint8[:, :, ::1])", hold_gil=True)
def step_own(
    rules: int,
    table_address: int,
    row: NDArray[np.int32],
    rng_state: NDArray[np.uint64],
    action: int,
    image: NDArray[np.uint8],
) -> tuple[int, int, float]:
    """Make one step of one world: the grid's own rules, the author's compiled rules, and the agent's view.

    Args:
        rules: the address of the author's compiled function (see `entries`).
        table_address: the address of its table; the memory for actions, rewards and flags must be for one body.
        row: the state, which is changed.
        rng_state: the random stream.
        action: the number of the action.
        image: receives the agent's view, unless it has no elements; unchanged if the step is refused or has a fault.

    Returns:
        The status (TERMINATED and TRUNCATED as bits; FAULTY; or, of a step that was refused, a negative number as in
            `core.rules.step`), the agent's direction and the reward.
    """
    status, reward = act_inline(row, action, rng_state)
    if status < 0:
        return status, row[DIRECTION], reward
    table = int64_array_at(table_address, TABLE)
    rewards = float64_array_at(table[entries.REWARDS], 1)
    terminated = uint8_array_at(table[entries.TERMINATED], 1)
    int64_array_at(table[entries.ACTIONS], 1)[0] = action
    uint8_array_at(table[entries.TRUNCATED], 1)[0] = status & TRUNCATED != 0
    rewards[0] = reward
    terminated[0] = status & TERMINATED != 0
    if call_address(rules, table_address):
        return FAULTY, row[DIRECTION], 0.0
    if image.size:
        see(row, image)
    status = status & TRUNCATED | (TERMINATED if terminated[0] else 0)
    return status, row[DIRECTION], rewards[0]


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
