"""What a level's function passes around while it is traced: random variables, references to objects, choices."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from minihuman.worlds.grid.babyai.language import Clause, ObjectDescription
from minihuman.worlds.grid.babyai.level_program import COLOUR_IN, KIND_IN


@dataclass(frozen=True, slots=True)
class RandomVariable:
    """A number that is drawn in every episode anew: an argument of later verbs."""

    argument: int


@dataclass(frozen=True, slots=True)
class ObjectRef:
    """An object that is made in every episode; its kind and colour are known then."""

    register: int

    @property
    def kind(self) -> Any:
        """Return its kind."""
        return RandomVariable(KIND_IN + self.register)

    @property
    def colour(self) -> Any:
        """Return its colour."""
        return RandomVariable(COLOUR_IN + self.register)

    @property
    def thing(self) -> ObjectDescription:
        """Return the description by kind and colour."""
        return ObjectDescription(self.kind, self.colour)


@dataclass(frozen=True, slots=True)
class ObjectGroup:
    """Objects made one after the other."""

    first: ObjectRef
    last: ObjectRef

    def __add__(self, doors: Sequence[ObjectRef]) -> "ObjectGroup":
        """Return a group with what was made right after."""
        return ObjectGroup(self.first, doors[-1])


@dataclass(frozen=True, slots=True)
class Use(Clause):
    """Open it if it is a door, pick it up otherwise."""


@dataclass(frozen=True, slots=True)
class AnyOf:
    """An instruction of several, drawn."""

    selected: RandomVariable
    alternatives: tuple[Any, ...]
