"""Options that people give to worlds: each is checked before anything is made of it, and refused in one line."""

from collections.abc import Collection, Sequence
from operator import index
from typing import Any, TypeVar

from minihuman.errors import WorldError

T = TypeVar("T")

MOST_CELLS = 1024  # on a side of a grid: some seconds to plan in, 12 MB a state
MOST_METRES = 1000.0  # along a side of a room
MOST_PIXELS = 4096  # along a side of an observation or a rendered picture


def whole(name: str, value: Any, low: int, high: int, *, odd: bool = False) -> int:
    """A whole number from ``low`` to ``high``. A float is refused, even where it is whole."""
    try:
        number = None if isinstance(value, bool) else index(value)
    except TypeError:
        number = None
    if number is None or not low <= number <= high or (odd and number % 2 == 0):
        kind = "an odd number" if odd else "a whole number"
        raise WorldError(f"{name} is {value!r}; it is {kind}, {low} to {high}")
    return number


def number(name: str, value: Any, low: float, high: float) -> float:
    """A number from ``low`` to ``high``, as it was given."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise WorldError(f"{name} is {value!r}; it is a number, {low:g} to {high:g}")
    return value


def truth(name: str, value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise WorldError(f"{name} is {value!r}; it is true or false")
    return value


def one_of(name: str, value: T, known: Collection[T]) -> T:
    """One of those that there are."""
    if not any(type(value) is type(each) and value == each for each in known):
        raise WorldError(f"{name} is {value!r}; it is one of {', '.join(map(repr, known))}")
    return value


def cell(name: str, value: Any, width: int, height: int, *, wall: int = 0) -> tuple[int, int]:
    """A column and a row of a grid, ``wall`` cells or more from its edge."""
    column, row = _as_many(name, value, 2, "a column and a row")
    whole(f"{name}[0]", column, wall, width - 1 - wall)
    return column, whole(f"{name}[1]", row, wall, height - 1 - wall)


def pair(name: str, value: Any, low: int, high: int) -> tuple[int, int]:
    """Two whole numbers."""
    first, second = _as_many(name, value, 2, "two whole numbers")
    return whole(f"{name}[0]", first, low, high), whole(f"{name}[1]", second, low, high)


def point(name: str, value: Any) -> tuple[float, float, float]:
    """A place in metres: x, y, z."""
    x, y, z = _as_many(name, value, 3, "x, y and z in metres")
    low, high = -MOST_METRES, MOST_METRES
    return number(f"{name}[0]", x, low, high), number(f"{name}[1]", y, low, high), number(f"{name}[2]", z, low, high)


def _as_many(name: str, value: Any, count: int, what: str) -> Sequence[Any]:
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != count:
        raise WorldError(f"{name} is {value!r}; it is {what}")
    return value
