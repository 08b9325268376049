"""The effects of the eight actions in a building: as in flat rooms, but for what heights change.

A move happens completely or not at all. A thing that the agent puts down lies on the floor below it.
"""

import math

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.heights.sliding import turn_body
from minihuman.worlds.first_person.heights.state import BuildingState
from minihuman.worlds.first_person.motion_kernels import RADIANS
from minihuman.worlds.first_person.rules import (
    DROP,
    MOVE_BACK,
    MOVE_FORWARD,
    PICKUP,
    TURN_LEFT,
    TURN_RIGHT,
)
from minihuman.worlds.first_person.state import MOTION_PARAMETERS

_AHEAD_RADII = 1.5  # how far ahead of the body's middle hands reach, in radii of the body
_AROUND_RADII = 1.2  # how far around that point they reach, likewise


def act(stage: BuildingState, motion: int) -> None:
    """Do one of the eight actions of flat rooms, by its number in `rules.ACTIONS`."""
    ahead_m, drift_m, turn_deg = (stage.parameters.number(name, stage.varying) for name in MOTION_PARAMETERS)
    if motion == TURN_LEFT:
        turn_body(stage, turn_deg * RADIANS)
    elif motion == TURN_RIGHT:
        turn_body(stage, -(turn_deg * RADIANS))
    elif motion == MOVE_FORWARD:
        step(stage, ahead_m, drift_m)
    elif motion == MOVE_BACK:
        step(stage, -ahead_m, drift_m)
    elif motion == PICKUP and stage.agent.carrying is None:
        _pick_up(stage)
    elif motion == DROP and stage.agent.carrying is not None:
        _drop(stage, stage.agent.carrying)
    bring_load(stage)


def step(stage: BuildingState, ahead_m: float, right_m: float) -> bool:
    """Move the agent by metres ahead and to the right, completely or not at all; return whether it moved."""
    agent = stage.agent
    ahead_x, ahead_z = agent.forward
    before = agent.pos
    x = before[0] + ahead_x * ahead_m - ahead_z * right_m
    z = before[2] + ahead_z * ahead_m + ahead_x * right_m
    position = stage.find_place(agent, x, z)
    if position is None:
        return False
    agent.pos = position
    load = agent.carrying
    if load is not None and not stage.load_fits(load, *stage.carrying_position(position, load)):
        agent.pos = before
        return False
    return True


def _pick_up(stage: BuildingState) -> None:
    """Let the agent take the first thing in reach, unless it is static or a wall is in the way."""
    agent = stage.agent
    ahead_x, ahead_z = agent.forward
    reach = _AHEAD_RADII * float(agent.radius)
    x, _, z = agent.pos
    touched = stage.blocker(agent, x + ahead_x * reach, z + ahead_z * reach, _AROUND_RADII * float(agent.radius))
    if isinstance(touched, Entity) and not touched.static:
        agent.carrying = touched


def _drop(stage: BuildingState, load: Entity) -> None:
    """Put what the agent carries on the floor below it; change nothing if there is no floor."""
    height = stage.floor_below(load.pos)
    if height is None or math.isnan(height):
        return
    load.pos = (load.pos[0], height, load.pos[2])
    stage.agent.carrying = None


def bring_load(stage: BuildingState) -> None:
    """Move what the agent carries to its place in front of the agent, with the agent's heading."""
    load = stage.agent.carrying
    if load is not None:
        load.pos = stage.carrying_position(stage.agent.pos, load)
        load.dir = stage.agent.dir
