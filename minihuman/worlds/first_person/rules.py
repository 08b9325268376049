"""What the eight actions do to a state: Miniworld's rules exactly, whole moves that happen or do not."""

import math

from minihuman.worlds.first_person.entities import Entity, Position
from minihuman.worlds.first_person.state import WorldState

ACTIONS = ("turn_left", "turn_right", "move_forward", "move_back", "pickup", "drop", "toggle", "done")
MOVES = ACTIONS[:3]

_RADIANS = math.pi / 180


def act(stage: WorldState, action: str) -> None:
    """Do one action; step length, drift and turn are drawn first, whatever the action."""
    ahead = stage.parameters.number("forward_step", stage.varying)
    drift = stage.parameters.number("forward_drift", stage.varying)
    turn = stage.parameters.number("turn_step", stage.varying)
    match action:
        case "move_forward":
            _move(stage, ahead, drift)
        case "move_back":
            _move(stage, -ahead, drift)
        case "turn_left":
            _turn(stage, turn * _RADIANS)
        case "turn_right":
            _turn(stage, -turn * _RADIANS)
        case "pickup":
            _pick_up(stage)
        case "drop":
            _drop(stage)
    carried = stage.agent.carrying
    if carried is not None:
        carried.pos = carrying_position(stage, stage.agent.pos, carried)
        carried.dir = stage.agent.dir


def carrying_position(stage: WorldState, pos: Position, carried: Entity) -> Position:
    """Where a carried thing floats when the agent stands at ``pos``: in front, below the middle of the picture."""
    agent = stage.agent
    distance = float(agent.radius + carried.radius + stage.reach)
    ahead_x, ahead_z = agent.forward
    rise = max(agent.cam_height - carried.height - 0.3, 0.0)
    return pos[0] + ahead_x * 1.05 * distance, pos[1] + rise, pos[2] + ahead_z * 1.05 * distance


def _move(stage: WorldState, ahead: float, drift: float) -> None:
    agent = stage.agent
    x, y, z = agent.pos
    ahead_x, ahead_z = agent.forward
    there = x + ahead_x * ahead - ahead_z * drift, y, z + ahead_z * ahead + ahead_x * drift
    if stage.blocker(agent, there[0], there[2], agent.radius) is not None:
        return
    carried = agent.carrying
    if carried is not None:
        carried_there = carrying_position(stage, there, carried)
        if stage.blocker(carried, carried_there[0], carried_there[2], carried.radius) is not None:
            return
        carried.pos = carried_there
    agent.pos = there


def _turn(stage: WorldState, angle: float) -> None:
    agent = stage.agent
    before = agent.dir
    agent.dir += angle
    carried = agent.carrying
    if carried is None:
        return
    x, y, z = carrying_position(stage, agent.pos, carried)
    if stage.blocker(carried, x, z, carried.radius) is not None:
        agent.dir = before
        return
    carried.pos = x, y, z
    carried.dir = agent.dir


def _pick_up(stage: WorldState) -> None:
    agent = stage.agent
    if agent.carrying is not None:
        return
    ahead_x, ahead_z = agent.forward
    x, _, z = agent.pos
    radius = float(agent.radius)
    x, z = x + ahead_x * 1.5 * radius, z + ahead_z * 1.5 * radius
    found = stage.blocker(agent, x, z, 1.2 * radius)
    if isinstance(found, Entity) and not found.static:
        agent.carrying = found


def _drop(stage: WorldState) -> None:
    carried = stage.agent.carrying
    if carried is not None:
        carried.pos = carried.pos[0], 0.0, carried.pos[2]
        stage.agent.carrying = None
