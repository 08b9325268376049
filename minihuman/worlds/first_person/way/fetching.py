"""Going to things one after the other and taking them: each leg planned, its last steps tried out."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.way.planner import plan

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv

BACKWARDS = 8  # steps back from a thing in which it is tried to take it: beside a wall it is taken from farther off


def take_all(world: "FirstPersonEnv", left: Callable[[], list[Entity]]) -> list[int] | None:
    """Actions that take everything that is ``left``, the nearest first; None where none were found.

    The world is left as it was. Its step limit counts.
    """
    saved, actions = world.save(), []
    try:
        while things := left():
            x, _, z = world.agent.pos
            nearest = min(things, key=lambda thing: math.hypot(thing.pos[0] - x, thing.pos[2] - z))
            leg = _take(world, nearest, len(things), left)
            if leg is None:
                return None
            actions += leg
        return actions
    finally:
        world.restore(saved)


def _take(world: "FirstPersonEnv", thing: Entity, count: int, left: Callable[[], list[Entity]]) -> list[int] | None:
    """Go near a thing, face it and take it, or another that is in the way."""
    back, pickup = world.action_names.index("move_back"), world.action_names.index("pickup")
    done: list[int] = []
    for action in plan(world, thing) or ():
        if ends(world, action, done):
            return None
    for _ in range(BACKWARDS):
        for action in turns_to(world, thing):
            if ends(world, action, done):
                return None
        before = world.save()
        ended = ends(world, pickup, done)
        if len(left()) < count:
            return done
        if ended:
            return None
        world.restore(before)
        done.pop()
        if ends(world, back, done):
            return None
    return None


def ends(world: "FirstPersonEnv", action: int, done: list[int]) -> bool:
    """Do it, and say whether the episode is over."""
    _, terminated, truncated = world.advance(action)
    done.append(action)
    return terminated or truncated


def turns_to(world: "FirstPersonEnv", thing: Entity) -> list[int]:
    """The turns after which the agent faces a thing as nearly as it can."""
    turn_rad = math.radians(world.stage.parameters.number("turn_step", None))
    x, _, z = world.agent.pos
    wanted_rad = math.atan2(z - thing.pos[2], thing.pos[0] - x)
    off_rad = (wanted_rad - world.agent.dir + math.pi) % (2 * math.pi) - math.pi
    name = "turn_left" if off_rad > 0 else "turn_right"
    return [world.action_names.index(name)] * round(abs(off_rad) / turn_rad)
