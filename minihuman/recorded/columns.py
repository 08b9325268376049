"""Events of one kind as columns: one field of all of them at once, or an event whenever one is looked at.

A session has thousands of key presses, and most readers want two or three columns of them: none is read before that.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from functools import cache
from typing import Any, Generic, TypeVar, overload

import numpy as np

from minihuman.recorded.categorical import Words
from minihuman.study.events import FrameShown, KeyPressed

E = TypeVar("E", KeyPressed, FrameShown)
NO_ACTION = -1  # in a column of actions, where an event has none


class EventColumns(Sequence[E], Generic[E]):
    """A sequence of events of one kind, kept column by column.

    Raises:
        LogError: when a column or an event is looked at that cannot be read.
    """

    __slots__ = ("_column", "_kind", "_rows")

    def __init__(self, kind: type[E], column: Callable[[str], Any], rows: range) -> None:
        """``column`` gives the field of that name of all events that were recorded; these here are the ``rows``."""
        self._kind: type[E] = kind
        self._column = column
        self._rows = rows

    @classmethod
    def of(cls, kind: type[E], events: Iterable[E]) -> "EventColumns[E]":
        """The columns of these events."""
        given = tuple(events)

        @cache
        def column(name: str) -> Any:
            return _column(name, [getattr(event, name) for event in given])

        return cls(kind, column, range(len(given)))

    @classmethod
    def joined(cls, parts: "Sequence[EventColumns[E]]") -> "EventColumns[E]":
        """Several, one behind the other; there is at least one."""
        if len(parts) == 1:
            return parts[0]

        @cache
        def column(name: str) -> Any:
            columns = [part.column(name) for part in parts]
            return Words.joined(columns) if isinstance(columns[0], Words) else np.concatenate(columns)

        return cls(parts[0]._kind, column, range(sum(map(len, parts))))

    def column(self, name: str) -> Any:
        """The field of that name, of every event: ``Words`` or an array; actions are NO_ACTION where there is none."""
        return self._column(name)[self._rows.start : self._rows.stop : self._rows.step]

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[E]:
        return map(self._kind, *(_values(field.name, self.column(field.name)) for field in fields(self._kind)))

    @overload
    def __getitem__(self, place: int) -> E: ...
    @overload
    def __getitem__(self, place: slice) -> "EventColumns[E]": ...
    def __getitem__(self, place: int | slice) -> "E | EventColumns[E]":
        rows = self._rows[place]
        if isinstance(rows, range):
            return EventColumns(self._kind, self._column, rows)
        return self._kind(*(_value(field.name, self._column(field.name)[rows]) for field in fields(self._kind)))


def _values(name: str, column: Any) -> Iterable[Any]:
    """A column's values, as events have them."""
    if isinstance(column, Words):
        return column
    values: list[Any] = column.tolist()
    return [None if value == NO_ACTION else value for value in values] if name == "action" else values


def _value(name: str, found: Any) -> Any:
    """One value of a column, as events have it."""
    value = found if isinstance(found, str) else found.item()
    return None if name == "action" and value == NO_ACTION else value


def _column(name: str, values: list[Any]) -> Any:
    match name:
        case "key" | "symbol" | "verdict" | "phase":
            return Words.of(values)
        case "action":
            return np.array([NO_ACTION if value is None else value for value in values], np.int64)
        case "down":
            return np.array(values, np.bool_)
    return np.array(values, np.int64)
