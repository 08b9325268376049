"""The effects of the eight actions on a state, and the reward of a step: Miniworld's exact rules, over flat arrays.

`things` has a row for each placed entity in the order in which they were placed, including the agent, followed by those
that are carried or belong to a rule. `numbers` is the rest of an episode, ending with the rule's numbers. A move
happens completely or not at all. Python passes the sines of the heading, since logs without `trig` used the host's.
"""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.rasterisation import (
    BOTTOM,
    CENTRE_X,
    CENTRE_Y,
    FOCAL_X,
    FOCAL_Y,
    HEIGHT,
    TOP,
    WIDTH,
)
from minihuman.worlds.first_person.walls import touches_wall
from minihuman.worlds.kernels import device_function, inline, int64, kernel
from minihuman.worlds.rng import RngState, unit
from minihuman.worlds.trigonometry import wave

ACTIONS = ("turn_left", "turn_right", "move_forward", "move_back", "pickup", "drop", "toggle", "done")
MOVES = ACTIONS[:3]
TURN_LEFT, TURN_RIGHT, MOVE_FORWARD, MOVE_BACK, PICKUP, DROP, TOGGLE, DONE = range(8)
MOST_ACTIONS = 16  # of a world

Things = NDArray[np.float64]  # (n, COLUMNS)
Numbers = NDArray[np.float64]

# Columns of a thing, in metres and radians; STATIC is 1.0 if it cannot be carried, SINGLE is 1.0 if its radius is a
# float32, and LOOK is its number in the scene or -1.
X, Y, Z, DIR, RADIUS, TALL, STATIC, SINGLE, LOOK = range(9)
COLUMNS = 9
# Of the numbers: how many things are placed, the rows of the agent and of what it carries, the steps, their limit, and
# the count that the rule keeps; -1 for none
COUNT, AGENT, CARRIED, STEPS, STEP_LIMIT, SCORE = range(6)
# in metres: the longest step; how high the eye is, and how far it is ahead of the body's middle
REACH = 6
EYE = 7
CAMERA_AHEAD = 8
# the eye's pitch, and the tangent of half its field of view
COS_PITCH = 9
SIN_PITCH = 10
TAN_FOV = 11
SHADOWS = 12  # a thing's number in the scene plus this is that of its shadow; 0 for no shadows
# how far a step goes ahead and drifts to the right, metres; the angle of a turn, degrees
AHEAD = 13
DRIFT = 14
TURN_DEG = 15
# the lower and the upper bounds of these three
LOW = 16
HIGH = 19
# 1.0 if these three are drawn for each step; 1.0 if they or the rule need the random stream
VARIES = 22
DRAWS = 23
REWARD = 24  # of the step
# the rule, and the number of its things and of its numbers
RULE = 25
RULE_THINGS = 26
RULE_NUMBERS = 27
NAMED = 28  # for each action of the world: its number in ACTIONS, plus eight times the number of the motion it makes
GONE_ROW = NAMED + MOST_ACTIONS  # the row, before the step, of the thing that the step removed
VELOCITY = GONE_ROW + 1  # of continuous motion with an acceleration: ahead and to the right, of the longest step
ACCELERATION = VELOCITY + 2  # the largest change of velocity in a step; 0 for no limit
ARGUMENTS = ACCELERATION + 1  # rows of the rule's things, then its numbers

NEVER, GOAL, TAKE_ALL, PUT_NEXT, HEALTH, SIGN, FACE = range(7)  # rules; `termination_rules` says what they are
# parts of a step
ACT = 1
JUDGE = 2
# Bits of a step's status. MOVED: the agent's place or heading changed; HANDS: it carries something else; LOAD: the
# carried thing moved; GONE: a thing was removed; PLACES: it is to be placed elsewhere.
TERMINATED = 1
TRUNCATED = 2
MOVED = 4
HANDS = 8
LOAD = 16
GONE = 32
PLACES = 64
NOTHING = -1
WALL = -2

_RADIANS = math.pi / 180
_MOST_TRIES = 100_000
_UNIT = 2.0**-53


@inline
def add_lengths(a: float, b: float, single: bool) -> float:
    """Return the sum of two lengths, in single precision if either has it, as in NumPy."""
    if single:
        return np.float64(np.float32(a) + np.float32(b))
    return a + b


@device_function()
def _blocker(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    thing: int,
    x: float,
    z: float,
    radius: float,
    single: bool,
) -> int:
    """Return the row of the first entity that ``thing`` would overlap at (x, z); WALL for a wall, NOTHING for none."""
    if touches_wall(walls, x, z, radius):
        return WALL
    for row in range(int(numbers[COUNT])):
        if row == thing:
            continue
        dx = things[row, X] - x
        dz = things[row, Z] - z
        is_single = single or things[row, SINGLE] != 0.0
        if math.sqrt(dx * dx + dz * dz) < add_lengths(radius, things[row, RADIUS], is_single):
            return row
    return NOTHING


@device_function()
def _near(things: Things, numbers: Numbers, a: int, b: int) -> bool:
    """Return whether the gap between two entities is below 1.1 times the longest step, as in Miniworld."""
    dx = things[a, X] - things[b, X]
    dy = things[a, Y] - things[b, Y]
    dz = things[a, Z] - things[b, Z]
    single = things[a, SINGLE] != 0.0 or things[b, SINGLE] != 0.0
    reach = add_lengths(add_lengths(things[a, RADIUS], things[b, RADIUS], single), 1.1 * numbers[REACH], single)
    return math.sqrt(dx * dx + dy * dy + dz * dz) < reach


@device_function()
def fits_at(things: Things, numbers: Numbers, walls: NDArray[np.float64], thing: int, x: float, z: float) -> bool:
    """Return whether an entity would overlap neither a wall nor another entity at (x, z)."""
    touched = _blocker(things, numbers, walls, thing, x, z, things[thing, RADIUS], things[thing, SINGLE] != 0.0)
    return touched == NOTHING


@device_function()
def find_carried_place(
    things: Things, numbers: Numbers, thing: int, x: float, z: float, ahead_x: float, ahead_z: float
) -> tuple[float, float, float]:
    """Return the position of a carried entity when the agent is at (x, z): ahead of it, below the picture's middle.

    The numbers 0.3 and 1.05 are Miniworld's.
    """
    agent = int(numbers[AGENT])
    single = things[agent, SINGLE] != 0.0 or things[thing, SINGLE] != 0.0
    distance = add_lengths(add_lengths(things[agent, RADIUS], things[thing, RADIUS], single), numbers[REACH], single)
    rise = max(numbers[EYE] - things[thing, TALL] - 0.3, 0.0)
    return x + ahead_x * 1.05 * distance, things[agent, Y] + rise, z + ahead_z * 1.05 * distance


@device_function()
def _remove(things: Things, numbers: Numbers, row: int) -> None:
    """Remove a placed entity, so that the agent carries nothing; its row moves to after that of the last placed one."""
    last = int(numbers[COUNT]) - 1
    for column in range(COLUMNS):
        value = things[row, column]
        for k in range(row, last):
            things[k, column] = things[k + 1, column]
        things[last, column] = value
    if numbers[AGENT] > row:
        numbers[AGENT] -= 1.0
    numbers[COUNT] = last
    numbers[CARRIED] = -1.0
    numbers[GONE_ROW] = row


@device_function()
def _move(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    ahead_x: float,  # the heading as a unit vector
    ahead_z: float,
    after_x: float,  # the heading after a turn
    after_z: float,
    action: int,
) -> int:  # the status
    agent = int(numbers[AGENT])
    carried = int64(numbers[CARRIED])
    motion = int(numbers[NAMED + action]) >> 3  # see NAMED
    x = things[agent, X]
    z = things[agent, Z]
    status = 0
    if motion in (MOVE_FORWARD, MOVE_BACK):
        if motion == MOVE_FORWARD:
            ahead = numbers[AHEAD]
        else:
            ahead = -numbers[AHEAD]
        drift = numbers[DRIFT]
        to_x = x + ahead_x * ahead - ahead_z * drift
        to_z = z + ahead_z * ahead + ahead_x * drift
        if fits_at(things, numbers, walls, agent, to_x, to_z):
            fits = True
            if carried >= 0:
                carried_to = find_carried_place(things, numbers, carried, to_x, to_z, ahead_x, ahead_z)
                fits = fits_at(things, numbers, walls, carried, carried_to[0], carried_to[2])
            if fits:
                things[agent, X] = to_x
                things[agent, Z] = to_z
                status = MOVED
    elif motion in (TURN_LEFT, TURN_RIGHT):
        angle = numbers[TURN_DEG] * _RADIANS
        fits = True
        if carried >= 0:
            carried_to = find_carried_place(things, numbers, carried, x, z, after_x, after_z)
            fits = fits_at(things, numbers, walls, carried, carried_to[0], carried_to[2])
        if fits:
            things[agent, DIR] += angle if motion == TURN_LEFT else -angle
            ahead_x = after_x
            ahead_z = after_z
            status = MOVED
    elif motion == PICKUP and carried < 0:
        radius = things[agent, RADIUS]
        to_x = x + ahead_x * 1.5 * radius  # 1.5 and 1.2 radii are Miniworld's reach of hands
        to_z = z + ahead_z * 1.5 * radius
        touched = _blocker(things, numbers, walls, agent, to_x, to_z, 1.2 * radius, False)
        if touched >= 0 and things[touched, STATIC] == 0.0:
            carried = int64(touched)
            status = HANDS
    elif motion == DROP and carried >= 0:
        things[carried, Y] = 0.0
        carried = -1
        status = HANDS | LOAD
    numbers[CARRIED] = carried
    if carried >= 0:
        carried_to = find_carried_place(things, numbers, carried, things[agent, X], things[agent, Z], ahead_x, ahead_z)
        things[carried, X], things[carried, Y], things[carried, Z] = carried_to
        things[carried, DIR] = things[agent, DIR]
        status |= LOAD
    return status


@device_function()
def _reward_if(succeeds: bool, success: float) -> float:
    """Return the reward of success if it ``succeeds``, and 0 otherwise."""
    return success if succeeds else 0.0


@device_function()
def _is_in_forbidden_room(things: Things, numbers: Numbers, agent: int, own: int) -> bool:
    """Return whether the agent is in the room whose edges begin at ``numbers[own]``; False if the rule has no room."""
    inside = numbers[RULE_NUMBERS] > 0.0
    for k in range(own, own + int(numbers[RULE_NUMBERS]), 4):
        dx = things[agent, X] - numbers[k]
        dz = things[agent, Z] - numbers[k + 1]
        inside = inside and numbers[k + 2] * dx + numbers[k + 3] * dz > 0.0
    return bool(inside)


@device_function()
def _touch_sign(things: Things, numbers: Numbers, agent: int, own: int) -> float:
    """Return 1 if the agent is near the right entity, -1 if near another of the rule's, and 0 if near none.

    The right one is number ``numbers[own]``, from 0. If several are near, the last one counts.
    """
    reward = 0.0
    for k in range(int(numbers[RULE_THINGS])):
        if _near(things, numbers, int(numbers[ARGUMENTS + k]), agent):
            reward = 1.0 if k == int(numbers[own]) else -1.0
    return reward


@device_function()
def _faces(things: Things, numbers: Numbers, agent: int, own: int, ahead_x: float, ahead_z: float) -> bool:
    """Return whether the rule's entity is within ``numbers[own + 1]`` of the point ``numbers[own]`` metres ahead."""
    goal = int(numbers[ARGUMENTS])
    dx = things[agent, X] + numbers[own] * ahead_x - things[goal, X]
    dz = things[agent, Z] + numbers[own] * ahead_z - things[goal, Z]
    return bool(math.sqrt(dx * dx + dz * dz) <= numbers[own + 1])


@device_function()
def _judge(things: Things, numbers: Numbers, ahead_x: float, ahead_z: float, named: int) -> int:
    """Store the reward of a step by action number ``named`` of ACTIONS, maybe remove an entity; return the status."""
    agent = int(numbers[AGENT])
    carried = int(numbers[CARRIED])
    rule = int(numbers[RULE])
    own = ARGUMENTS + int(numbers[RULE_THINGS])  # where the rule's numbers are
    reward = 0.0
    ended = False
    status = 0
    success = 1.0
    if numbers[STEP_LIMIT] >= 0.0:
        success = 1.0 - 0.2 * (numbers[STEPS] / numbers[STEP_LIMIT])
    if rule == GOAL:
        reached = _near(things, numbers, int(numbers[ARGUMENTS]), agent)
        reward = _reward_if(reached, success)
        ended = _is_in_forbidden_room(things, numbers, agent, own) or reached
    elif rule == TAKE_ALL and carried >= 0:
        _remove(things, numbers, carried)
        numbers[SCORE] += 1.0
        reward = 1.0
        ended = numbers[SCORE] == numbers[own]
        status = HANDS | GONE
    elif rule == PUT_NEXT and carried < 0:
        ended = _near(things, numbers, int(numbers[ARGUMENTS]), int(numbers[ARGUMENTS + 1]))
        reward = _reward_if(ended, success)
    elif rule == HEALTH:
        numbers[SCORE] -= numbers[own]
        if named == PICKUP and carried >= 0:
            _remove(things, numbers, carried)
            numbers[SCORE] = numbers[own + 1]
            status = HANDS | GONE | PLACES
        ended = numbers[SCORE] <= 0.0
        reward = numbers[own + 3] if ended else numbers[own + 2]
    elif rule == SIGN:
        reward = _touch_sign(things, numbers, agent, own)
        ended = named == DONE or reward != 0.0
    elif rule == FACE:
        ended = _faces(things, numbers, agent, own, ahead_x, ahead_z)
        reward = _reward_if(ended, success)
    numbers[REWARD] = reward
    return status | (TERMINATED if ended else 0)


@kernel(
    "int64(float64[:, ::1], float64[::1], float64[:, ::1], float64, float64, float64, float64, int64, int64)",
    only=True,
    hold_gil=True,
)
def act(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    cosine: float,
    sine: float,
    cosine_after: float,
    sine_after: float,
    action: int,
    parts: int,
) -> int:
    """Execute parts of a step and return its status. ``numbers[STEPS]`` already counts the step.

    Args:
        things: the entities
        numbers: the rest of the state, which receives the reward
        walls: the walls of the floor plan, (n, 4)
        cosine: the cosine of the agent's heading
        sine: the sine of the agent's heading
        cosine_after: the cosine of the heading after a turn, if the action is a turn
        sine_after: the sine of the heading after a turn, if the action is a turn
        action: the world's action; -1 to judge a move that is none of them
        parts: the parts to execute: ACT, JUDGE or both
    """
    status: int = int64(0)
    if parts & ACT:
        status = _move(things, numbers, walls, cosine, -sine, cosine_after, -sine_after, action)
    if not parts & JUDGE:
        return status
    if status & MOVED != 0 and int(numbers[NAMED + action]) >> 3 <= TURN_RIGHT:
        cosine = cosine_after
        sine = sine_after
    named = int(numbers[NAMED + action]) & 7 if action >= 0 else MOVE_FORWARD
    status |= _judge(things, numbers, cosine, -sine, named)
    limit = numbers[STEP_LIMIT]
    return status | (TRUNCATED if limit >= 0.0 and numbers[STEPS] >= limit else 0)


@device_function()
def _uniform(rng_state: RngState, low: float, high: float) -> float:
    """Draw a number in [low, high), as ``Generator.uniform`` does."""
    return low + (high - low) * (unit(rng_state) * _UNIT)


@device_function()
def draw_motion(numbers: Numbers, rng_state: RngState) -> None:
    """Draw the length, the drift and the angle of a turn for the next step, if they vary."""
    if numbers[VARIES] != 0.0:
        for k in range(3):
            numbers[AHEAD + k] = _uniform(rng_state, numbers[LOW + k], numbers[HIGH + k])


@device_function()
def place_removed(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    rng_state: RngState,
    rooms: NDArray[np.float64],
    edges: NDArray[np.float64],
) -> None:
    """Place a removed entity at a random position where it touches nothing, as `WorldState.place` does.

    If no position is found, it stays removed.
    """
    thing = int(numbers[COUNT])
    radius = things[thing, RADIUS]
    for _ in range(_MOST_TRIES):
        share = unit(rng_state) * _UNIT
        room = 0
        while rooms[room, 0] <= share:
            room += 1
        x = _uniform(rng_state, rooms[room, 1] - radius, rooms[room, 2] + radius)
        unit(rng_state)  # Miniworld also draws a height
        z = _uniform(rng_state, rooms[room, 3] - radius, rooms[room, 4] + radius)
        inside = True
        for k in range(int(rooms[room, 5]), int(rooms[room, 6])):
            inside = inside and edges[k, 2] * (x - edges[k, 0]) + edges[k, 3] * (z - edges[k, 1]) > 0.0
        if inside and fits_at(things, numbers, walls, thing, x, z):
            things[thing, X] = x
            things[thing, Y] = 0.0
            things[thing, Z] = z
            things[thing, DIR] = _uniform(rng_state, -math.pi, math.pi)
            numbers[COUNT] += 1.0
            return


@kernel(
    "(float64[:, ::1], float64[::1], float64[:, ::1], uint64[::1], float64[:, ::1], float64[:, ::1], int64)",
    hold_gil=True,
)
def step(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    rng_state: RngState,
    rooms: NDArray[np.float64],
    edges: NDArray[np.float64],
    action: int,
) -> int:
    """Execute a whole step with our own sine and all of its random draws; return its status.

    ``rooms`` are (n, 7): the running sum of their weights, their bounds in x and z, and the range of their edges; rows
    of ``edges`` are a start x, z and a normal x, z.
    """
    numbers[STEPS] += 1.0
    draw_motion(numbers, rng_state)
    heading = things[int(numbers[AGENT]), DIR]
    after = 0.0
    motion = int(numbers[NAMED + action]) >> 3
    if motion <= TURN_RIGHT:
        angle = numbers[TURN_DEG] * _RADIANS
        after = heading + (angle if motion == TURN_LEFT else -angle)
    status = act(
        things, numbers, walls, wave(heading, 1), wave(heading, 0), wave(after, 1), wave(after, 0), action, ACT | JUDGE
    )
    if status & PLACES:
        place_removed(things, numbers, walls, rng_state, rooms, edges)
    return status


@kernel("(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1], int64, int64)", hold_gil=True)
def look(
    things: Things, numbers: Numbers, places: NDArray[np.float64], view: NDArray[np.float64], width: int, height: int
) -> None:
    """Write poses to ``places`` (NaN for absent entities) and a picture's camera to ``view``, as `RenderTarget`."""
    shadows = int(numbers[SHADOWS])
    for k in range(len(places)):
        for column in range(5):
            places[k, column] = np.nan
    for row in range(int(numbers[COUNT])):
        k = int(things[row, LOOK])
        if k < 0:
            continue
        cosine = wave(things[row, DIR], 1)
        sine = wave(things[row, DIR], 0)
        for at in (k, k + shadows):  # the thing and, if it stands on the ground, its shadow
            if at > k and things[row, Y] != 0.0:
                continue
            places[at, 0] = things[row, X]
            places[at, 1] = things[row, Y]
            places[at, 2] = things[row, Z]
            places[at, 3] = cosine
            places[at, 4] = sine
    agent = int(numbers[AGENT])
    ahead = numbers[CAMERA_AHEAD]
    cos_yaw = wave(things[agent, DIR], 1)
    sin_yaw = wave(things[agent, DIR], 0)
    cos_pitch = numbers[COS_PITCH]
    sin_pitch = numbers[SIN_PITCH]
    view[0] = things[agent, X] + ahead * cos_yaw
    view[1] = things[agent, Y] + numbers[EYE]
    view[2] = things[agent, Z] - ahead * sin_yaw
    view[3] = sin_yaw
    view[4] = 0.0
    view[5] = cos_yaw
    view[6] = -sin_pitch * cos_yaw
    view[7] = cos_pitch
    view[8] = sin_pitch * sin_yaw
    view[9] = cos_pitch * cos_yaw
    view[10] = sin_pitch
    view[11] = -cos_pitch * sin_yaw
    view[FOCAL_X] = view[FOCAL_Y] = height / 2 / numbers[TAN_FOV]
    view[CENTRE_X] = width / 2
    view[CENTRE_Y] = height / 2
    view[TOP] = 0.0
    view[BOTTOM] = height
    view[HEIGHT] = height
    view[WIDTH] = width
