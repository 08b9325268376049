"""`get_attr`, `call` and `set_attr` of a batch, as SyncVectorEnv offers them, for some attributes of its worlds.

Other attributes are refused, because a batch either has no separate environment for each world, or does not use the
other attributes of those it has.
"""

import abc
from collections.abc import Iterator
from typing import Any, ClassVar

from minihuman.errors import WorldError
from minihuman.worlds.upstream_names import WorldAttributeError


class VectorNames(abc.ABC):
    """Mixin that gives a batch of worlds `get_attr`, `call` and `set_attr`."""

    readable: ClassVar[frozenset[str]]  # attributes that `get_attr` returns
    methods: ClassVar[frozenset[str]]  # methods that `call` calls
    settable: ClassVar[frozenset[str]]  # attributes that `set_attr` sets
    num_envs: int

    @abc.abstractmethod
    def worlds_in_turn(self) -> Iterator[Any]:
        """Yield each world in turn. A change made to it before the next one is requested changes the batch."""

    @abc.abstractmethod
    def save(self) -> Any:
        """Return an exact copy of every world's state, including its random stream. The copy can be pickled."""

    @abc.abstractmethod
    def restore(self, saved: Any) -> None:
        """Restore a saved state. The copy is not consumed and may be restored again."""

    def is_readable(self, name: str) -> bool:
        """Return whether `get_attr` supports an attribute."""
        return name in self.readable

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each world, or call a method of each without arguments and return the results.

        Raises:
            WorldAttributeError: if the batch does not support reading this attribute.
        """
        return self.call(name)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of each world with the same arguments, or return an attribute of each world.

        Raises:
            WorldAttributeError: if the batch does not support this method or attribute.
        """
        if name in self.methods:
            return tuple([getattr(world, name)(*args, **kwargs) for world in self.worlds_in_turn()])
        if not self.is_readable(name):
            raise self._unknown_name(name, self.methods | self.readable)
        return tuple([getattr(world, name) for world in self.worlds_in_turn()])

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every world to one value for all, or to the values of a list or tuple, one per world.

        Raises:
            WorldAttributeError: if the batch does not support setting this attribute.
            WorldError: if there is not one value per world, or a world refuses its value. No world is changed then.
        """
        if name not in self.settable:
            raise self._unknown_name(name, self.settable)
        if isinstance(values, list | tuple):
            per_world = values
        else:
            per_world = [values] * self.num_envs
        if len(per_world) != self.num_envs:
            raise WorldError(f"{len(per_world)} values of {name} for {self.num_envs} worlds; give one per world")
        before = self.save()
        try:
            for world, value in zip(self.worlds_in_turn(), per_world, strict=False):
                setattr(world, name, value)
        except WorldError:
            self.restore(before)
            raise

    def _unknown_name(self, name: str, names: frozenset[str]) -> WorldAttributeError:
        return WorldAttributeError(
            f"a batch does not have {name!r} of each world; use one of {', '.join(sorted(names))}, or make the batch "
            "with vectorization_mode='sync'"
        )
