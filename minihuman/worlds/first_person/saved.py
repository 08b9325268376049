"""An exact copy of a first-person world in mid-episode, made and put back in a few microseconds.

Only what can change is copied: the attributes of the stage, of each thing on it and of the world itself, and where the
random stream is. Put back into the world it came from, the things stay the things they are; elsewhere they are made
anew.
"""

import copy
from typing import Any, NamedTuple

import numpy as np

from minihuman.worlds.first_person.building.floor import FloorPlan
from minihuman.worlds.first_person.building.rooms import Room
from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.parameters import Parameters
from minihuman.worlds.first_person.stage import Stage

_UNCHANGING = frozenset(
    {int, float, bool, str, bytes, type(None), np.float32, np.float64, np.int64, np.bool_, FloorPlan, Room, Parameters}
)


class _Held(NamedTuple):
    """What a thing, the stage or the world held: what can be given back as it is, and what has to be copied."""

    plain: dict[str, Any]
    rest: dict[str, Any]


class Saved(NamedTuple):
    """A state of one world in mid-episode; made by ``save`` and read by ``restore`` only."""

    world: str
    over: bool
    stage: Stage  # the one it was saved from, to be known again: what it held then is on the shelf
    own: _Held
    shelf: tuple[tuple[Any, _Held], ...]  # the stage and each thing
    streams: tuple[tuple[np.random.Generator, Any], ...]


def take(world: str, over: bool, state: dict[str, Any]) -> Saved:
    """Copy a world's state, the attributes that make it up."""
    shelf: dict[int, tuple[Any, _Held]] = {}
    streams: dict[int, tuple[np.random.Generator, Any]] = {}

    def held(attributes: dict[str, Any], into: _Held) -> _Held:
        plain, rest = into
        for name, value in attributes.items():
            kind = type(value)
            if kind in _UNCHANGING or (kind is tuple and _UNCHANGING.issuperset(map(type, value))):
                plain[name] = value
            else:
                rest[name] = taken(value)
        return into

    def taken(value: Any) -> Any:
        kind = type(value)
        if kind in _UNCHANGING:
            return value
        if kind is tuple or kind is list:
            return kind(map(taken, value))
        if isinstance(value, Entity | Stage):
            if id(value) not in shelf:
                shelf[id(value)] = value, (empty := _Held({}, {}))  # first, as what it holds may lead back to it
                held(vars(value), empty)
            return value
        if isinstance(value, np.random.Generator):
            if id(value) not in streams:
                streams[id(value)] = value, value.bit_generator.state
            return value
        return {name: taken(each) for name, each in value.items()} if kind is dict else copy.deepcopy(value)

    own = held(state, _Held({}, {}))
    return Saved(world, over, state["_stage"], own, tuple(shelf.values()), tuple(streams.values()))


def put_back(saved: Saved, *, here: bool) -> dict[str, Any]:
    """The attributes of a saved state, to be given to a world; the copy is not consumed.

    With ``here``, the things that were there get back what they held; otherwise things like them are made.
    """
    instead: dict[int, Any] = {}
    if not here:
        instead = {id(thing): object.__new__(type(thing)) for thing, _ in saved.shelf}
        instead |= {id(each): np.random.Generator(type(each.bit_generator)()) for each, _ in saved.streams}

    def given(value: Any) -> Any:
        kind = type(value)
        if kind in _UNCHANGING:
            return value
        if kind is tuple or kind is list:
            return kind(map(given, value))
        if isinstance(value, Entity | Stage | np.random.Generator):
            return instead.get(id(value), value)
        return {name: given(each) for name, each in value.items()} if kind is dict else copy.deepcopy(value)

    def give(held: _Held) -> dict[str, Any]:
        return held.plain | {name: given(value) for name, value in held.rest.items()}

    for stream, state in saved.streams:
        instead.get(id(stream), stream).bit_generator.state = state
    for thing, held in saved.shelf:
        attributes = vars(instead.get(id(thing), thing))
        attributes.clear()
        attributes.update(give(held))
    return give(saved.own)
