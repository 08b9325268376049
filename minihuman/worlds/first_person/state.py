"""The hash of a first-person state: equal states, equal hashes, on every machine."""

from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.first_person.building.rooms import Room
from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.stage import Stage
from minihuman.worlds.hashing import hash64


def state_hash(kind: str, state: dict[str, Any]) -> int:
    """Hash the attributes that make up a world's state; ``kind`` is its class's name.

    Things are hashed once, in the order they were placed; elsewhere they count as their place in that order.

    Raises:
        WorldError: if an attribute holds something without a canonical form.
    """
    stage = state["_stage"]
    if not isinstance(stage, Stage):
        raise WorldError(f"{kind} has not been reset; call reset(seed=...) first")
    places = {id(entity): place for place, entity in enumerate(stage.entities)}
    own = {
        name: _plain(value, places, f"{kind}.{name}")
        for name, value in state.items()
        if name not in ("_stage", "_np_random", "_np_random_seed")
    }
    carrying = stage.agent.carrying
    return hash64(
        (
            kind,
            stage.floor.fingerprint,
            _stream(stage.rng),
            [entity.state() for entity in stage.entities],
            None if carrying is None else places.get(id(carrying), -1),
            (stage.sky_colour, stage.light_pos, stage.light_colour, stage.light_ambient),
            own,
        )
    )


def _stream(rng: np.random.Generator) -> tuple[Any, ...]:
    state = rng.bit_generator.state
    inner = state["state"]
    return inner["state"], inner["inc"], state["has_uint32"], state["uinteger"]


def _plain(value: Any, places: dict[int, int], where: str) -> Any:
    match value:
        case Entity():
            place = places.get(id(value))
            return ("gone", value.state()) if place is None else ("placed", place)
        case Room():
            return "room", value.number
        case None | bool() | int() | float() | str() | bytes() | np.ndarray() | np.generic():
            return value
        case dict():
            return {str(key): _plain(inner, places, where) for key, inner in value.items()}
        case tuple() | list():
            return [_plain(inner, places, where) for inner in value]
        case _:
            raise WorldError(
                f"{where} is a {type(value).__name__}; a world keeps numbers, text, entities, arrays, "
                "and tuples, lists and dicts of them"
            )
