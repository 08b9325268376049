"""Copies of a running session, in which an input can be tried out.

A copy shares the world of the original and must not reset or step it; it can be lent a world of its own.
"""

from collections.abc import Callable
from typing import Any

from minihuman.activities.questions.question import AnswerDraft
from minihuman.errors import WorldError
from minihuman.experiment.machine.activity import Activity, SessionContext
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.words import InterfaceWords
from minihuman.worlds.adapters.world import World

WorldLender = Callable[[str, dict[str, Any]], World | None]
_COPIED_PACKAGES = ("minihuman.experiment.", "minihuman.activities.")


def can_copy_session(session: SessionMachine) -> bool:
    """Return whether a session is in a part whose state can be copied in full."""
    return type(session) is SessionMachine and session.part.can_copy


def copy_session(session: SessionMachine, lend: WorldLender) -> SessionMachine:
    """Return a copy of a session to which inputs can be fed, and which is then discarded.

    Do not close the copy, because its world belongs to the original.

    Args:
        session: the session to copy.
        lend: returns a world, free to be reset, for an id and options; None if there is none, which ends the copy.
    """
    copied: SessionMachine = _Copier(lend).copy(session)
    return copied


class _LentContext(SessionContext):
    """A session context whose worlds are lent."""

    _lend: WorldLender

    def world(self, world_id: str, options: dict[str, Any]) -> World:
        """Open and return the lent world.

        Raises:
            WorldError: if no world is lent.
        """
        lent = self._lend(world_id, options)
        if lent is None:
            raise WorldError(f"the copied session has no world {world_id} to replay in")
        self._world = ((world_id, options), lent)  # the copy's open world from now on
        return lent

    def close(self) -> None:
        """Do nothing, because the world belongs to the original session."""


class _Copier:
    """Copies objects of the session machine, each once, and gives the copy of the context lent worlds."""

    def __init__(self, lend: WorldLender) -> None:
        self._lend = lend
        self._copies: dict[int, Any] = {}  # by the identity of the original

    def copy(self, value: Any) -> Any:
        """Return a copy of an object that changes while a session runs; return any other object itself."""
        kind = type(value)
        if id(value) in self._copies:
            return self._copies[id(value)]
        if kind is list or kind is set:
            return self._copies.setdefault(id(value), kind(map(self.copy, value)))
        if kind is dict:
            return self._copies.setdefault(id(value), {name: self.copy(element) for name, element in value.items()})
        if kind is tuple:
            return tuple(map(self.copy, value))
        if _is_mutable(value):
            return self._copy_attributes(value)
        return value

    def _copy_attributes(self, value: Any) -> Any:
        """Return a copy of an object of the session machine, with copies of its attributes."""
        kind = _LentContext if type(value) is SessionContext else type(value)
        duplicate = object.__new__(kind)
        self._copies[id(value)] = duplicate  # before its attributes, which may refer to it
        duplicate.__dict__.update((name, self.copy(attribute)) for name, attribute in vars(value).items())
        if isinstance(duplicate, _LentContext):
            duplicate._lend = self._lend
        return duplicate


def _is_mutable(value: Any) -> bool:
    """Return whether an object belongs to the session machine and changes while a session runs."""
    kind = type(value)
    frozen = getattr(kind, "__dataclass_params__", None)
    if isinstance(value, Activity | AnswerDraft):  # including a plug-in's classes
        return True
    if not kind.__module__.startswith(_COPIED_PACKAGES) or (frozen is not None and frozen.frozen):
        return False
    has_state = hasattr(value, "__dict__") and not hasattr(kind, "__members__")
    return has_state and not isinstance(value, type | InterfaceWords)
