"""The worlds of the catalogue in tests.

As parameters, one world for each layout function runs by default and the others in the long list.
"""

from collections.abc import Iterable
from typing import Any

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401  # registers the worlds
from minihuman.worlds.catalogue import WORLDS, CatalogueEntry

IDS = tuple(entry.id for entry in WORLDS)


def layout_function(entry: CatalogueEntry) -> tuple[str, str | None]:
    """Return what lays a world out: its entry point, and the family or the class that this is asked for."""
    return entry.entry_point, entry.kwargs.get("family", entry.kwargs.get("layout"))


def choose_representatives(entries: Iterable[CatalogueEntry]) -> frozenset[str]:
    """Return the ids of the first world of each layout function; the others differ from them in sizes and counts."""
    first: dict[tuple[str, str | None], str] = {}
    for entry in entries:
        first.setdefault(layout_function(entry), entry.id)
    return frozenset(first.values())


REPRESENTATIVES = choose_representatives(WORLDS)


def world_parameters(world_ids: Iterable[str]) -> list[Any]:
    """Return the ids as parameters; by day, those that represent a layout function, and every third of the others."""
    others = [world_id for world_id in world_ids if world_id not in REPRESENTATIVES]
    marks = {world_id: pytest.mark.nightly(sample=number % 3 == 0) for number, world_id in enumerate(others)}
    return [pytest.param(world_id, marks=marks[world_id]) if world_id in marks else world_id for world_id in world_ids]


def start(world_id: str, **options: Any) -> Any:
    """Return a world in its first episode, without Gymnasium's wrappers."""
    env = gymnasium.make(world_id, disable_env_checker=True, **options).unwrapped
    env.reset(seed=1)
    return env


def same_observation(a: Any, b: Any) -> bool:
    """Return whether two observations are equal, whatever they are made of."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same_observation(a[key], b[key]) for key in a)
    if isinstance(a, str | tuple):
        return tuple(a) == tuple(b)
    return np.array_equal(a, b)
