"""A step of many worlds in one call, with the addresses of each world's arrays in a row of numbers."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.motion_kernels import COMMAND_SIZE, move_freely
from minihuman.worlds.first_person.render.kernel_tables import F64, I64
from minihuman.worlds.first_person.render.rasterisation import ROOM, VIEW_SIZE
from minihuman.worlds.first_person.rules import (
    ACT,
    AGENT,
    COLUMNS,
    DIR,
    EYE,
    JUDGE,
    MOVED,
    NAMED,
    REWARD,
    STEPS,
    TURN_RIGHT,
    X,
    Y,
    Z,
    act,
)
from minihuman.worlds.kernels import array_at, device_function, int64, kernel

# The columns of a row: the address and the length of each array of `rules.act`; the address of the view of the world;
# and the number of spans per row of the picture for which there is memory.
THINGS = 0
NUMBERS = 2
WALLS = 4
VIEW = 6
SPANS = 7
ROW_SIZE = 8
# Of a world's own numbers: the agent's x, y, z and heading; the cosine and sine of the heading; those of the heading
# after a turn; the reward of the step; and how far the eye is ahead of the body's middle, metres.
HEADING = 3
NOW = 4
AFTER = 6
EARNED = 8
AHEAD = 9
OWN_SIZE = 10
# Of a row of commands: the components of `motion_kernels`, then the action of the hands, or one of these
USE = COMMAND_SIZE
NOTHING = -1
SKIPPED = -2  # the world makes no step

_floats_at = array_at(np.float64)


@kernel("(int64[:, ::1], int64[::1], float64[:, ::1], int64[::1])", nogil=True, after=int64)
def act_together(rows: I64, actions: NDArray[np.int64], own: F64, statuses: NDArray[np.int64]) -> None:
    """Step each world whose action is not negative, as `rules.act` does, and aim its view as `RenderTarget` does.

    ``rows`` are (n, ROW_SIZE), ``own`` are (n, OWN_SIZE). The view already contains its pitch and all else that a step
    does not change. The other worlds' status becomes -1.
    """
    for nth in range(len(actions)):
        action = actions[nth]
        if action < 0:
            statuses[nth] = -1
            continue
        row = rows[nth]
        facts = own[nth]
        things = _floats_at(row[THINGS], row[THINGS + 1]).reshape(row[THINGS + 1] // COLUMNS, COLUMNS)
        numbers = _floats_at(row[NUMBERS], row[NUMBERS + 1])
        numbers[STEPS] += 1.0
        walls = _floats_at(row[WALLS], row[WALLS + 1]).reshape(row[WALLS + 1] // 4, 4)
        if int(numbers[NAMED + action]) >> 3 <= TURN_RIGHT:  # the motion of the action is a turn; see `rules.NAMED`
            after = AFTER
        else:
            after = NOW
        status = act(
            *(things, numbers, walls),
            *(facts[NOW], facts[NOW + 1], facts[after], facts[after + 1]),
            action,
            ACT | JUDGE,
        )
        statuses[nth] = status
        if status & MOVED:
            facts[NOW], facts[NOW + 1] = facts[after], facts[after + 1]
        _aim(things, numbers, facts, row)


@kernel("(int64[:, ::1], float64[:, ::1], float64[:, ::1], int64[::1])", nogil=True)
def move_together(rows: I64, commands: F64, own: F64, statuses: NDArray[np.int64]) -> None:
    """Step each world by its command, as `motion_kernels.step_freely` does, and aim its view.

    ``rows`` are (n, ROW_SIZE), ``commands`` are (n, COMMAND_SIZE + 1), and ``own`` are (n, OWN_SIZE). A world that is
    skipped gets the status -1. A world in which an action of the hands turns the body must not be stepped here.
    """
    for nth in range(len(commands)):
        use = int64(commands[nth, USE])
        if use == SKIPPED:
            statuses[nth] = -1
            continue
        row = rows[nth]
        facts = own[nth]
        things = _floats_at(row[THINGS], row[THINGS + 1]).reshape(row[THINGS + 1] // COLUMNS, COLUMNS)
        numbers = _floats_at(row[NUMBERS], row[NUMBERS + 1])
        numbers[STEPS] += 1.0
        walls = _floats_at(row[WALLS], row[WALLS + 1]).reshape(row[WALLS + 1] // 4, 4)
        status = move_freely(
            *(things, numbers, walls, commands[nth]),
            *(facts[NOW], facts[NOW + 1], facts[AFTER], facts[AFTER + 1]),
        )
        if things[int(numbers[AGENT]), DIR] != facts[HEADING]:
            facts[NOW], facts[NOW + 1] = facts[AFTER], facts[AFTER + 1]
        cosine = facts[NOW]
        sine = facts[NOW + 1]
        if use >= 0:
            status |= act(things, numbers, walls, cosine, sine, cosine, sine, use, ACT)
        statuses[nth] = status | act(things, numbers, walls, cosine, sine, cosine, sine, use, JUDGE)
        _aim(things, numbers, facts, row)


@device_function(nogil=True)
def _aim(things: F64, numbers: NDArray[np.float64], facts: NDArray[np.float64], row: NDArray[np.int64]) -> None:
    """Copy the agent's pose and the step's reward into a world's own numbers ``facts``, and aim its view.

    Of the view, numbers 0 to 2 are the eye's position; 3 to 5, 6 to 8 and 9 to 11 are unit vectors to the right, up and
    ahead. Numbers 7 and 10, the heights of "up" and "ahead", are the cosine and sine of the pitch, and do not change.
    """
    agent = int(numbers[AGENT])
    for column in range(HEADING + 1):
        facts[column] = things[agent, column]
    facts[EARNED] = numbers[REWARD]
    view = _floats_at(row[VIEW], VIEW_SIZE)
    cos_yaw = facts[NOW]
    sin_yaw = facts[NOW + 1]
    cos_pitch = view[7]
    sin_pitch = view[10]
    ahead_x = facts[AHEAD] * cos_yaw
    ahead_z = facts[AHEAD] * sin_yaw
    view[0], view[1], view[2] = facts[X] + ahead_x, facts[Y] + numbers[EYE], facts[Z] - ahead_z
    view[3], view[5] = sin_yaw, cos_yaw
    view[6], view[8] = -sin_pitch * cos_yaw, sin_pitch * sin_yaw
    view[9], view[11] = cos_pitch * cos_yaw, -cos_pitch * sin_yaw
    view[ROOM] = row[SPANS]
