"""The kernel of the planner of worlds of rules: what the agent can bring about next, and how far it has to walk."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.ruleset.dynamics import (
    DIRECTION,
    MAX_STEPS,
    PHASE,
    PLAYING,
    POCKET,
    STEP,
    TERMINATED,
    TOGGLE,
    WIDTH,
    Row,
    X,
    Y,
    first_cell,
    step_row,
)
from minihuman.worlds.kernels import device_function, kernel

FAR = 1 << 30  # more steps than any


@device_function()
def changes(row: Row, after: Row) -> bool:
    """Return whether the state ``after`` differs from ``row`` in its tiles or in what the agent carries."""
    if row[POCKET] != after[POCKET]:
        return True
    for cell in range(first_cell(row), len(row)):
        if row[cell] != after[cell]:
            return True
    return False


@device_function()
def pose_of(row: Row) -> int:
    """Return the number of the agent's pose: ``4 * cell + direction``."""
    return 4 * (row[Y] * row[WIDTH] + row[X]) + row[DIRECTION]


@device_function()
def try_action(row: Row, after: Row, pose: int, action: int) -> int:
    """Write into ``after`` the state after an action in a pose; return the status of the step.

    The number of steps in ``after`` is 0, and its step limit is never reached.
    """
    for i in range(len(row)):
        after[i] = row[i]
    place = pose // 4
    after[Y] = place // row[WIDTH]
    after[X] = place % row[WIDTH]
    after[DIRECTION] = pose % 4
    after[PHASE] = PLAYING
    after[STEP] = 0
    after[MAX_STEPS] = FAR
    status = step_row(after, action)
    after[STEP] = 0
    return status


@device_function()
def walk_to_changes(
    row: Row,
    after: Row,
    costs: NDArray[np.int64],
    moves: NDArray[np.int64],
    parents: NDArray[np.int64],
    queue: NDArray[np.int64],
) -> int:
    """Do the work of `reach_changes`, for the same arguments: try all actions in all poses in reach, nearest first."""
    parents[:] = -1
    start = pose_of(row)
    parents[start] = -2
    queue[0] = start
    distance = 0
    level_end = 1
    head = 0
    tail = 1
    count = 0
    while head < tail and count < len(after):
        if head == level_end:
            distance += 1
            level_end = tail
        pose = queue[head]
        head += 1
        for action in range(TOGGLE + 1):
            if count == len(after):
                break
            status = try_action(row, after[count], pose, action)
            if status & TERMINATED or changes(row, after[count]):
                costs[count] = distance + 1
                moves[count] = pose * 8 + action
                count += 1
                continue
            near = pose_of(after[count])
            if parents[near] == -1:
                parents[near] = pose * 8 + action
                queue[tail] = near
                tail += 1
    return count


@kernel("(int32[::1], int32[:, ::1], int64[::1], int64[::1], int64[::1], int64[::1])", hold_gil=True)
def reach_changes(
    row: Row,
    after: Row,
    costs: NDArray[np.int64],
    moves: NDArray[np.int64],
    parents: NDArray[np.int64],
    queue: NDArray[np.int64],
) -> int:
    """Find every state that differs in more than the agent's pose and that one action after a walk leads to.

    A walk is a shortest sequence of turns and steps that change nothing else.

    Args:
        row: the state.
        after: receives the states, without their steps, in the order of their costs.
        costs: receives the number of actions that lead to each state.
        moves: receives, for each state, the pose of the last action and that action: ``pose * 8 + action``.
        parents: receives, for each pose that the agent can walk to, the pose and action before it, likewise; -1 for
            others, and -2 for the pose at the start.
        queue: space for all poses.

    Returns:
        The number of states.
    """
    return walk_to_changes(row, after, costs, moves, parents, queue)
