"""Attributes that Minigrid's and Miniworld's worlds have, and how our worlds support them.

An attribute either can be read, set or called as upstream, or raises an error that names what to use instead. Setting
an unknown attribute of a world of the catalogue is refused, because it would change nothing; a user's own world class
may set any attribute.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from minihuman.errors import WorldError
from minihuman.worlds.contract import ReadOnlyName

_CATALOGUE = "minihuman.worlds."


class WorldAttributeError(WorldError, AttributeError):
    """A world has no such attribute, or the attribute cannot be set. The message names what to use instead."""


def is_catalogue_class(kind: type) -> bool:
    """Return whether a class is one of our own, whose attributes are known, and not a subclass defined elsewhere."""
    return kind.__module__.startswith(_CATALOGUE)


class _UpstreamName(ReadOnlyName):
    """An attribute of upstream's worlds, read from the current state.

    Setting it changes the state if there is a function ``write``. Otherwise it raises an error that ends in ``advice``.

    A user's own world may define the attribute itself, in its class or on an instance.
    """

    def __init__(
        self,
        read: Callable[[Any], Any],
        write: Callable[[Any, Any], None] | None = None,
        advice: str = "it is computed from the state",
    ) -> None:
        super().__init__(read)
        self._write = write
        self._advice = advice
        self._name = read.__name__

    def setter(self, write: Callable[[Any, Any], None]) -> "_UpstreamName":
        """Return the same attribute with a function that sets it, as `property` does."""
        return _UpstreamName(self._read, write)

    def __get__(self, world: Any, owner: Any = None) -> Any:
        if world is None:
            return self
        if world._is_made:  # tested before `vars`, which slows later reads of every attribute of the world
            return self._read(world)
        attributes = vars(world)
        if self._name in attributes:
            return attributes[self._name]
        return self._read(world)

    def __set__(self, world: Any, value: Any) -> None:
        if not is_catalogue_class(type(world)):
            vars(world)[self._name] = value
        elif self._write is None:
            raise WorldAttributeError(f"{self._name} of {world} cannot be set; {self._advice}")
        else:
            self._write(world, value)

    def __delete__(self, world: Any) -> None:
        if vars(world).pop(self._name, None) is None:
            raise WorldAttributeError(f"{self._name} of {world} cannot be deleted; it is read from the state")


if TYPE_CHECKING:
    UpstreamName = property  # type checkers treat it as one
else:
    UpstreamName = _UpstreamName


def set_instead(advice: str) -> Callable[[Callable[[Any], Any]], Any]:
    """Return a decorator for a read-only attribute. The advice says what to use instead of setting it."""
    return lambda read: _UpstreamName(read, advice=advice)


class _ReadName:
    """An attribute that a function reads or refuses with an error. `__getattr__` would slow down all others."""

    def __init__(self, name: str, read: Callable[[Any, str], Any]) -> None:
        self._name = name
        self._read = read

    def __get__(self, world: Any, owner: Any = None) -> Any:
        if world is None:
            return self
        if getattr(world, "_is_made", False):
            return self._read(world, self._name)
        attributes = vars(world)
        if self._name in attributes:
            return attributes[self._name]
        return self._read(world, self._name)

    def __set__(self, world: Any, value: Any) -> None:
        if getattr(world, "_is_made", False):
            raise WorldAttributeError(
                f"{world} has no attribute {self._name!r} to set, so setting it would do nothing; it is read from the "
                "state, or belongs to a subclass or a wrapper"
            )
        vars(world)[self._name] = value

    def __delete__(self, world: Any) -> None:
        if self._name not in vars(world):
            raise WorldAttributeError(f"{self._name} of {world} cannot be deleted")
        del vars(world)[self._name]


def define_names(
    kind: type, names: Iterable[str], read: Callable[[Any, str], Any], *, over: Iterable[str] = ()
) -> None:
    """Define attributes of a class whose values, or errors, a function provides.

    Args:
        kind: the class.
        names: the names of the attributes; a name that the class has already is left alone.
        read: a function that takes the world and the name, and returns the value or raises an error.
        over: the names to define even if the class has them already.
    """
    replaced = frozenset(over)
    for name in names:
        if name in replaced or not hasattr(kind, name):
            setattr(kind, name, _ReadName(name, read))


def refuse_unknown_attribute(world: Any, name: str, instead: Mapping[str, str]) -> None:
    """Refuse to set an attribute that a world of the catalogue does not have.

    Raises:
        WorldAttributeError: if the world does not have the attribute, or it is read-only; the message says what to use
            instead of an attribute of upstream's.
    """
    attribute = getattr(type(world), name, None)
    if isinstance(attribute, property) and attribute.fset is None:
        raise WorldAttributeError(f"{name} of {world} cannot be set; it is read from the state")
    if hasattr(type(world), name) or not is_catalogue_class(type(world)) or hasattr(world, name):
        return
    advice = instead.get(name, "attributes of your own belong to a subclass or a wrapper")
    raise WorldAttributeError(f"{world} has no attribute {name!r} to set, so setting it would do nothing; {advice}")


def refuse_replaced_method(world: Any, name: str, methods: Mapping[str, Any]) -> None:
    """Refuse to replace a method of an upstream world by another function, because our steps would not call it.

    Raises:
        WorldAttributeError: if the name is one of these methods.
    """
    if name in methods and callable(methods[name]) and is_catalogue_class(type(world)):
        raise WorldAttributeError(
            f"{name}() of {world} cannot be replaced, as its steps do not call it; override it in a wrapper"
        )


def missing_name(world: Any, name: str, instead: Mapping[str, str]) -> WorldAttributeError:
    """Return the error for an attribute that a world does not have, with the advice of ``instead`` on this name."""
    advice = f"; {instead[name]}" if name in instead else ""
    return WorldAttributeError(f"{type(world).__name__!r} object has no attribute {name!r}{advice}")
