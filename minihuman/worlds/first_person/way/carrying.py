"""Fetching a thing, carrying it next to another and putting it down: planned, and each part of it tried out."""

import math
from typing import TYPE_CHECKING

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.way.fetching import BACKWARDS, ends, turns_to
from minihuman.worlds.first_person.way.planner import plan

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv


def put_next(world: "FirstPersonEnv", thing: Entity, beside: Entity) -> list[int] | None:
    """Actions after which a thing stands next to another and nothing is carried; None where none were found.

    The world is left as it was. Its step limit counts.
    """
    saved, done = world.save(), list[int]()
    try:
        carried = world.agent.carrying
        if carried is None and world.near(thing, beside):
            return [world.action_names.index("turn_left")]  # a world looks after a step
        if carried is not None and carried is not thing and ends(world, world.action_names.index("drop"), done):
            return None
        found = _bring(world, beside) if carried is thing else _fetch_and_bring(world, thing, beside)
        return None if found is None else done + found
    finally:
        world.restore(saved)


def _fetch_and_bring(world: "FirstPersonEnv", thing: Entity, beside: Entity) -> list[int] | None:
    """Take a thing from where it can be carried away, keeping off more and more of the things that stand near it."""
    saved = world.save()
    near = [each for each in world.entities if each not in (thing, world.agent)]
    near.sort(key=lambda each: math.dist(each.pos, thing.pos))
    for kept_off in range(len(near) + 1):
        found = _fetch(world, thing, beside, near[:kept_off])
        if found is not None:
            return found
        world.restore(saved)
    return None


def _fetch(world: "FirstPersonEnv", thing: Entity, beside: Entity, avoid: list[Entity]) -> list[int] | None:
    """Take it from near it, or from farther off: it then floats ahead of where it stood, perhaps into a wall."""
    back, pickup = world.action_names.index("move_back"), world.action_names.index("pickup")
    done: list[int] = []
    for action in plan(world, thing, avoid=avoid) or ():
        if ends(world, action, done):
            return None
    for _ in range(BACKWARDS):
        for action in turns_to(world, thing):
            if ends(world, action, done):
                return None
        before = world.save()
        if not ends(world, pickup, []) and world.agent.carrying is thing:
            brought = _bring(world, beside)
            if brought is not None:
                return [*done, pickup, *brought]
        world.restore(before)
        if ends(world, back, done):
            return None
    return None


def _bring(world: "FirstPersonEnv", beside: Entity) -> list[int] | None:
    """Carry what is in hand next to a thing, and put it down."""
    carried, done = world.agent.carrying, list[int]()
    assert carried is not None
    for action in plan(world, beside) or ():
        if ends(world, action, done):
            return None
    ends(world, world.action_names.index("drop"), done)
    return done if world.near(carried, beside) else None
