"""Exact copies of a first-person world's state, also in the middle of an episode."""

import copy
from typing import Any, NamedTuple

import numpy as np

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.parameters import Parameters
from minihuman.worlds.first_person.rooms import FloorPlan, Room
from minihuman.worlds.first_person.state import WorldState

_UNCHANGING = frozenset(
    {int, float, bool, str, bytes, type(None), np.float32, np.float64, np.int64, np.bool_, FloorPlan, Room, Parameters}
)


class _Held(NamedTuple):
    """The attributes of an entity, the state or the world: those that can be shared, and those that must be copied."""

    plain: dict[str, Any]
    copied: dict[str, Any]


class FirstPersonSnapshot(NamedTuple):
    """A copy of the state of one world; only ``save`` makes one and only ``restore`` reads it."""

    world: str
    over: bool
    stage: WorldState  # the original, by which `restore` recognises its world; its saved attributes are on the shelf
    own: _Held  # the world's attributes
    shelf: tuple[tuple[Any, _Held], ...]  # the stage and each entity, with their saved attributes
    streams: tuple[tuple[np.random.Generator, Any], ...]  # each with its saved state


def save_state(world: str, over: bool, state: dict[str, Any]) -> FirstPersonSnapshot:
    """Return a snapshot of a world of the class named ``world``, whose attributes are ``state``."""
    shelf: dict[int, tuple[Any, _Held]] = {}
    streams: dict[int, tuple[np.random.Generator, Any]] = {}

    def split_attributes(attributes: dict[str, Any], into: _Held) -> _Held:
        """Add attributes to ``into``: those that can be shared, and copies of the others."""
        plain, copied = into
        for name, value in attributes.items():
            kind = type(value)
            if kind in _UNCHANGING or (kind is tuple and _UNCHANGING.issuperset(map(type, value))):
                plain[name] = value
            else:
                copied[name] = copy_inner(value)
        return into

    def copy_inner(value: Any) -> Any:
        """Return a copy of a value; save the state of entities and random streams, and return these as they are."""
        kind = type(value)
        if kind in _UNCHANGING:
            return value
        if kind is tuple or kind is list:
            return kind(map(copy_inner, value))
        if isinstance(value, Entity | WorldState):
            if id(value) not in shelf:
                saved_attributes = _Held({}, {})
                shelf[id(value)] = value, saved_attributes  # before its attributes, which may lead back to it
                split_attributes(vars(value), saved_attributes)
            return value
        if isinstance(value, np.random.Generator):
            if id(value) not in streams:
                streams[id(value)] = value, value.bit_generator.state
            return value
        if kind is dict:
            return {name: copy_inner(inner) for name, inner in value.items()}
        return copy.deepcopy(value)

    attributes = split_attributes(state, _Held({}, {}))
    return FirstPersonSnapshot(world, over, state["_stage"], attributes, tuple(shelf.values()), tuple(streams.values()))


def restore_state(saved: FirstPersonSnapshot, *, in_place: bool) -> dict[str, Any]:
    """Return the attributes of a saved state, for setting them on a world; the state can be restored again.

    If ``in_place``, the original entities get their saved attributes back; otherwise, equal entities are made.
    """
    instead: dict[int, Any] = {}
    if not in_place:
        instead = {id(thing): object.__new__(type(thing)) for thing, _ in saved.shelf}
        instead |= {id(stream): np.random.Generator(type(stream.bit_generator)()) for stream, _ in saved.streams}

    def restore_inner(value: Any) -> Any:
        """Return a copy of a saved value, with restored entities and random streams in place of the saved ones."""
        kind = type(value)
        if kind in _UNCHANGING:
            return value
        if kind is tuple or kind is list:
            return kind(map(restore_inner, value))
        if isinstance(value, Entity | WorldState | np.random.Generator):
            return instead.get(id(value), value)
        if kind is dict:
            return {name: restore_inner(inner) for name, inner in value.items()}
        return copy.deepcopy(value)

    def restore_attributes(saved_attributes: _Held) -> dict[str, Any]:
        return saved_attributes.plain | {name: restore_inner(value) for name, value in saved_attributes.copied.items()}

    for stream, state in saved.streams:
        instead.get(id(stream), stream).bit_generator.state = state
    for thing, saved_attributes in saved.shelf:
        attributes = vars(instead.get(id(thing), thing))
        attributes.clear()
        attributes.update(restore_attributes(saved_attributes))
    return restore_attributes(saved.own)
