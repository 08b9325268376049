"""The families of worlds: what a name with its options is, as a recipe."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from minihuman.errors import WorldError
from minihuman.worlds.grid.layouts.rooms import four_rooms as lay_four_rooms
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.grid.recipe import Recipe

Place = tuple[int, int] | None  # column and row; None draws one


def four_rooms(*, agent_pos: Place = None, goal_pos: Place = None) -> Recipe:
    """Four rooms of 9 x 9 and a goal somewhere."""
    numbers = (*(agent_pos or (-1, -1)), *(goal_pos or (-1, -1)))
    return Recipe(lay_four_rooms, numbers, 19, 19, 100, MissionSpace("reach the goal"))


FAMILIES: Mapping[str, Callable[..., Recipe]] = MappingProxyType({"four_rooms": four_rooms})


def recipe(family: str, **options: Any) -> Recipe:
    """The recipe of a family's world.

    Raises:
        WorldError: if there is no such family, or it takes no such option.
    """
    if family not in FAMILIES:
        raise WorldError(f"{family!r} is no family of grid worlds; there are {', '.join(FAMILIES)}")
    try:
        return FAMILIES[family](**options)
    except TypeError as error:
        raise WorldError(f"the grid worlds of family {family!r} do not take these options: {error}") from error
