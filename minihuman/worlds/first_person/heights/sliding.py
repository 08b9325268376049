"""Moves of a body over heights that slide along what they meet: the rules of `motion_kernels`, in Python.

A move is made in parts shorter than the body, so that nothing is passed through. Where a part would overlap walls or
things, the body is pushed out of them along their normals: what remains is the component along them.
"""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.entities import Entity, Position
from minihuman.worlds.first_person.heights.state import BuildingState

_MOST_PUSHES = 4  # out of walls and things, for one part of a move
_CLEARANCE_M = 1e-9  # between the body and what pushed it out, so that rounding leaves no overlap
_PART = 0.5  # of the body's radius: the length of a part of a move


def approach(velocity: tuple[float, float], wanted: tuple[float, float], most: float) -> tuple[float, float]:
    """Return a velocity that has come nearer to the wanted one, by at most ``most`` in length."""
    change_x = wanted[0] - velocity[0]
    change_z = wanted[1] - velocity[1]
    length = math.sqrt(change_x * change_x + change_z * change_z)
    if length <= most:
        return wanted
    share = most / length
    return velocity[0] + share * change_x, velocity[1] + share * change_z


def limit_length(x: float, z: float) -> tuple[float, float]:
    """Return a vector, shortened to length 1 if it is longer: who goes ahead and sideways is no faster."""
    length = math.sqrt(x * x + z * z)
    if length <= 1.0:
        return x, z
    return x / length, z / length


def turn_body(stage: BuildingState, angle_rad: float) -> bool:
    """Turn the agent to the left by an angle; return whether it turned.

    It does not turn if what it carries would then overlap something.
    """
    agent = stage.agent
    before = agent.dir
    agent.dir = before + angle_rad
    if not _load_fits(stage):
        agent.dir = before
        return False
    _bring_load(stage)
    return angle_rad != 0.0


def walk(stage: BuildingState, ahead_m: float, right_m: float) -> bool:
    """Move the agent by metres ahead and to the right of its heading, as `slide` does; return whether it moved."""
    ahead_x, ahead_z = stage.agent.forward
    return slide(stage, ahead_x * ahead_m - ahead_z * right_m, ahead_z * ahead_m + ahead_x * right_m)


def slide(stage: BuildingState, dx: float, dz: float) -> bool:
    """Move the agent by metres in the plan, along what stands in its way; return whether it moved."""
    agent = stage.agent
    x0, _, z0 = agent.pos
    distance = math.sqrt(dx * dx + dz * dz)
    n_parts = max(1, math.ceil(distance / (_PART * float(agent.radius))))
    for _ in range(n_parts):
        before = agent.pos
        place = _find_free_place(stage, before[0] + dx / n_parts, before[2] + dz / n_parts)
        if place is None:
            break
        agent.pos = place
        if not _load_fits(stage):
            agent.pos = before
            break
    _bring_load(stage)
    return (agent.pos[0], agent.pos[2]) != (x0, z0)


def _find_free_place(stage: BuildingState, x: float, z: float) -> Position | None:
    """Return the position nearest to a point at which the agent overlaps nothing, as far as pushes find one."""
    for _ in range(_MOST_PUSHES):
        place = stage.find_place(stage.agent, x, z)
        if place is not None:
            return place
        x, z = _push_out(stage, x, z)
    return stage.find_place(stage.agent, x, z)


def _push_out(stage: BuildingState, x: float, z: float) -> tuple[float, float]:
    """Return a point from which the agent no longer overlaps what it overlapped most."""
    near_x, near_z, reach = _find_deepest(stage, x, z)
    away_x = x - near_x
    away_z = z - near_z
    distance = math.sqrt(away_x * away_x + away_z * away_z)
    if distance == 0.0:  # on the wall itself, which has no side
        return x, z
    share = (reach + _CLEARANCE_M) / distance
    return near_x + share * away_x, near_z + share * away_z


def _find_deepest(stage: BuildingState, x: float, z: float) -> tuple[float, float, float]:
    """Return the point (x, z) that the agent would overlap most, and the distance at which it would not."""
    agent = stage.agent
    radius = float(agent.radius)
    points = _nearest_on_walls(stage.solid_walls(agent, x, z), x, z)
    distances = np.sqrt((points[:, 0] - x) ** 2 + (points[:, 1] - z) ** 2)
    deepest = (math.inf, x, z, radius)
    if len(points):
        row = int(distances.argmin())
        deepest = (float(distances[row]) - radius, float(points[row, 0]), float(points[row, 1]), radius)
    for other in stage.entities:
        if not stage.is_beside(agent, other):
            continue
        reach = float(agent.radius + other.radius)
        dx = other.pos[0] - x
        dz = other.pos[2] - z
        overlap = math.sqrt(dx * dx + dz * dz) - reach
        if overlap < deepest[0]:
            deepest = (overlap, other.pos[0], other.pos[2], reach)
    return deepest[1:]


def _nearest_on_walls(walls: NDArray[np.float64], x: float, z: float) -> NDArray[np.float64]:
    """Return the point (x, z) of each wall that is nearest to a place, (n, 2)."""
    start = walls[:, :2]
    along = walls[:, 2:] - start
    shares = ((x - start[:, 0]) * along[:, 0] + (z - start[:, 1]) * along[:, 1]) / (along[:, 0] ** 2 + along[:, 1] ** 2)
    nearest: NDArray[np.float64] = start + np.clip(shares, 0.0, 1.0)[:, None] * along
    return nearest


def _load_fits(stage: BuildingState) -> bool:
    """Return whether what the agent carries overlaps nothing where the agent is now."""
    load = stage.agent.carrying
    if load is None:
        return True
    return stage.load_fits(load, *stage.carrying_position(stage.agent.pos, load))


def _bring_load(stage: BuildingState) -> None:
    """Put what the agent carries before it."""
    load: Entity | None = stage.agent.carrying
    if load is not None:
        load.pos = stage.carrying_position(stage.agent.pos, load)
        load.dir = stage.agent.dir
