"""Events of one kind as columns: one field of all of them at once, or an event whenever one is looked at.

A session has thousands of key presses, and most readers want two or three columns of them.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, Generic, TypeVar, get_args, overload

from minihuman.log.plan_messages import one_of
from minihuman.log.wire import Column
from minihuman.study.events import FrameShown, KeyPressed, Verdict

E = TypeVar("E", KeyPressed, FrameShown)
_VERDICTS = get_args(Verdict)
_PLACES = {kind: {field.name: place for place, field in enumerate(fields(kind))} for kind in (KeyPressed, FrameShown)}


class EventColumns(Sequence[E], Generic[E]):
    """A sequence of events of one kind, kept column by column."""

    __slots__ = ("_columns", "_kind")

    def __init__(self, kind: type[E], columns: Sequence[Sequence[Any]]) -> None:
        """``columns`` are all of one length, one for each field of ``kind``, in its order."""
        self._kind: type[E] = kind
        self._columns = tuple(columns)

    @classmethod
    def of(cls, kind: type[E], events: Iterable[E]) -> "EventColumns[E]":
        """The columns of these events."""
        given = tuple(events)
        return cls(kind, [[getattr(event, name) for event in given] for name in _PLACES[kind]])

    def column(self, name: str) -> Sequence[Any]:
        """The field of that name, of every event."""
        return self._columns[_PLACES[self._kind][name]]

    def __len__(self) -> int:
        return len(self._columns[0])

    def __iter__(self) -> Iterator[E]:
        return map(self._kind, *self._columns)

    @overload
    def __getitem__(self, place: int) -> E: ...
    @overload
    def __getitem__(self, place: slice) -> "EventColumns[E]": ...
    def __getitem__(self, place: int | slice) -> "E | EventColumns[E]":
        parts: list[Any] = [column[place] for column in self._columns]
        return EventColumns(self._kind, parts) if isinstance(place, slice) else self._kind(*parts)


def presses(columns: Mapping[str, Column]) -> EventColumns[KeyPressed]:
    """Key presses and releases from the columns of their messages.

    Raises:
        LogError: if a verdict is outside its vocabulary.
    """
    for word in set(columns["verdict"].values):
        one_of(_VERDICTS, word)
    action = columns["action"]
    asked = zip(action.values.tolist(), action.there.tolist(), strict=True)
    return EventColumns(
        KeyPressed,
        (
            columns["t_ns"].values.tolist(),
            columns["key"].values,
            columns["symbol"].values,
            columns["down"].values.tolist(),
            [number if there else None for number, there in asked],
            columns["verdict"].values,
            columns["phase"].values,
        ),
    )


def frames(columns: Mapping[str, Column]) -> EventColumns[FrameShown]:
    """Pictures shown from the columns of their messages."""
    return EventColumns(FrameShown, [columns[name].values.tolist() for name in _PLACES[FrameShown]])
