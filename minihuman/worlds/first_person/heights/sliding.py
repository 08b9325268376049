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


def approach_velocity(
    velocity: tuple[float, float], target: tuple[float, float], max_change: float
) -> tuple[float, float]:
    """Return a velocity changed towards a target velocity, by at most ``max_change`` in length."""
    change_x = target[0] - velocity[0]
    change_z = target[1] - velocity[1]
    length = math.sqrt(change_x * change_x + change_z * change_z)
    if length <= max_change:
        return target
    share = max_change / length
    return velocity[0] + share * change_x, velocity[1] + share * change_z


def limit_length(x: float, z: float) -> tuple[float, float]:
    """Return a vector, shortened to length 1 if it is longer, so that diagonal moves are as fast as straight ones."""
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
        position = _find_free_position(stage, before[0] + dx / n_parts, before[2] + dz / n_parts)
        if position is None:
            break
        agent.pos = position
        if not _load_fits(stage):
            agent.pos = before
            break
    _bring_load(stage)
    return (agent.pos[0], agent.pos[2]) != (x0, z0)


def _find_free_position(stage: BuildingState, x: float, z: float) -> Position | None:
    """Return a position near a point at which the agent overlaps nothing; None if a few pushes find none."""
    for _ in range(_MOST_PUSHES):
        position = stage.find_place(stage.agent, x, z)
        if position is not None:
            return position
        x, z = _push_out(stage, x, z)
    return stage.find_place(stage.agent, x, z)


def _push_out(stage: BuildingState, x: float, z: float) -> tuple[float, float]:
    """Return a point near (x, z) at which the agent no longer overlaps the wall or thing that it overlaps most.

    That is (x, z) itself if it lies on a wall.
    """
    near_x, near_z, reach = _find_deepest(stage, x, z)
    away_x = x - near_x
    away_z = z - near_z
    distance = math.sqrt(away_x * away_x + away_z * away_z)
    if distance == 0.0:  # on the wall itself, which has no side
        return x, z
    share = (reach + _CLEARANCE_M) / distance
    return near_x + share * away_x, near_z + share * away_z


def _find_deepest(stage: BuildingState, x: float, z: float) -> tuple[float, float, float]:
    """Return the point of a wall or thing that the agent at (x, z) overlaps most, and the distance that it must keep.

    The result is the agent's own point and radius if nothing is near.
    """
    agent = stage.agent
    radius = float(agent.radius)
    points = _nearest_on_walls(stage.solid_walls(agent, x, z), x, z)
    distances = np.sqrt((points[:, 0] - x) ** 2 + (points[:, 1] - z) ** 2)
    deepest = (math.inf, x, z, radius)
    if len(points):
        row = int(distances.argmin())
        deepest = (float(distances[row]) - radius, float(points[row, 0]), float(points[row, 1]), radius)
    for entity in stage.entities:
        if not stage.is_beside(agent, entity):
            continue
        reach = float(agent.radius + entity.radius)
        dx = entity.pos[0] - x
        dz = entity.pos[2] - z
        gap = math.sqrt(dx * dx + dz * dz) - reach
        if gap < deepest[0]:
            deepest = (gap, entity.pos[0], entity.pos[2], reach)
    return deepest[1:]


def _nearest_on_walls(walls: NDArray[np.float64], x: float, z: float) -> NDArray[np.float64]:
    """Return the point of each wall that is nearest to (x, z), float64[n, 2]."""
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
    """Move what the agent carries to its place in front of the agent, with the agent's heading."""
    load: Entity | None = stage.agent.carrying
    if load is not None:
        load.pos = stage.carrying_position(stage.agent.pos, load)
        load.dir = stage.agent.dir
