"""Rewards and ends: which steps end an episode and what they earn, apart from reaching a goal and stepping into lava.

A task is a number in the state with up to six parameters (`TARGET`), so one kernel serves every world. Success earns
1 - 0.9 * step / max_steps. The rules for BabyAI's instructions are in `babyai.verifier`.
"""

from minihuman.worlds.grid.core.cells import DOOR, EMPTY, GOAL, OPEN, ahead, colour_of, identity_of, kind_of, state_of
from minihuman.worlds.grid.core.state import (
    CARRYING,
    DIRECTION,
    HEADER,
    HEIGHT,
    MAX_STEPS,
    STEP,
    TARGET,
    TASK,
    WIDTH,
    Row,
    X,
    Y,
    cell_at,
    move,
    where_is,
)
from minihuman.worlds.kernels import device_function, inline, kernel
from minihuman.worlds.rng import RngState, integer

LEFT, RIGHT, FORWARD, PICKUP, DROP, TOGGLE, DONE = range(7)

(
    REACH,  # nothing more than goal and lava
    PICK,  # pick up the object of identity TARGET
    FETCH,  # pick up an object of kind TARGET and colour TARGET+1; any other ends the episode
    STAND_BY,  # say "done" next to the cell TARGET, TARGET+1; "toggle" ends the episode
    MATCH,  # go to the cell TARGET, TARGET+1; the cell TARGET+2, TARGET+3 fails; "pickup" only toggles
    PUT_NEAR,  # drop the object of kind TARGET, colour TARGET+1 near the cell TARGET+2, TARGET+3
    IN_ORDER,  # open the door at TARGET, TARGET+1, then the one at TARGET+2, TARGET+3
    OPEN_DOOR,  # open the door at TARGET, TARGET+1
    DODGE,  # objects 1 to TARGET move by themselves; walking into one, or a wall, costs 1 and ends the episode
    INSTRUCTED,  # what the instruction after the cells says; worlds without one have no such block
) = range(10)


@kernel("float64(int32[::1])", "float64(int16[::1])", only=True)
def success_reward(row: Row) -> float:
    """Return the reward for success now: about 1 at the start, 0.1 at the last step."""
    return 1 - 0.9 * (int(row[STEP]) / int(row[MAX_STEPS]))


@kernel("UniTuple(int64, 2)(int32[::1])", "UniTuple(int64, 2)(int16[::1])", only=True)
def cell_in_front(row: Row) -> tuple[int, int]:
    """Return the column and row of the cell in front of the agent; it may lie outside the grid."""
    return ahead(row[X], row[Y], row[DIRECTION])


@kernel("boolean(int32[::1], int64, int64)", "boolean(int16[::1], int64, int64)", only=True)
def is_open(row: Row, x: int, y: int) -> bool:
    """Return whether the cell (x, y) has an open door."""
    code = cell_at(row, x, y)
    return kind_of(code) == DOOR and state_of(code) == OPEN


@device_function()
def _reward_if(row: Row, succeeds: bool) -> float:
    """Return the reward for success now if the step succeeds, else 0."""
    return success_reward(row) if succeeds else 0.0


@device_function()
def _is_target_look(row: Row, code: int) -> bool:
    """Return whether the object with this code has the kind and colour that the task requires."""
    return kind_of(code) == row[TARGET] and colour_of(code) == row[TARGET + 1]


@device_function()
def _judge_stand_by(row: Row, action: int, reward: float, ended: bool) -> tuple[float, bool]:
    """Return the reward and whether the episode ends, where the task is to say "done" next to a cell.

    ``reward`` and ``ended`` are what goals and lava imply, as in `reward_and_done`.
    """
    if action == DONE:
        distance = abs(row[X] - row[TARGET]) + abs(row[Y] - row[TARGET + 1])
        return success_reward(row) if distance == 1 else reward, True
    if action == TOGGLE:
        return reward, True
    return reward, ended


@device_function()
def _judge_match(row: Row, reward: float, ended: bool) -> tuple[float, bool]:
    """Return the reward and whether the episode ends, if the task is to go to the one of two objects that matches.

    ``reward`` and ``ended`` are what goals and lava imply, as in `reward_and_done`.
    """
    if row[X] == row[TARGET] and row[Y] == row[TARGET + 1]:
        return success_reward(row), True
    if row[X] == row[TARGET + 2] and row[Y] == row[TARGET + 3]:
        return 0.0, True
    return reward, ended


@device_function()
def _judge_put_near(row: Row, action: int, held_before: int, reward: float, ended: bool) -> tuple[float, bool]:
    """Return the reward and whether the episode ends, where the task is to put one object near another.

    The parameters are as in `reward_and_done`.
    """
    carried = row[CARRYING]
    if action == PICKUP and carried != EMPTY:
        return reward, ended or not _is_target_look(row, carried)
    if action == DROP and held_before != EMPTY:
        x, y = cell_in_front(row)
        near = abs(x - row[TARGET + 2]) <= 1 and abs(y - row[TARGET + 3]) <= 1
        return success_reward(row) if near and cell_at(row, x, y) == held_before else reward, True
    return reward, ended


@device_function()
def reward_and_done(
    row: Row, action: int, held_before: int, first_was_open: bool, reward: float, ended: bool
) -> tuple[float, bool]:
    """Return the reward of a step that was just made, and whether it ends the episode.

    Args:
        row: the state after the step.
        action: the action of the step.
        held_before: the code of the object in hand before the step, EMPTY for none.
        first_was_open: whether the first door of the task IN_ORDER was open before the step.
        reward: the reward that goals and lava imply.
        ended: whether goals or lava end the episode.
    """
    task = row[TASK]
    carried = row[CARRYING]
    if task == PICK:
        if action == PICKUP and carried != EMPTY and identity_of(carried) == row[TARGET]:
            return success_reward(row), True
    elif task == FETCH:
        if carried != EMPTY:
            return _reward_if(row, _is_target_look(row, carried)), True
    elif task == STAND_BY:
        return _judge_stand_by(row, action, reward, ended)
    elif task == MATCH:
        return _judge_match(row, reward, ended)
    elif task == PUT_NEAR:
        return _judge_put_near(row, action, held_before, reward, ended)
    elif task == IN_ORDER:
        if is_open(row, row[TARGET + 2], row[TARGET + 3]):
            return _reward_if(row, first_was_open), True
    elif task == OPEN_DOOR and action == TOGGLE and is_open(row, row[TARGET], row[TARGET + 1]):
        return success_reward(row), True
    return reward, ended


@inline
def faces_obstacle(row: Row) -> bool:
    """Return whether the cell in front of the agent is neither empty nor a goal, or lies outside the grid."""
    x, y = cell_in_front(row)
    kind = kind_of(cell_at(row, x, y))
    return kind != EMPTY and kind != GOAL


@device_function()
def move_obstacles(row: Row, rng_state: RngState) -> None:
    """Move each obstacle to a random free cell of the 3 x 3 around it; after 101 draws without one, it stays.

    The obstacles are the objects with the identities 1 to ``row[TARGET]``.
    """
    width = row[WIDTH]
    height = row[HEIGHT]
    for identity in range(1, row[TARGET] + 1):
        cell = where_is(row, identity)
        old_x = int(cell / height)  # exact, and whole numbers are divided five times more slowly
        left = max(old_x - 1, 0)
        top = max(cell - old_x * height - 1, 0)
        for _ in range(101):
            x = integer(rng_state, left, min(left + 3, width))
            y = integer(rng_state, top, min(top + 3, height))
            if row[HEADER + x * height + y] == EMPTY and not (x == row[X] and y == row[Y]):
                move(row, identity, x * height + y)
                break
