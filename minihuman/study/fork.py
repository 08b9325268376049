"""A session forked: a second one in the same state, to try what an input would lead to. The first one never notices.

What the machine changes is copied, values are shared. Worlds are not copied: the fork reads the session's own world as
it is, and whatever it would reset or step is refused, unless somebody lends it a world for that.
"""

from collections.abc import Callable
from typing import Any

from minihuman.errors import WorldError
from minihuman.study.activities.keyboard import KeyboardCheck
from minihuman.study.activities.pages import Pages
from minihuman.study.activities.play import Playing
from minihuman.study.activities.questions import Questions
from minihuman.study.session import Session
from minihuman.study.stage import Stage
from minihuman.study.words import Words
from minihuman.worlds.adapt.world import World

Lend = Callable[[str, dict[str, Any]], World | None]
_OURS = "minihuman.study."


def can_fork(session: Session) -> bool:
    """Whether a session is in a part whose state is known to be copied whole; other kinds may keep it elsewhere."""
    return type(session) is Session and type(session.part) in (Pages, Questions, KeyboardCheck, Playing)


def fork(session: Session, lend: Lend) -> Session:
    """A session in the same state, to be fed inputs and thrown away; never closed, as its world is the other's.

    Args:
        session: where to start from.
        lend: a world that may be reset for an id and its options; None where there is none, which ends the fork.
    """
    copied: Session = _Copier(lend).copy(session)
    return copied


class _LentStage(Stage):
    """A stage whose worlds are lent."""

    _lend: Lend

    def world(self, world_id: str, options: dict[str, Any]) -> World:
        """The lent world."""
        lent = self._lend(world_id, options)
        if lent is None:
            raise WorldError(f"no world of {world_id} is lent")
        return lent

    def close(self) -> None:
        """Nothing: the world is somebody else's."""


class _Copier:
    def __init__(self, lend: Lend) -> None:
        self._lend = lend
        self._made: dict[int, Any] = {}

    def copy(self, value: Any) -> Any:
        """A value as it is, or a copy of what changes."""
        kind = type(value)
        if id(value) in self._made:
            return self._made[id(value)]
        if kind is list or kind is set:
            return self._made.setdefault(id(value), kind(map(self.copy, value)))
        if kind is dict:
            return self._made.setdefault(id(value), {name: self.copy(one) for name, one in value.items()})
        if kind is tuple:
            return tuple(map(self.copy, value))
        return self._of_machine(value) if _changes(value) else value

    def _of_machine(self, value: Any) -> Any:
        kind = _LentStage if type(value) is Stage else type(value)
        made = self._made[id(value)] = object.__new__(kind)
        made.__dict__.update((name, self.copy(one)) for name, one in vars(value).items())
        if isinstance(made, _LentStage):
            made._lend = self._lend
        return made


def _changes(value: Any) -> bool:
    """Whether it is an object of the machine that is changed while a session runs."""
    kind = type(value)
    frozen = getattr(kind, "__dataclass_params__", None)
    if not kind.__module__.startswith(_OURS) or (frozen is not None and frozen.frozen):
        return False
    return hasattr(value, "__dict__") and not isinstance(value, type | Words) and not hasattr(kind, "__members__")
