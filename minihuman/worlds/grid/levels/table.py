"""The levels of the catalogue by name. Importing this compiles what all levels have in common."""

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
