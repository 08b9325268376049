"""Validation of the options that users give to worlds, and of a batch's seeds.

Each value is checked before anything is built from it; the error names the option and its value.
"""

from collections.abc import Collection, Sequence
from operator import index
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError

T = TypeVar("T")

MAX_CELLS = 1024  # on a side of a grid: some seconds to plan in, 12 MB a state
MAX_METRES = 1000.0  # along a side of a room
MAX_PIXELS = 4096  # along a side of an observation or a rendered picture


def whole_number(value: Any) -> int | None:
    """Return a value that is a whole number by its type; return None for a bool, a float and everything else."""
    try:
        if isinstance(value, bool):
            return None
        return index(value)
    except TypeError:
        return None


def check_whole(name: str, value: Any, low: int, high: int, *, odd: bool = False) -> int:
    """Check that a value is a whole number from ``low`` to ``high``, odd if ``odd`` is set, and return it.

    Raises:
        WorldError: if it is not such a number. A float is refused even if it is whole.
    """
    number = whole_number(value)
    if number is None or not low <= number <= high or (odd and number % 2 == 0):
        kind = "an odd number" if odd else "a whole number"
        raise WorldError(f"{name} is {value!r}; it must be {kind} from {low} to {high}")
    return number


def check_number(name: str, value: Any, low: float, high: float) -> float:
    """Check that a value is a number from ``low`` to ``high``, and return it unchanged.

    Raises:
        WorldError: if it is not such a number; a bool is refused.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise WorldError(f"{name} is {value!r}; it must be a number, {low:g} to {high:g}")
    return value


def check_bool(name: str, value: Any) -> bool:
    """Check that a value is true or false, and return it.

    Raises:
        WorldError: if it is anything else.
    """
    if not isinstance(value, bool):
        raise WorldError(f"{name} is {value!r}; it must be true or false")
    return value


def check_one_of(name: str, value: T, known: Collection[T]) -> T:
    """Check that a value is one of the known values, of the same type, and return it.

    Raises:
        WorldError: if it is not one of them.
    """
    if not any(type(value) is type(option) and value == option for option in known):
        raise WorldError(f"{name} is {value!r}; use one of {', '.join(map(repr, known))}")
    return value


def check_cell(name: str, value: Any, width: int, height: int, *, wall: int = 0) -> tuple[int, int]:
    """Check that a value is a column and a row of a grid, at least ``wall`` cells from its edge, and return them.

    Raises:
        WorldError: if it is not such a pair of whole numbers.
    """
    column, row = _check_length(name, value, 2, "a column and a row")
    check_whole(f"{name}[0]", column, wall, width - 1 - wall)
    return column, check_whole(f"{name}[1]", row, wall, height - 1 - wall)


def check_pair(name: str, value: Any, low: int, high: int) -> tuple[int, int]:
    """Check that a value is a sequence of two whole numbers from ``low`` to ``high``, and return them.

    Raises:
        WorldError: if it is not such a sequence.
    """
    first, second = _check_length(name, value, 2, "two whole numbers")
    return check_whole(f"{name}[0]", first, low, high), check_whole(f"{name}[1]", second, low, high)


def check_point(name: str, value: Any) -> tuple[float, float, float]:
    """Check that a value is a position (x, y, z), each at most `MAX_METRES` from 0, and return it.

    Raises:
        WorldError: if it is not such a position.
    """
    x, y, z = _check_length(name, value, 3, "x, y and z in metres")
    low = -MAX_METRES
    high = MAX_METRES
    return (
        check_number(f"{name}[0]", x, low, high),
        check_number(f"{name}[1]", y, low, high),
        check_number(f"{name}[2]", z, low, high),
    )


def _check_length(name: str, value: Any, count: int, description: str) -> Sequence[Any]:
    """Check that a value is a sequence of ``count`` elements, as ``description`` says in the error; return it."""
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != count:
        raise WorldError(f"{name} is {value!r}; it must be {description}")
    return value


BatchSeeds = int | Sequence[int | None] | NDArray[np.integer] | None  # one for all to count from, or one per world


def seeds_per_world(seed: BatchSeeds, count: int) -> list[int | None]:
    """Return one seed per world: ``seed`` + i if it is a number, else the given seeds. None continues a random stream.

    Raises:
        WorldError: if there is not one seed per world, or a seed is not a whole number.
    """
    try:
        if seed is None:
            return [None] * count
        if not isinstance(seed, Sequence | np.ndarray):
            return [index(seed) + i for i in range(count)]
        seeds = [None if world_seed is None else index(world_seed) for world_seed in seed]
    except TypeError as error:
        raise WorldError(f"seed is {seed!r}; give a whole number, or one per world") from error
    if len(seeds) != count:
        raise WorldError(f"{len(seeds)} seeds for {count} worlds; give one per world, or a single number")
    return seeds
