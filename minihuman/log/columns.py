"""Events of one kind as columns: one field of all of them at once, or an event whenever one is looked at.

A session has thousands of key presses, and most readers want two or three columns of them: none is read before that.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from functools import cache
from typing import Any, Generic, TypeVar, get_args, overload

from minihuman.log.plan_messages import one_of
from minihuman.log.wire import Column
from minihuman.study.events import FrameShown, KeyPressed, Verdict

E = TypeVar("E", KeyPressed, FrameShown)
_VERDICTS = get_args(Verdict)


class EventColumns(Sequence[E], Generic[E]):
    """A sequence of events of one kind, kept column by column.

    Raises:
        LogError: when a column or an event is looked at that cannot be read.
    """

    __slots__ = ("_column", "_kind", "_rows")

    def __init__(self, kind: type[E], column: Callable[[str], Sequence[Any]], rows: range) -> None:
        """``column`` gives the field of that name of all events that were recorded; these here are the ``rows``."""
        self._kind: type[E] = kind
        self._column = column
        self._rows = rows

    @classmethod
    def of(cls, kind: type[E], events: Iterable[E]) -> "EventColumns[E]":
        """The columns of these events."""
        given = tuple(events)
        return cls(kind, cache(lambda name: [getattr(event, name) for event in given]), range(len(given)))

    def column(self, name: str) -> Sequence[Any]:
        """The field of that name, of every event."""
        return self._column(name)[self._rows.start : self._rows.stop : self._rows.step]

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[E]:
        return map(self._kind, *(self.column(field.name) for field in fields(self._kind)))

    @overload
    def __getitem__(self, place: int) -> E: ...
    @overload
    def __getitem__(self, place: slice) -> "EventColumns[E]": ...
    def __getitem__(self, place: int | slice) -> "E | EventColumns[E]":
        if isinstance(place, slice):
            return EventColumns(self._kind, self._column, self._rows[place])
        row = self._rows[place]
        return self._kind(*(self._column(field.name)[row] for field in fields(self._kind)))


def presses(column: Callable[[str], Column], count: int) -> EventColumns[KeyPressed]:
    """Key presses and releases from the columns of their messages.

    Raises:
        LogError: if a verdict is outside its vocabulary.
    """

    @cache
    def values(name: str) -> Sequence[Any]:
        found = column(name)
        if name != "action":
            return _listed(found)
        asked = zip(found.values.tolist(), found.there.tolist(), strict=True)
        return [number if there else None for number, there in asked]

    for word in set(values("verdict")):
        one_of(_VERDICTS, word)
    return EventColumns(KeyPressed, values, range(count))


def frames(column: Callable[[str], Column], count: int) -> EventColumns[FrameShown]:
    """Pictures shown from the columns of their messages."""
    return EventColumns(FrameShown, cache(lambda name: _listed(column(name))), range(count))


def _listed(column: Column) -> list[Any]:
    values: list[Any] = column.values if isinstance(column.values, list) else column.values.tolist()
    return values
