"""What the eight actions do to a state, and what a step earns: Miniworld's rules exactly, over flat arrays.

`things` has a row for each thing on the stage in the order they were placed, the agent among them, and after them those
that are not on it but are carried or are a rule's. `numbers` is the rest of an episode; the rule's own come last. Whole
moves happen or do not. Python passes the sines of the heading, as logs without `trig` were played by the host's.
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
from minihuman.worlds.step_digest import stir
from minihuman.worlds.trigonometry import wave

ACTIONS = ("turn_left", "turn_right", "move_forward", "move_back", "pickup", "drop", "toggle", "done")
MOVES = ACTIONS[:3]
TURN_LEFT, TURN_RIGHT, MOVE_FORWARD, MOVE_BACK, PICKUP, DROP, TOGGLE, DONE = range(8)
MOST_ACTIONS = 16  # of a world

Things = NDArray[np.float64]  # (n, COLUMNS)
Numbers = NDArray[np.float64]

# Columns of a thing: metres and radians; 1.0 if static, and if the radius is a float32; its number in the scene or -1.
X, Y, Z, DIR, RADIUS, TALL, STATIC, SINGLE, LOOK = range(9)
COLUMNS = 9
# Of the numbers, -1 for none: things on the stage, the rows of the agent and of what it carries, steps, their limit,
# and what the rule counts
COUNT, AGENT, CARRIED, STEPS, STEP_LIMIT, SCORE = range(6)
REACH, EYE, CAMERA_AHEAD = 6, 7, 8  # the longest step; how high and how far before the body's middle its eye is, metres
COS_PITCH, SIN_PITCH, TAN_FOV = 9, 10, 11  # how the eye looks; the tangent is of half the angle
SHADOWS = 12  # after how many things of the scene their shadows come; 0 for none
AHEAD, DRIFT, TURN_DEG = 13, 14, 15  # how far a step goes and drifts, metres, and a turn turns, degrees
LOW, HIGH = 16, 19  # their ranges, three numbers each
VARIES, DRAWS = 22, 23  # 1.0 if they are drawn for each step, and if the rule or they need the random stream
REWARD = 24  # of the step
RULE, RULE_THINGS, RULE_NUMBERS = 25, 26, 27  # which, and how many things and numbers it is about
NAMED = 28  # for each action of the world its own number, and eight times what it does
GONE_ROW = NAMED + MOST_ACTIONS  # where the thing was that a step took off the stage
ARGUMENTS = GONE_ROW + 1  # rows of the rule's things, then its numbers

NEVER, GOAL, TAKE_ALL, PUT_NEXT, HEALTH, SIGN, FACE = range(7)  # rules; `termination` says what they are
ACT, JUDGE = 1, 2  # parts of a step
# What came of a step: the agent or its heading changed, what it carries did or moved, a thing left the stage, and is to
# be placed elsewhere
TERMINATED, TRUNCATED, MOVED, HANDS, LOAD, GONE, PLACES = 1, 2, 4, 8, 16, 32, 64
NOTHING, WALL = -1, -2

_RADIANS = math.pi / 180
_MOST_TRIES = 100_000
_UNIT = 2.0**-53
_LOW = np.uint64(0xFFFFFFFF)
_13, _15, _32 = np.uint64(13), np.uint64(15), np.uint64(32)
_A, _B = np.uint64(0x9E3779B1), np.uint64(0x85EBCA77)


@inline
def _sum(a: float, b: float, single: bool) -> float:
    """The sum of two lengths; in single precision if one of them is, as NumPy adds them."""
    return np.float64(np.float32(a) + np.float32(b)) if single else a + b


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
    """The row of the first thing that one of this radius would touch at a place; WALL, or NOTHING."""
    if touches_wall(walls, x, z, radius):
        return WALL
    for row in range(int(numbers[COUNT])):
        if row == thing:
            continue
        dx, dz = things[row, X] - x, things[row, Z] - z
        if math.sqrt(dx * dx + dz * dz) < _sum(radius, things[row, RADIUS], single or things[row, SINGLE] != 0.0):
            return row
    return NOTHING


@device_function()
def _near(things: Things, numbers: Numbers, a: int, b: int) -> bool:
    """Are two things within a step of touching?"""
    dx, dy, dz = things[a, X] - things[b, X], things[a, Y] - things[b, Y], things[a, Z] - things[b, Z]
    single = things[a, SINGLE] != 0.0 or things[b, SINGLE] != 0.0
    reach = _sum(_sum(things[a, RADIUS], things[b, RADIUS], single), 1.1 * numbers[REACH], single)
    return math.sqrt(dx * dx + dy * dy + dz * dz) < reach


@device_function()
def _fits(things: Things, numbers: Numbers, walls: NDArray[np.float64], thing: int, x: float, z: float) -> bool:
    """Whether a thing would touch nothing at a place."""
    found = _blocker(things, numbers, walls, thing, x, z, things[thing, RADIUS], things[thing, SINGLE] != 0.0)
    return found == NOTHING


@device_function()
def _floating(
    things: Things, numbers: Numbers, thing: int, x: float, z: float, ahead_x: float, ahead_z: float
) -> tuple[float, float, float]:
    """Where a carried thing floats when the agent stands at a place: in front, below the middle of the picture."""
    agent = int(numbers[AGENT])
    single = things[agent, SINGLE] != 0.0 or things[thing, SINGLE] != 0.0
    distance = _sum(_sum(things[agent, RADIUS], things[thing, RADIUS], single), numbers[REACH], single)
    rise = max(numbers[EYE] - things[thing, TALL] - 0.3, 0.0)
    return x + ahead_x * 1.05 * distance, things[agent, Y] + rise, z + ahead_z * 1.05 * distance


@device_function()
def _remove(things: Things, numbers: Numbers, row: int) -> None:
    """Take a thing off the stage; it is the row after the last one there then, and nothing is carried."""
    last = int(numbers[COUNT]) - 1
    for column in range(COLUMNS):
        value = things[row, column]
        for k in range(row, last):
            things[k, column] = things[k + 1, column]
        things[last, column] = value
    if numbers[AGENT] > row:
        numbers[AGENT] -= 1.0
    numbers[COUNT], numbers[CARRIED], numbers[GONE_ROW] = last, -1.0, row


@device_function()
def _move(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    ahead_x: float,
    ahead_z: float,
    after_x: float,
    after_z: float,
    action: int,
) -> int:
    agent, carried = int(numbers[AGENT]), int64(numbers[CARRIED])
    motion = int(numbers[NAMED + action]) >> 3
    x, z = things[agent, X], things[agent, Z]
    status = 0
    if motion in (MOVE_FORWARD, MOVE_BACK):
        ahead, drift = numbers[AHEAD] if motion == MOVE_FORWARD else -numbers[AHEAD], numbers[DRIFT]
        to_x, to_z = x + ahead_x * ahead - ahead_z * drift, z + ahead_z * ahead + ahead_x * drift
        if _fits(things, numbers, walls, agent, to_x, to_z):
            fits = True
            if carried >= 0:
                there = _floating(things, numbers, carried, to_x, to_z, ahead_x, ahead_z)
                fits = _fits(things, numbers, walls, carried, there[0], there[2])
            if fits:
                things[agent, X], things[agent, Z] = to_x, to_z
                status = MOVED
    elif motion in (TURN_LEFT, TURN_RIGHT):
        angle = numbers[TURN_DEG] * _RADIANS
        fits = True
        if carried >= 0:
            there = _floating(things, numbers, carried, x, z, after_x, after_z)
            fits = _fits(things, numbers, walls, carried, there[0], there[2])
        if fits:
            things[agent, DIR] += angle if motion == TURN_LEFT else -angle
            ahead_x, ahead_z = after_x, after_z
            status = MOVED
    elif motion == PICKUP and carried < 0:
        radius = things[agent, RADIUS]
        to_x, to_z = x + ahead_x * 1.5 * radius, z + ahead_z * 1.5 * radius
        found = _blocker(things, numbers, walls, agent, to_x, to_z, 1.2 * radius, False)
        if found >= 0 and things[found, STATIC] == 0.0:
            carried = int64(found)
            status = HANDS
    elif motion == DROP and carried >= 0:
        things[carried, Y] = 0.0
        carried = -1
        status = HANDS | LOAD
    numbers[CARRIED] = carried
    if carried >= 0:
        there = _floating(things, numbers, carried, things[agent, X], things[agent, Z], ahead_x, ahead_z)
        things[carried, X], things[carried, Y], things[carried, Z] = there
        things[carried, DIR] = things[agent, DIR]
        status |= LOAD
    return status


@device_function()
def _judge(things: Things, numbers: Numbers, ahead_x: float, ahead_z: float, action: int) -> int:
    """What a step earned and whether it ended the episode; a rule may take a thing off the stage."""
    agent, carried, rule = int(numbers[AGENT]), int(numbers[CARRIED]), int(numbers[RULE])
    named = int(numbers[NAMED + action]) & 7
    own = ARGUMENTS + int(numbers[RULE_THINGS])  # where the rule's numbers are
    reward, ended, status = 0.0, False, 0
    success = 1.0
    if numbers[STEP_LIMIT] >= 0.0:
        success = 1.0 - 0.2 * (numbers[STEPS] / numbers[STEP_LIMIT])
    if rule == GOAL:
        ended = _near(things, numbers, int(numbers[ARGUMENTS]), agent)
        reward = success if ended else 0.0
        inside = numbers[RULE_NUMBERS] > 0.0
        for k in range(own, own + int(numbers[RULE_NUMBERS]), 4):
            dx, dz = things[agent, X] - numbers[k], things[agent, Z] - numbers[k + 1]
            inside = inside and numbers[k + 2] * dx + numbers[k + 3] * dz > 0.0
        ended = ended or inside
    elif rule == TAKE_ALL and carried >= 0:
        _remove(things, numbers, carried)
        numbers[SCORE] += 1.0
        reward, ended, status = 1.0, numbers[SCORE] == numbers[own], HANDS | GONE
    elif rule == PUT_NEXT and carried < 0:
        ended = _near(things, numbers, int(numbers[ARGUMENTS]), int(numbers[ARGUMENTS + 1]))
        reward = success if ended else 0.0
    elif rule == HEALTH:
        numbers[SCORE] -= numbers[own]
        if named == PICKUP and carried >= 0:
            _remove(things, numbers, carried)
            numbers[SCORE] = numbers[own + 1]
            status = HANDS | GONE | PLACES
        ended = numbers[SCORE] <= 0.0
        reward = numbers[own + 3] if ended else numbers[own + 2]
    elif rule == SIGN:
        ended = named == DONE
        for k in range(int(numbers[RULE_THINGS])):
            if _near(things, numbers, int(numbers[ARGUMENTS + k]), agent):
                reward, ended = 1.0 if k == int(numbers[own]) else -1.0, True
    elif rule == FACE:
        goal = int(numbers[ARGUMENTS])
        dx = things[agent, X] + numbers[own] * ahead_x - things[goal, X]
        dz = things[agent, Z] + numbers[own] * ahead_z - things[goal, Z]
        ended = math.sqrt(dx * dx + dz * dz) <= numbers[own + 1]
        reward = success if ended else 0.0
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
    """Do a step's parts, ACT or JUDGE or both; what came of it. ``numbers[STEPS]`` counts the step already.

    Args:
        things: The things.
        numbers: The rest; the reward is put there.
        walls: Of the floor plan, (n, 4).
        cosine: Of the agent's heading.
        sine: Of the agent's heading.
        cosine_after: Of the heading after a turn, if the action is one.
        sine_after: The same.
        action: The world's.
        parts: ACT | JUDGE.
    """
    status: int = int64(0)
    if parts & ACT:
        status = _move(things, numbers, walls, cosine, -sine, cosine_after, -sine_after, action)
    if not parts & JUDGE:
        return status
    if status & MOVED != 0 and int(numbers[NAMED + action]) >> 3 <= TURN_RIGHT:
        cosine, sine = cosine_after, sine_after
    status |= _judge(things, numbers, cosine, -sine, action)
    limit = numbers[STEP_LIMIT]
    return status | (TRUNCATED if limit >= 0.0 and numbers[STEPS] >= limit else 0)


@device_function()
def _uniform(rng_state: RngState, low: float, high: float) -> float:
    return low + (high - low) * (unit(rng_state) * _UNIT)


@device_function()
def _place(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    rng_state: RngState,
    rooms: NDArray[np.float64],
    edges: NDArray[np.float64],
) -> None:
    """Put what was taken off the stage where it touches nothing, by chance, as `WorldState.place` does."""
    thing = int(numbers[COUNT])
    radius = things[thing, RADIUS]
    for _ in range(_MOST_TRIES):
        drawn, room = unit(rng_state) * _UNIT, 0
        while rooms[room, 0] <= drawn:
            room += 1
        x = _uniform(rng_state, rooms[room, 1] - radius, rooms[room, 2] + radius)
        unit(rng_state)  # Miniworld draws a height too
        z = _uniform(rng_state, rooms[room, 3] - radius, rooms[room, 4] + radius)
        inside = True
        for k in range(int(rooms[room, 5]), int(rooms[room, 6])):
            inside = inside and edges[k, 2] * (x - edges[k, 0]) + edges[k, 3] * (z - edges[k, 1]) > 0.0
        if inside and _fits(things, numbers, walls, thing, x, z):
            things[thing, X], things[thing, Y], things[thing, Z] = x, 0.0, z
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
    """A whole step, by our own sine and with what it draws; what came of it.

    ``rooms`` are (n, 7): the running sum of their weights, their bounds x and z, and their edges from and to; rows of
    ``edges`` are a start x, z and a normal x, z.
    """
    numbers[STEPS] += 1.0
    if numbers[VARIES] != 0.0:
        for k in range(3):
            numbers[AHEAD + k] = _uniform(rng_state, numbers[LOW + k], numbers[HIGH + k])
    heading, after = things[int(numbers[AGENT]), DIR], 0.0
    motion = int(numbers[NAMED + action]) >> 3
    if motion <= TURN_RIGHT:
        angle = numbers[TURN_DEG] * _RADIANS
        after = heading + (angle if motion == TURN_LEFT else -angle)
    status = act(
        things, numbers, walls, wave(heading, 1), wave(heading, 0), wave(after, 1), wave(after, 0), action, ACT | JUDGE
    )
    if status & PLACES:
        _place(things, numbers, walls, rng_state, rooms, edges)
    return status


@kernel("(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1], int64, int64)", hold_gil=True)
def look(
    things: Things, numbers: Numbers, places: NDArray[np.float64], view: NDArray[np.float64], width: int, height: int
) -> None:
    """Put the scene's things in their places, and the eye into a view of so many pixels, as `RenderTarget` does."""
    shadows = int(numbers[SHADOWS])
    for k in range(len(places)):
        for column in range(5):
            places[k, column] = np.nan
    for row in range(int(numbers[COUNT])):
        k = int(things[row, LOOK])
        if k < 0:
            continue
        cosine, sine = wave(things[row, DIR], 1), wave(things[row, DIR], 0)
        for at in (k, k + shadows):
            if at > k and things[row, Y] != 0.0:
                continue
            places[at, 0], places[at, 1], places[at, 2] = things[row, X], things[row, Y], things[row, Z]
            places[at, 3], places[at, 4] = cosine, sine
    agent, ahead = int(numbers[AGENT]), numbers[CAMERA_AHEAD]
    cos_yaw, sin_yaw = wave(things[agent, DIR], 1), wave(things[agent, DIR], 0)
    cos_pitch, sin_pitch = numbers[COS_PITCH], numbers[SIN_PITCH]
    view[0] = things[agent, X] + ahead * cos_yaw
    view[1] = things[agent, Y] + numbers[EYE]
    view[2] = things[agent, Z] - ahead * sin_yaw
    view[3], view[4], view[5] = sin_yaw, 0.0, cos_yaw
    view[6], view[7], view[8] = -sin_pitch * cos_yaw, cos_pitch, sin_pitch * sin_yaw
    view[9], view[10], view[11] = cos_pitch * cos_yaw, sin_pitch, -cos_pitch * sin_yaw
    view[FOCAL_X] = view[FOCAL_Y] = height / 2 / numbers[TAN_FOV]
    view[CENTRE_X], view[CENTRE_Y] = width / 2, height / 2
    view[TOP], view[BOTTOM], view[HEIGHT], view[WIDTH] = 0.0, height, height, width


@kernel("(float64[:, ::1], float64[::1], uint64[::1], uint64[::1])", hold_gil=True)
def digest_state(things: Things, numbers: Numbers, rng_state: RngState, outcome: NDArray[np.uint64]) -> np.uint64:
    """Digest what a step led to; ``outcome`` as in the grid's `digest_step`."""
    one, other = _A, _B
    rows = max(int(numbers[COUNT]), int(numbers[CARRIED]) + 1)
    places, state = things.view(np.uint64), numbers.view(np.uint64)
    for row in range(rows):
        for column in range(DIR + 1):
            value = places[row, column]
            for half in (value & _LOW, value >> _32):
                one, other = stir(one, half, _A, _15), stir(other, half, _B, _13)
    for k in range(SCORE + 1):
        for half in (state[k] & _LOW, state[k] >> _32):
            one, other = stir(one, half, _A, _15), stir(other, half, _B, _13)
    if numbers[DRAWS] != 0.0:
        for k in range(len(rng_state)):
            for half in (rng_state[k] & _LOW, rng_state[k] >> _32):
                one, other = stir(one, half, _A, _15), stir(other, half, _B, _13)
    for k in range(len(outcome)):
        for half in (outcome[k] & _LOW, outcome[k] >> _32):
            one, other = stir(one, half, _A, _15), stir(other, half, _B, _13)
    return one << _32 | other
