"""Motion of the agent's body beyond the eight actions: moves that slide along what they meet, over the rules' arrays.

A move is made in parts shorter than the body, so that nothing is passed through. Where a part would overlap walls or
entities, the body is pushed out of them along their normals: what remains is the component along them. All numbers are
sums, products, quotients and square roots of doubles, so a path is the same on every machine if headings are turned by
our own sine (`trig`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.rules import (
    ACCELERATION,
    ACT,
    AGENT,
    AHEAD,
    CARRIED,
    COUNT,
    DIR,
    DRIFT,
    JUDGE,
    LOAD,
    MOVED,
    NAMED,
    PLACES,
    RADIUS,
    SINGLE,
    STEPS,
    TURN_DEG,
    TURN_LEFT,
    TURN_RIGHT,
    VELOCITY,
    Numbers,
    Things,
    X,
    Y,
    Z,
    act,
    add_lengths,
    draw_motion,
    find_carried_place,
    fits_at,
    place_removed,
)
from minihuman.worlds.kernels import device_function, kernel
from minihuman.worlds.rng import RngState
from minihuman.worlds.trigonometry import wave

RADIANS = math.pi / 180  # of a degree, as the eight actions have it
# Components of a command, each -1 to 1: the step ahead as a share of the longest step, the turn to the left as a share
# of the widest turn, and the step to the right as a share of the longest step
COMMAND_AHEAD, COMMAND_TURN, COMMAND_RIGHT = range(3)
COMMAND_SIZE = 3

_MOST_PUSHES = 4  # the number of times that one part of a move is pushed out of walls and entities
_CLEARANCE_M = 1e-9  # between the body and the obstacle that pushed it out, so that rounding leaves no overlap
_PART = 0.5  # the length of a part of a move, as a share of the body's radius


@device_function()
def _find_nearest_wall(walls: NDArray[np.float64], x: float, z: float) -> tuple[float, float, float]:
    """Return the distance from (x, z) to the nearest point of a wall, and that point; infinity if there is no wall."""
    nearest = math.inf
    near_x = x
    near_z = z
    for row in range(len(walls)):
        along_x = walls[row, 2] - walls[row, 0]
        along_z = walls[row, 3] - walls[row, 1]
        squared_m = along_x * along_x + along_z * along_z
        share = ((x - walls[row, 0]) * along_x + (z - walls[row, 1]) * along_z) / squared_m
        share = min(max(share, 0.0), 1.0)
        on_x = walls[row, 0] + share * along_x
        on_z = walls[row, 1] + share * along_z
        dx = on_x - x
        dz = on_z - z
        distance = math.sqrt(dx * dx + dz * dz)
        if distance < nearest:
            nearest = distance
            near_x = on_x
            near_z = on_z
    return nearest, near_x, near_z


@device_function()
def _push_out(things: Things, numbers: Numbers, walls: NDArray[np.float64], x: float, z: float) -> tuple[float, float]:
    """Return a place at which the agent no longer overlaps the wall or entity that it would overlap most at (x, z).

    That is (x, z) itself if it lies on a wall.
    """
    agent = int(numbers[AGENT])
    radius = things[agent, RADIUS]
    nearest, near_x, near_z = _find_nearest_wall(walls, x, z)
    deepest = nearest - radius
    reach = radius
    for row in range(int(numbers[COUNT])):
        if row == agent:
            continue
        single = things[agent, SINGLE] != 0.0 or things[row, SINGLE] != 0.0
        both = add_lengths(radius, things[row, RADIUS], single)
        dx = things[row, X] - x
        dz = things[row, Z] - z
        overlap = math.sqrt(dx * dx + dz * dz) - both
        if overlap < deepest:
            deepest = overlap
            near_x = things[row, X]
            near_z = things[row, Z]
            reach = both
    away_x = x - near_x
    away_z = z - near_z
    distance = math.sqrt(away_x * away_x + away_z * away_z)
    if distance == 0.0:  # on the wall itself, which has no side
        return x, z
    share = (reach + _CLEARANCE_M) / distance
    return near_x + share * away_x, near_z + share * away_z


@device_function()
def _find_free_place(
    things: Things, numbers: Numbers, walls: NDArray[np.float64], x: float, z: float
) -> tuple[bool, float, float]:
    """Return whether pushes find a place near (x, z) at which the agent overlaps nothing, and that place."""
    agent = int(numbers[AGENT])
    for _ in range(_MOST_PUSHES):
        if fits_at(things, numbers, walls, agent, x, z):
            return True, x, z
        x, z = _push_out(things, numbers, walls, x, z)
    return fits_at(things, numbers, walls, agent, x, z), x, z


@device_function()
def _load_fits(things: Things, numbers: Numbers, walls: NDArray[np.float64], ahead_x: float, ahead_z: float) -> bool:
    """Return whether the carried entity, if any, overlaps nothing with the agent where it is and a given heading.

    The heading is the unit vector (ahead_x, ahead_z).
    """
    carried = int(numbers[CARRIED])
    if carried < 0:
        return True
    agent = int(numbers[AGENT])
    place = find_carried_place(things, numbers, carried, things[agent, X], things[agent, Z], ahead_x, ahead_z)
    return fits_at(things, numbers, walls, carried, place[0], place[2])


@device_function()
def _turn_to(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    heading: float,
    ahead_x: float,
    ahead_z: float,
) -> bool:
    """Turn the agent to a heading, unless what it carries would then overlap something; return whether it turned."""
    if not _load_fits(things, numbers, walls, ahead_x, ahead_z):
        return False
    things[int(numbers[AGENT]), DIR] = heading
    return True


@device_function()
def _slide(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    dx: float,
    dz: float,
    ahead_x: float,
    ahead_z: float,
) -> bool:
    """Move the agent by (dx, dz) metres, sliding along obstacles, and what it carries; return whether it moved.

    The heading is the unit vector (ahead_x, ahead_z).
    """
    agent = int(numbers[AGENT])
    x0 = things[agent, X]
    z0 = things[agent, Z]
    n_parts = max(1, math.ceil(math.sqrt(dx * dx + dz * dz) / (_PART * things[agent, RADIUS])))
    for _ in range(n_parts):
        x = things[agent, X]
        z = things[agent, Z]
        is_free, to_x, to_z = _find_free_place(things, numbers, walls, x + dx / n_parts, z + dz / n_parts)
        if not is_free:
            break
        things[agent, X] = to_x
        things[agent, Z] = to_z
        if not _load_fits(things, numbers, walls, ahead_x, ahead_z):
            things[agent, X] = x
            things[agent, Z] = z
            break
    carried = int(numbers[CARRIED])
    if carried >= 0:
        place = find_carried_place(things, numbers, carried, things[agent, X], things[agent, Z], ahead_x, ahead_z)
        things[carried, X], things[carried, Y], things[carried, Z] = place
        things[carried, DIR] = things[agent, DIR]
    return bool(things[agent, X] != x0 or things[agent, Z] != z0)


@device_function()
def _get_changes(numbers: Numbers, has_moved: bool) -> int:
    """Return the status of a move: MOVED if the agent has moved or turned, and LOAD if it carries something."""
    status = 0
    if has_moved:
        status |= MOVED
    if numbers[CARRIED] >= 0.0:
        status |= LOAD
    return status


@kernel(
    "int64(float64[:, ::1], float64[::1], float64[:, ::1], float64, float64, float64, float64, float64, float64,"
    " float64)",
    only=True,
    hold_gil=True,
)
def move_by(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    dx: float,
    dz: float,
    dyaw: float,
    cosine: float,
    sine: float,
    cosine_after: float,
    sine_after: float,
) -> int:
    """Turn the agent to the left, then move it in the floor plan; return the status of `rules.act`.

    Args:
        things: the entities
        numbers: the rest of the state
        walls: the walls of the floor plan, (n, 4)
        dx: metres along x
        dz: metres along z
        dyaw: radians to the left
        cosine: the cosine of the agent's heading
        sine: the sine of the agent's heading
        cosine_after: the cosine of the heading after the turn
        sine_after: the sine of the heading after the turn
    """
    heading = things[int(numbers[AGENT]), DIR] + dyaw
    has_turned = _turn_to(things, numbers, walls, heading, cosine_after, -sine_after)
    if has_turned:
        cosine = cosine_after
        sine = sine_after
    has_slid = _slide(things, numbers, walls, dx, dz, cosine, -sine)
    return _get_changes(numbers, has_slid or (has_turned and dyaw != 0.0))


@device_function()
def _find_velocity(numbers: Numbers, command: NDArray[np.float64]) -> tuple[float, float]:
    """Return the velocity ahead and to the right in this step, as shares of the longest step.

    If the acceleration is limited, the velocity is also stored for the next step.
    """
    ahead = command[COMMAND_AHEAD]
    right = command[COMMAND_RIGHT]
    length = math.sqrt(ahead * ahead + right * right)
    if length > 1.0:
        ahead = ahead / length
        right = right / length
    most = numbers[ACCELERATION]
    if most > 0.0:
        change_ahead = ahead - numbers[VELOCITY]
        change_right = right - numbers[VELOCITY + 1]
        length = math.sqrt(change_ahead * change_ahead + change_right * change_right)
        if length > most:
            share = most / length
            ahead = numbers[VELOCITY] + share * change_ahead
            right = numbers[VELOCITY + 1] + share * change_right
        numbers[VELOCITY] = ahead
        numbers[VELOCITY + 1] = right
    return ahead, right


@kernel(
    "int64(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1], float64, float64, float64, float64)",
    only=True,
    hold_gil=True,
)
def move_freely(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    command: NDArray[np.float64],
    cosine: float,
    sine: float,
    cosine_after: float,
    sine_after: float,
) -> int:
    """Turn the agent and then move it, as a command says; return the status of `rules.act`.

    A diagonal move is no faster than a straight one. If the acceleration is limited, the velocity approaches that of
    the command by at most that much per step.

    Args:
        things: the entities
        numbers: the rest of the state
        walls: the walls of the floor plan, (n, 4)
        command: the components, each -1 to 1, float64[COMMAND_SIZE]
        cosine: the cosine of the agent's heading
        sine: the sine of the agent's heading
        cosine_after: the cosine of the heading after the turn
        sine_after: the sine of the heading after the turn
    """
    ahead, right = _find_velocity(numbers, command)
    turn = command[COMMAND_TURN] * (numbers[TURN_DEG] * RADIANS)
    heading = things[int(numbers[AGENT]), DIR] + turn
    has_turned = _turn_to(things, numbers, walls, heading, cosine_after, -sine_after)
    if has_turned:
        cosine = cosine_after
        sine = sine_after
    ahead_m = ahead * numbers[AHEAD]
    right_m = right * numbers[AHEAD] + ahead * numbers[DRIFT]
    dx = cosine * ahead_m - -sine * right_m  # the heading is (cosine, -sine); the order of terms is that of `rules`
    dz = -sine * ahead_m + cosine * right_m
    has_slid = _slide(things, numbers, walls, dx, dz, cosine, -sine)
    return _get_changes(numbers, has_slid or (has_turned and turn != 0.0))


@kernel(
    "(float64[:, ::1], float64[::1], float64[:, ::1], uint64[::1], float64[:, ::1], float64[:, ::1], float64[::1],"
    " int64)",
    hold_gil=True,
)
def step_freely(
    things: Things,
    numbers: Numbers,
    walls: NDArray[np.float64],
    rng_state: RngState,
    rooms: NDArray[np.float64],
    edges: NDArray[np.float64],
    command: NDArray[np.float64],
    action: int,
) -> int:
    """Execute a whole step with our own sine and all of its random draws, as `rules.step`; return its status.

    ``action`` is the world's action that the hands execute after the move; -1 for none.
    """
    numbers[STEPS] += 1.0
    draw_motion(numbers, rng_state)
    agent = int(numbers[AGENT])
    heading = things[agent, DIR]  # of which ``wave`` returns the cosine with 1, and the sine with 0
    after = heading + command[COMMAND_TURN] * (numbers[TURN_DEG] * RADIANS)
    status = move_freely(
        things, numbers, walls, command, wave(heading, 1), wave(heading, 0), wave(after, 1), wave(after, 0)
    )
    heading = things[agent, DIR]
    if action >= 0:
        draw_motion(numbers, rng_state)
        motion = int(numbers[NAMED + action]) >> 3  # see `rules.NAMED`
        after = heading
        if motion <= TURN_RIGHT:
            angle = numbers[TURN_DEG] * RADIANS
            after = heading + (angle if motion == TURN_LEFT else -angle)
        status |= act(
            things, numbers, walls, wave(heading, 1), wave(heading, 0), wave(after, 1), wave(after, 0), action, ACT
        )
        heading = things[agent, DIR]
    cosine = wave(heading, 1)
    sine = wave(heading, 0)
    status |= act(things, numbers, walls, cosine, sine, cosine, sine, action, JUDGE)
    if status & PLACES:
        place_removed(things, numbers, walls, rng_state, rooms, edges)
    return status
