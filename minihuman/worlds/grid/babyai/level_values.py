"""The values that a level's function handles while it is traced: random variables, references to objects, choices."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from minihuman.worlds.grid.babyai.language import Clause, ObjectDescription
from minihuman.worlds.grid.babyai.level_program import COLOUR_IN, KIND_IN


@dataclass(frozen=True, slots=True)
class RandomVariable:
    """A number that is drawn anew in every episode. It can be an argument of later calls.

    Attributes:
        argument: the number that stands for it among the arguments of an operation in the program.
    """

    argument: int


@dataclass(frozen=True, slots=True)
class ObjectRef:
    """An object that is made in every episode. Its kind and colour are known only then.

    Attributes:
        register: the index of the register of the program that holds the object's identity.
    """

    register: int

    @property
    def kind(self) -> Any:
        """Return the object's kind as a random variable."""
        return RandomVariable(KIND_IN + self.register)

    @property
    def colour(self) -> Any:
        """Return the object's colour as a random variable."""
        return RandomVariable(COLOUR_IN + self.register)

    @property
    def thing(self) -> ObjectDescription:
        """Return the description of the object by its kind and colour."""
        return ObjectDescription(self.kind, self.colour)


@dataclass(frozen=True, slots=True)
class ObjectGroup:
    """A group of objects that are made one after the other: the ``first``, the ``last`` and all between them."""

    first: ObjectRef
    last: ObjectRef

    def __add__(self, doors: Sequence[ObjectRef]) -> "ObjectGroup":
        """Return the group extended by objects that were made right after it."""
        return ObjectGroup(self.first, doors[-1])


@dataclass(frozen=True, slots=True)
class Use(Clause):
    """The clause to open an object if it is a door, and to pick it up otherwise."""


@dataclass(frozen=True, slots=True)
class AnyOf:
    """One of several instructions, which is drawn in every episode.

    Attributes:
        selected: the variable with the index of the alternative that is drawn.
        alternatives: the instructions, or functions that return them.
    """

    selected: RandomVariable
    alternatives: tuple[Any, ...]
