"""Levels: worlds of rooms with a drawn instruction. A level is a few lines over verbs, traced once into numbers."""

from collections.abc import Mapping
from types import MappingProxyType

from minihuman.worlds.grid.levels import carrying, going, inventing, opening
from minihuman.worlds.grid.levels.level import Level

LEVELS: Mapping[str, Level] = MappingProxyType(
    {
        "level:" + name.strip("_"): each
        for module in (going, opening, carrying, inventing)
        for name, each in vars(module).items()
        if isinstance(each, Level)
    }
)
