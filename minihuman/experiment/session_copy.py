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
    """Return whether `copy_session` can copy a session: its group is drawn, and its part's state can be copied."""
    return type(session) is SessionMachine and session.part.can_copy


def copy_session(session: SessionMachine, lend: WorldLender) -> SessionMachine:
    """Return a copy of a session; inputs fed to the copy leave the original unchanged.

    Discard the copy without closing it, because its world belongs to the original.

    Args:
        session: the session to copy.
        lend: called with a world's id and options when the copy opens a world; returns a world that may be reset, or
            None if there is none, in which case the copy's ``receive`` raises a WorldError.
    """
    copied: SessionMachine = _Copier(lend).copy(session)
    return copied


class _LentContext(SessionContext):
    """A session context whose worlds are lent."""

    _lend: WorldLender

    def world(self, world_id: str, options: dict[str, Any]) -> World:
        """Return the world that is lent for an id and options; it is the open world from now on.

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
    """Copies objects of the session machine, each once, and replaces the session context by one with lent worlds."""

    def __init__(self, lend: WorldLender) -> None:
        self._lend = lend
        self._copies: dict[int, Any] = {}  # by the identity of the original

    def copy(self, original: Any) -> Any:
        """Return a copy of an object that changes while a session runs; return any other object itself."""
        cls = type(original)
        if id(original) in self._copies:
            return self._copies[id(original)]
        if cls is list or cls is set:
            return self._copies.setdefault(id(original), cls(map(self.copy, original)))
        if cls is dict:
            return self._copies.setdefault(id(original), {key: self.copy(element) for key, element in original.items()})
        if cls is tuple:
            return tuple(map(self.copy, original))
        if _is_mutable(original):
            return self._copy_attributes(original)
        return original

    def _copy_attributes(self, original: Any) -> Any:
        """Return a copy of an object of the session machine, with copies of its attributes."""
        cls = _LentContext if type(original) is SessionContext else type(original)
        duplicate = object.__new__(cls)
        self._copies[id(original)] = duplicate  # registered first, as its attributes may refer back to it
        duplicate.__dict__.update((name, self.copy(attribute)) for name, attribute in vars(original).items())
        if isinstance(duplicate, _LentContext):
            duplicate._lend = self._lend
        return duplicate


def _is_mutable(candidate: Any) -> bool:
    """Return whether an object belongs to the session machine and changes while a session runs."""
    if isinstance(candidate, Activity | AnswerDraft):  # including a plug-in's classes
        return True
    cls = type(candidate)
    dataclass_params = getattr(cls, "__dataclass_params__", None)
    is_frozen = dataclass_params is not None and dataclass_params.frozen
    if is_frozen or not cls.__module__.startswith(_COPIED_PACKAGES):
        return False
    is_enum_member = hasattr(cls, "__members__")
    has_state = hasattr(candidate, "__dict__") and not is_enum_member
    return has_state and not isinstance(candidate, type | InterfaceWords)
