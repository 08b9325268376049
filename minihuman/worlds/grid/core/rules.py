"""The effects of actions: Minigrid's seven actions on one row of state, including how doors are toggled.

Steps of worlds with instructions are judged in `babyai.verifier`, so that other worlds need not compile it.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    BOX,
    CLOSED,
    DOOR,
    EMPTY,
    GOAL,
    KEY,
    LAVA,
    LOCKED,
    OPEN,
    colour_of,
    identity_of,
    in_state,
    kind_of,
    state_of,
)
from minihuman.worlds.grid.core.rewards import (
    DODGE,
    DROP,
    FORWARD,
    IN_ORDER,
    LEFT,
    MATCH,
    PICKUP,
    RIGHT,
    TOGGLE,
    cell_in_front,
    faces_obstacle,
    is_open,
    move_obstacles,
    reward_and_done,
    success_reward,
)
from minihuman.worlds.grid.core.state import (
    ACTIONS,
    CARRYING,
    DIRECTION,
    HEIGHT,
    MAX_STEPS,
    OPENS,
    OVER,
    PHASE,
    PLAYING,
    STEP,
    TARGET,
    TASK,
    WIDTH,
    Row,
    X,
    Y,
    can_carry,
    can_enter,
    cell_at,
    contents_index,
    lift,
    own_properties,
    put,
)
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.kernels import device_function, inline, kernel
from minihuman.worlds.rng import RngState

ACTION_NAMES = ("left", "right", "forward", "pickup", "drop", "toggle", "done")

# bits of a step's status
TERMINATED = 1
TRUNCATED = 2
FAULTY = 4  # a user's own rules have recorded a fault
# a step that was refused and changed nothing
NOT_PLAYING = -1
NO_SUCH_ACTION = -2


@kernel("(int32[::1], int64, uint64[::1], uint8[:, :, ::1])", hold_gil=True)
def step(row: Row, action: int, rng_state: RngState, image: NDArray[np.uint8]) -> tuple[int, int, float]:
    """Make one step and observe its result.

    Args:
        row: the state, which is changed.
        action: the number of the action.
        rng_state: the random stream, by which obstacles move.
        image: receives the agent's view, as `view.see` writes it; unchanged if the step was refused.

    Returns:
        The status (TERMINATED and TRUNCATED as bits; NOT_PLAYING or NO_SUCH_ACTION if the step was refused), the
            agent's direction and the reward.
    """
    status, reward = act(row, action, rng_state)
    if status >= 0:
        see(row, image)
    return status, row[DIRECTION], reward


@kernel("(int32[::1], int64, uint64[::1])", hold_gil=True)
def act(row: Row, action: int, rng_state: RngState) -> tuple[int, float]:
    """Make one step without an observation; return the status and the reward, as `step` does."""
    return act_inline(row, action, rng_state)


@device_function(force_inline=True)
def act_inline(row: Row, action: int, rng_state: RngState) -> tuple[int, float]:
    """Make one step as `act` does, compiled into the kernels that call it to step many rows."""
    refused = refusal(row, action)
    if refused < 0:
        return refused, 0.0
    row[STEP] += 1
    task = row[TASK]
    if task == MATCH and action == PICKUP:
        action = TOGGLE
    held_before = row[CARRYING]
    first_was_open = task == IN_ORDER and is_open(row, row[TARGET], row[TARGET + 1])
    collides = False
    if task == DODGE:
        collides = action == FORWARD and faces_obstacle(row)
        move_obstacles(row, rng_state)
    reward, ended = apply(row, action)
    reward, ended = reward_and_done(row, action, held_before, first_was_open, reward, ended)
    if collides:
        reward = -1.0
        ended = True
    return close(row, ended), reward


@inline
def refusal(row: Row, action: int) -> int:
    """Return the status of a step that is refused, NOT_PLAYING or NO_SUCH_ACTION; return 0 if it can be made."""
    if row[PHASE] != PLAYING:
        return NOT_PLAYING
    if action < 0 or action >= row[ACTIONS]:
        return NO_SUCH_ACTION
    return 0


@inline
def close(row: Row, ended: bool) -> int:
    """Return the status of a step that was made and judged: TERMINATED if it ``ended`` the episode, and TRUNCATED.

    TRUNCATED is set at the step limit. If either is set, the row's phase becomes OVER.
    """
    status = TERMINATED if ended else 0
    if row[STEP] >= row[MAX_STEPS]:
        status |= TRUNCATED
    if status:
        row[PHASE] = OVER
    return status


@device_function(force_inline=True)
def apply(row: Row, action: int) -> tuple[float, bool]:
    """Apply an action to the agent, objects and doors, without counting the step.

    Return the reward and whether the episode ends, as goals and lava determine them.
    """
    if action == LEFT:
        row[DIRECTION] = (row[DIRECTION] + 3) % 4
        return 0.0, False
    if action == RIGHT:
        row[DIRECTION] = (row[DIRECTION] + 1) % 4
        return 0.0, False
    x, y = cell_in_front(row)
    code = cell_at(row, x, y)
    if action == FORWARD:
        if can_enter(row, code):
            row[X] = x
            row[Y] = y
        if kind_of(code) == GOAL:
            return success_reward(row), True
        return 0.0, kind_of(code) == LAVA
    if x < 0 or y < 0 or x >= row[WIDTH] or y >= row[HEIGHT]:
        return 0.0, False
    if action == PICKUP:
        if row[CARRYING] == EMPTY and can_carry(row, code):
            row[CARRYING] = lift(row, x, y)
    elif action == DROP:
        if row[CARRYING] != EMPTY and code == EMPTY:
            put(row, x, y, row[CARRYING])
            row[CARRYING] = EMPTY
    elif action == TOGGLE:
        toggle(row, x, y, code)
    return 0.0, False


@inline
def toggle(row: Row, x: int, y: int, code: int) -> None:
    """Toggle the object in the cell (x, y), which has the code ``code``.

    A door, or an object that opens, opens or closes; if it is locked, the key of its colour opens it. A box is removed,
    and its contents stay.
    """
    if kind_of(code) == DOOR or own_properties(row, code) & OPENS:
        state = state_of(code)
        if state == LOCKED:
            carried = row[CARRYING]
            if kind_of(carried) == KEY and colour_of(carried) == colour_of(code):
                put(row, x, y, in_state(code, OPEN))
        else:
            put(row, x, y, in_state(code, CLOSED if state == OPEN else OPEN))
    elif kind_of(code) == BOX:
        inside = row[contents_index(row, identity_of(code))]
        lift(row, x, y)
        if inside != 0:
            put(row, x, y, inside)
