"""Fields that a user's own grid world declares: numbers that change during an episode, in addition to the grid.

    class Patrol(GridWorld):
        coins = Int()
        guards = IntArray(3)

At the beginning of an episode, all fields are 0. They are saved, restored and hashed with the world. The fields of a
world share one vector of int64, which compiled rules read and write directly; it contains the bits of a `Float`.
"""

import math
from collections.abc import Sequence
from operator import index
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError

OwnNumbers = NDArray[np.int64]


class OwnField:
    """A declared field, which reads and writes its part of the world's vector.

    Args:
        shape: the lengths of the field's array; none for a single number.
    """

    dtype: ClassVar[type[np.generic]] = np.int64

    def __init__(self, *shape: int) -> None:
        self.name = ""
        self.shape = shape
        self.size = math.prod(shape)  # the number of elements of the vector that the field occupies
        self.offset = -1

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, world: Any, owner: type | None = None) -> Any:
        if world is None:
            return self
        return self.read(own_numbers(world))

    def __set__(self, world: Any, content: Any) -> None:
        self.write(own_numbers(world), content)

    def read(self, numbers: OwnNumbers) -> Any:
        """Return the field's content in a world's vector, as a Python number, a tuple or an array."""
        raise NotImplementedError

    def write(self, numbers: OwnNumbers, content: Any) -> None:
        """Write a new content into the field's part of a world's vector."""
        raise NotImplementedError

    def places(self, numbers: OwnNumbers) -> NDArray[Any]:
        """Return the field's part of a world's vector as a view with the field's dtype."""
        return numbers[self.offset : self.offset + self.size].view(self.dtype)

    def observe(self, numbers: OwnNumbers) -> Any:
        """Return a copy of the field's content, as its `observed_space` contains it."""
        if self.shape:
            return self.places(numbers).reshape(self.shape).copy()
        return numbers[self.offset, ...].view(self.dtype).copy()


class Int(OwnField):
    """A whole number, from -2**63 to 2**63 - 1."""

    def read(self, numbers: OwnNumbers) -> int:
        """Return the number."""
        return int(numbers[self.offset])

    def write(self, numbers: OwnNumbers, content: Any) -> None:
        """Set the number.

        Raises:
            TypeError: if it is not a whole number.
            OverflowError: if it does not fit into 64 bits.
        """
        numbers[self.offset] = index(content)


class Bool(OwnField):
    """True or False."""

    def read(self, numbers: OwnNumbers) -> bool:
        """Return whether the field is True."""
        return bool(numbers[self.offset])

    def write(self, numbers: OwnNumbers, content: Any) -> None:
        """Set the field to True or False."""
        numbers[self.offset] = bool(content)

    def observe(self, numbers: OwnNumbers) -> np.int64:
        """Return 0 or 1."""
        observed: np.int64 = numbers[self.offset]
        return observed


class Float(OwnField):
    """A floating-point number of 64 bits."""

    dtype = np.float64

    def read(self, numbers: OwnNumbers) -> float:
        """Return the number."""
        return float(self.places(numbers)[0])

    def write(self, numbers: OwnNumbers, content: Any) -> None:
        """Set the number."""
        self.places(numbers)[0] = content


class IntTuple(OwnField):
    """A tuple of a fixed number of whole numbers, such as a place, which is read and set as a whole.

    Args:
        length: the number of elements.
    """

    def __init__(self, length: int) -> None:
        super().__init__(_check_length("IntTuple", length))

    def read(self, numbers: OwnNumbers) -> tuple[int, ...]:
        """Return the numbers."""
        return tuple(numbers[self.offset : self.offset + self.size].tolist())

    def write(self, numbers: OwnNumbers, content: Any) -> None:
        """Set all numbers; raise ValueError if their count differs from the tuple's length."""
        values = tuple(content)
        if len(values) != self.size:
            raise ValueError(f"{self.name} takes {self.size} numbers, not {len(values)}")
        numbers[self.offset : self.offset + self.size] = [index(number) for number in values]


class _Array(OwnField):
    """An array whose shape never changes.

    Args:
        shape: the array's length, or its two lengths.
    """

    def __init__(self, *shape: int) -> None:
        if not 1 <= len(shape) <= 2:
            raise WorldError(f"{type(self).__name__} has {len(shape)} lengths; give one or two")
        super().__init__(*(_check_length(type(self).__name__, length) for length in shape))

    def read(self, numbers: OwnNumbers) -> NDArray[Any]:
        """Return the array as a view: writing to it changes the field."""
        return self.places(numbers).reshape(self.shape)

    def write(self, numbers: OwnNumbers, content: Any) -> None:
        """Set all elements to those of an array of the same shape, or to one number."""
        self.read(numbers)[...] = content


class IntArray(_Array):
    """An array of whole numbers, int64, with one or two lengths: ``IntArray(3)``, ``IntArray(3, 2)``."""


class FloatArray(_Array):
    """An array of floating-point numbers, float64, with one or two lengths."""

    dtype = np.float64


MOST_NUMBERS = 65_536  # in the vector of a world


def _check_length(name: str, length: Any) -> int:
    if not isinstance(length, int) or not 1 <= length <= MOST_NUMBERS:
        raise WorldError(f"a length of {name} is {length!r}; use a whole number from 1 to {MOST_NUMBERS}")
    return length


def declare_fields(world_class: Any) -> None:
    """Assign places in the vector to the fields of a class, and have the class save the fields with its state.

    Raises:
        WorldError: if two base classes declare different fields, a field is declared again, or there are too many
            numbers.
    """
    bases = [base for base in world_class.__bases__ if getattr(base, "own_fields", ())]
    if len({base.own_fields for base in bases}) > 1:
        base_names = " and ".join(base.__name__ for base in bases)
        raise WorldError(f"{world_class.__name__} inherits fields from {base_names}; inherit them from one class")
    inherited: Sequence[OwnField] = bases[0].own_fields if bases else ()
    inherited_names = {field.name for field in inherited}
    fields = [*inherited]
    for name, field in vars(world_class).items():
        if isinstance(field, OwnField):
            if name in inherited_names:
                raise WorldError(f"{world_class.__name__}.{name} is declared in a base class already; rename it")
            field.offset = sum(previous.size for previous in fields)
            fields.append(field)
    if sum(field.size for field in fields) > MOST_NUMBERS:
        raise WorldError(f"the fields of {world_class.__name__} have over {MOST_NUMBERS} numbers; declare smaller ones")
    world_class.own_fields = tuple(fields)
    added = [field.name for field in fields if field.name not in world_class.kept]
    world_class.kept = (*world_class.kept, *added)


def numbers_length(world_class: Any) -> int:
    """Return the length of the vector that holds all fields of a class."""
    return sum(field.size for field in world_class.own_fields)


def own_numbers(world: Any) -> OwnNumbers:
    """Return the vector of a world's fields, int64, not a copy; all numbers are 0 before the first episode."""
    numbers: OwnNumbers | None = vars(world).get("_own_numbers")
    if numbers is None:
        numbers = np.zeros(numbers_length(type(world)), np.int64)
        vars(world)["_own_numbers"] = numbers
    return numbers


def field_named(world_class: Any, name: str) -> OwnField:
    """Return the field with the name ``name`` that a class declares.

    Raises:
        WorldError: if the class declares no such field.
    """
    for field in world_class.own_fields:
        if field.name == name:
            declared: OwnField = field
            return declared
    names = ", ".join(field.name for field in world_class.own_fields) or "none"
    raise WorldError(f"{world_class.__name__}.observed has {name!r}; its declared fields are: {names}")


def observed_space(world: Any, name: str) -> spaces.Space[Any]:
    """Return the observation space of a declared field: Discrete(2) for a Bool, or a Box of its shape and dtype."""
    field = field_named(type(world), name)
    if isinstance(field, Bool):
        return spaces.Discrete(2)
    if field.dtype is np.float64:
        return spaces.Box(-np.inf, np.inf, field.shape, np.float64)
    limits = np.iinfo(np.int64)
    return spaces.Box(limits.min, limits.max, field.shape, np.int64)


def observe_fields(world: Any, observation: dict[str, Any]) -> None:
    """Add the observations of a world's `observed` fields to an observation of the world."""
    if world.observed:
        numbers = own_numbers(world)
        for name in world.observed:
            observation[name] = getattr(type(world), name).observe(numbers)
