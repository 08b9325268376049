"""Joint actions in a grid with several bodies.

The row of a team is the classic row with five numbers appended for each body from the second on: column, line,
direction, what it carries, and a scratch number that is 0 between steps. The first body stays in the header, so a row
of one body is the classic row. The rules for one body are used unchanged: a body acts and sees from the header.

The rules of moves, which `docs/team-worlds.md` repeats for readers:

1. All turns are made.
2. All steps forward are judged by the grid before the step. If several bodies want one cell, only the first in this
   step's order gets it. A body enters a cell that another leaves in the same step, and three or more can move round in
   a circle; two never pass through each other, and no body enters a cell in which another stays.
3. Hands act one after the other, in the order of the step, on what is then in front of them, but not on a cell in which
   another body stands.

The order begins with the body whose number is the number of steps taken so far, modulo the number of bodies.

Tasks of teams, in addition to `rewards.REACH` (a body on any goal ends the episode and earns the reward):

- `OWN_GOALS`: each body earns the reward on reaching the goal of its colour, and stays there; when all are there, the
  episode ends.
- `CARRY`: a load that no body can lift alone. Two take it from opposite sides ("pickup"), and it moves where they
  agree: both sideways in the same direction, or one forward while the other stays, and so moves backwards. "drop" lets
  go. All earn the reward when it comes to a goal.
- `HIDE`: body 0 seeks, and stands still for the first steps. From then on, each step in which it sees another earns it
  1/max_steps and costs the others as much; each step in which it sees none has the opposite effect.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    AGENT,
    BLUE,
    EMPTY,
    GOAL,
    GREEN,
    GREY,
    LAVA,
    PURPLE,
    RED,
    YELLOW,
    ahead,
    colour_of,
    identity_of,
    kind_of,
)
from minihuman.worlds.grid.core.rewards import DROP, FORWARD, LEFT, PICKUP, REACH, RIGHT, success_reward
from minihuman.worlds.grid.core.rules import NO_SUCH_ACTION, NOT_PLAYING, apply, close
from minihuman.worlds.grid.core.state import (
    ACTIONS,
    DIRECTION,
    HEADER,
    HEIGHT,
    MAX_STEPS,
    PHASE,
    PLAYING,
    STEP,
    TARGET,
    TASK,
    WIDTH,
    Row,
    X,
    can_enter,
    cell_at,
    lift,
    put,
    row_length,
)
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.kernels import device_function, inline, kernel

MAX_BODIES = 8
BLOCK = 5  # numbers of each body after the first: x, y, direction, carrying (as in the header), scratch
SCRATCH = 4
STAY = 6  # the seventh action, Minigrid's "done"
# tasks; CARRY's target is the load's identity, HIDE's the steps of a head start
OWN_GOALS = 10
CARRY = 11
HIDE = 12
TEAM_ACTION_NAMES = ("left", "right", "forward", "pickup", "drop", "toggle", "stay")
BODY_COLOURS = (RED, BLUE, YELLOW, PURPLE, GREEN, GREY, RED, BLUE)  # by body


def team_row_length(width: int, height: int, bodies: int) -> int:
    """Return the length of the row of state of a team's grid."""
    return row_length(width, height) + BLOCK * (bodies - 1)


@inline
def body_index(row: Row, body: int) -> int:
    """Return the index of a body's column in the row of state; its grid row, direction and carried object follow."""
    if body == 0:
        return X
    return HEADER + 3 * row[WIDTH] * row[HEIGHT] + BLOCK * (body - 1)


@kernel("int64(int32[::1])", only=True)
def count_bodies(row: Row) -> int:
    """Return the number of bodies in a team's row of state."""
    return 1 + (len(row) - HEADER - 3 * row[WIDTH] * row[HEIGHT]) // BLOCK


@device_function("void(int32[::1], int64)")
def exchange(row: Row, body: int) -> None:
    """Exchange the numbers of a body and of the one in the header, to which the rules for one body apply.

    A second exchange undoes the first.
    """
    at = body_index(row, body)
    for k in range(4):
        row[X + k], row[at + k] = row[at + k], row[X + k]


@device_function("int64(int32[::1], int64, int64, int64)")
def body_at(row: Row, bodies: int, x: int, y: int) -> int:
    """Return the number of the body that stands in a cell, or -1 if there is none; ``bodies`` is their count."""
    for body in range(bodies):
        at = body_index(row, body)
        if row[at] == x and row[at + 1] == y:
            return body
    return -1


@device_function("UniTuple(int64, 2)(int32[::1], int64)")
def cell_before(row: Row, body: int) -> tuple[int, int]:
    """Return the column and row of the cell in front of a body; it may lie outside the grid."""
    at = body_index(row, body)
    return ahead(row[at], row[at + 1], row[at + 2])


@device_function("boolean(int32[::1], int64)")
def is_home(row: Row, body: int) -> bool:
    """Return whether the task is OWN_GOALS and a body stands on the goal of its colour."""
    at = body_index(row, body)
    code = cell_at(row, row[at], row[at + 1])
    return row[TASK] == OWN_GOALS and kind_of(code) == GOAL and colour_of(code) == BODY_COLOURS[body]


@device_function("boolean(int32[::1], int64)")
def holds_load(row: Row, body: int) -> bool:
    """Return whether the task is CARRY and a body holds the load."""
    carried = row[body_index(row, body) + 3]
    return row[TASK] == CARRY and carried != EMPTY and identity_of(carried) == row[TARGET]


@device_function()
def free_action(row: Row, actions: NDArray[np.int64], body: int) -> int:
    """Return a body's action, or STAY if the task keeps the body in place.

    It does so for the seeker during the head start, for a body on its goal, and for one that holds the load, unless it
    lets go. ``actions`` has one action per body.
    """
    waits = row[TASK] == HIDE and body == 0 and row[STEP] <= row[TARGET]
    if waits or is_home(row, body) or (holds_load(row, body) and actions[body] != DROP):
        return STAY
    return actions[body]


@device_function()
def hold_blocked(row: Row, bodies: int, moving: int) -> int:
    """Return the bits of ``moving``, one per body, without the bodies that are blocked by another.

    A body is blocked if the body in the cell ahead does not leave it, or would change places with it.
    """
    changed = True
    while changed:
        changed = False
        for body in range(bodies):
            if moving >> body & 1:
                x, y = cell_before(row, body)
                other = body_at(row, bodies, x, y)
                if other >= 0:
                    at = body_index(row, body)
                    if not moving >> other & 1 or cell_before(row, other) == (row[at], row[at + 1]):
                        moving &= ~(1 << body)
                        changed = True
    return moving


@device_function()
def move_bodies(row: Row, actions: NDArray[np.int64], first: int) -> int:
    """Move the bodies that go forward and can; return a number in which bit ``body`` says whether that body moved.

    If several bodies want the same cell, the first in the order that begins with body ``first`` gets it.
    """
    bodies = len(actions)
    moving = 0
    for k in range(bodies):
        body = (first + k) % bodies
        if free_action(row, actions, body) != FORWARD:
            continue
        x, y = cell_before(row, body)
        free = can_enter(row, cell_at(row, x, y))
        for other in range(bodies):
            if moving >> other & 1 and cell_before(row, other) == (x, y):
                free = False
        if free:
            moving |= 1 << body
    moving = hold_blocked(row, bodies, moving)
    for body in range(bodies):
        if moving >> body & 1:
            at = body_index(row, body)
            row[at], row[at + 1] = cell_before(row, body)
    return moving


@device_function("int64(int32[::1], int64, int64)")
def heading(row: Row, body: int, action: int) -> int:
    """Return the direction in which a body that holds the load wants to move it; -1 if its action moves nothing."""
    if action > FORWARD:
        return -1
    turn = 0
    if action == LEFT:
        turn = 3
    elif action == RIGHT:
        turn = 1
    return (row[body_index(row, body) + 2] + turn) % 4


@device_function()
def carry_load(row: Row, actions: NDArray[np.int64]) -> bool:
    """Move the load and the two bodies that hold it if their actions agree; return whether the load came to a goal."""
    bodies = len(actions)
    carrier = partner = -1
    for body in range(bodies):
        if holds_load(row, body):
            carrier = partner
            partner = body
    if carrier < 0:
        return False
    carrier_at = body_index(row, carrier)
    partner_at = body_index(row, partner)
    x, y = cell_before(row, carrier)
    if cell_before(row, partner) != (x, y) or row[carrier_at + 2] ^ 2 != row[partner_at + 2]:
        return False
    way = heading(row, carrier, actions[carrier])
    partner_way = heading(row, partner, actions[partner])
    forward = (actions[carrier] == FORWARD and actions[partner] == STAY) or (
        actions[partner] == FORWARD and actions[carrier] == STAY
    )
    if way < 0:
        way = partner_way
    if way < 0 or not (forward or way == partner_way):
        return False
    for k in range(-1, 2):  # the cells of body, load and body, and where each goes
        here_x = x
        here_y = y
        if k < 0:
            here_x = row[carrier_at]
            here_y = row[carrier_at + 1]
        elif k > 0:
            here_x = row[partner_at]
            here_y = row[partner_at + 1]
        to_x, to_y = ahead(here_x, here_y, way)
        own = (to_x, to_y) == (x, y) or body_at(row, bodies, to_x, to_y) in (carrier, partner)
        if not own and (not can_enter(row, cell_at(row, to_x, to_y)) or body_at(row, bodies, to_x, to_y) >= 0):
            return False
    to_x, to_y = ahead(x, y, way)
    arrived = kind_of(cell_at(row, to_x, to_y)) == GOAL
    put(row, to_x, to_y, lift(row, x, y))
    row[carrier_at], row[carrier_at + 1] = ahead(row[carrier_at], row[carrier_at + 1], way)
    row[partner_at], row[partner_at + 1] = ahead(row[partner_at], row[partner_at + 1], way)
    return arrived


@device_function()
def use_hands(row: Row, body: int, action: int) -> None:
    """Apply a body's hand action to the cell in front of it, unless another body stands there.

    "pickup" and "drop" grasp the load and let go of it, while the load itself stays in its cell.
    """
    at = body_index(row, body)
    x, y = cell_before(row, body)
    if row[TASK] == CARRY and identity_of(cell_at(row, x, y)) == row[TARGET]:
        if action == PICKUP and row[at + 3] == EMPTY:
            row[at + 3] = cell_at(row, x, y)
        elif action == DROP and holds_load(row, body):
            row[at + 3] = EMPTY
    elif body_at(row, count_bodies(row), x, y) < 0:
        exchange(row, body)
        apply(row, action)
        exchange(row, body)


@device_function()
def turn_bodies(row: Row, actions: NDArray[np.int64]) -> None:
    """Turn the bodies whose action is a turn; ``actions`` has one action per body."""
    for body in range(len(actions)):
        action = free_action(row, actions, body)
        if action <= RIGHT:
            at = body_index(row, body)
            row[at + 2] = (row[at + 2] + (3 if action == LEFT else 1)) % 4


@kernel("(int32[::1], int64[::1], float64[::1])", hold_gil=True)
def act_team(row: Row, actions: NDArray[np.int64], rewards: NDArray[np.float64]) -> int:
    """Make one joint step without observations, and write each body's reward into ``rewards``.

    ``actions`` has one action per body. Return the status as `rules.step` does. The rewards of the task HIDE, which
    depend on views, are written by `step_team`.
    """
    bodies = len(actions)
    if row[PHASE] != PLAYING:
        return NOT_PLAYING
    for body in range(bodies):
        if actions[body] < 0 or actions[body] >= row[ACTIONS]:
            return NO_SUCH_ACTION
    first = row[STEP] % bodies
    row[STEP] += 1
    rewards[:] = 0.0
    ended = row[TASK] == CARRY and carry_load(row, actions)
    if ended:
        rewards[:] = success_reward(row)
    turn_bodies(row, actions)
    moved = move_bodies(row, actions, first)
    home = 0
    for body in range(bodies):
        at = body_index(row, body)
        kind = kind_of(cell_at(row, row[at], row[at + 1]))
        home += is_home(row, body)
        if moved >> body & 1:
            if is_home(row, body) or (kind == GOAL and row[TASK] == REACH):
                rewards[body] = success_reward(row)
            ended |= kind == LAVA or (kind == GOAL and row[TASK] == REACH)
    ended |= home == bodies
    for k in range(bodies):
        body = (first + k) % bodies
        action = free_action(row, actions, body)
        if FORWARD < action < STAY:
            use_hands(row, body, action)
    return close(row, ended)


@kernel("(int32[::1], int64, uint8[:, :, ::1])", hold_gil=True)
def see_body(row: Row, body: int, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` with a body's view, as `view.see` does. The other bodies appear as agents in their colours.

    The state of such an agent's cell is its direction relative to the viewer's: 3 (up) if both look the same way.
    """
    bodies = count_bodies(row)
    exchange(row, body)
    for k in range(1, bodies):
        at = body_index(row, k)
        cell = HEADER + row[at] * row[HEIGHT] + row[at + 1]
        facing = (row[at + 2] - row[DIRECTION] + 3) % 4
        row[at + SCRATCH] = row[cell]
        # the code of an agent; after the exchange, body 0 is in the place of the viewer
        row[cell] = AGENT | BODY_COLOURS[0 if k == body else k] << 4 | facing << 7
    see(row, image)
    for k in range(bodies - 1, 0, -1):
        at = body_index(row, k)
        row[HEADER + row[at] * row[HEIGHT] + row[at + 1]] = row[at + SCRATCH]
        row[at + SCRATCH] = 0
    exchange(row, body)


@kernel("(int32[::1], int64[::1], uint8[:, :, :, ::1], float64[::1])", hold_gil=True)
def step_team(row: Row, actions: NDArray[np.int64], images: NDArray[np.uint8], rewards: NDArray[np.float64]) -> int:
    """Make one joint step and observe its result; return the status as `rules.step` does.

    ``images`` receives the views of the bodies, uint8[bodies, size, size, 3], and ``rewards`` one reward per body.
    """
    status = act_team(row, actions, rewards)
    if status >= 0:
        for body in range(len(actions)):
            see_body(row, body, images[body])
        if row[TASK] == HIDE and row[STEP] > row[TARGET]:
            is_visible = False
            for i in range(images.shape[1]):
                for j in range(images.shape[2]):
                    is_visible |= images[0, i, j, 0] == AGENT
            rewards[:] = (-1.0 if is_visible else 1.0) / row[MAX_STEPS]
            rewards[0] = -rewards[0]
    return status


@kernel("(int32[::1],)")
def clear_bodies(row: Row) -> None:
    """Remove every body but the first from the grid, as `state.clear` removes the first."""
    for body in range(1, count_bodies(row)):
        at = body_index(row, body)
        row[at] = row[at + 1] = row[at + 2] = -1
        row[at + 3] = EMPTY
