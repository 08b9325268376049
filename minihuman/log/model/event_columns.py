"""Columns of recorded events: one field of all events of a kind, with categorical texts such as keys and verdicts.

A session has thousands of key presses, and most readers need only two or three columns. A column is read only when it
is used, and an event object is created only when an event is indexed.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import fields
from functools import cache
from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.events import FrameShown, KeyPressed


class CategoricalTexts(Sequence[str]):
    """A sequence of texts with few distinct values, stored as codes; equal to any other sequence of the same texts."""

    __slots__ = ("categories", "codes")
    __hash__ = None  # type: ignore[assignment] # as a list

    def __init__(self, codes: NDArray[np.integer[Any]], categories: Sequence[str]) -> None:
        self.codes = codes  # (n,) indices into ``categories``
        self.categories = categories  # distinct

    @classmethod
    def of(cls, texts: Iterable[str]) -> "CategoricalTexts":
        """Build a column from texts."""
        if isinstance(texts, CategoricalTexts):
            return texts
        codes: dict[str, int] = {}
        return cls(np.array([codes.setdefault(text, len(codes)) for text in texts], np.int64), tuple(codes))

    @classmethod
    def joined(cls, parts: Sequence["CategoricalTexts"]) -> "CategoricalTexts":
        """Concatenate one or more columns."""
        first, *_ = parts
        if all(part.categories == first.categories for part in parts):
            return cls(np.concatenate([part.codes for part in parts]), first.categories)
        new_codes: dict[str, int] = {}  # by word
        columns = []
        for part in parts:
            codes = [new_codes.setdefault(word, len(new_codes)) for word in part.categories]
            columns.append(np.array(codes, np.int64)[part.codes])
        return cls(np.concatenate(columns), tuple(new_codes))

    def __len__(self) -> int:
        return len(self.codes)

    def __iter__(self) -> Iterator[str]:
        return map(self.categories.__getitem__, self.codes.tolist())

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice | NDArray[Any]) -> "CategoricalTexts": ...
    def __getitem__(self, index: int | slice | NDArray[Any]) -> "str | CategoricalTexts":
        if isinstance(index, slice | np.ndarray):
            return CategoricalTexts(self.codes[index], self.categories)
        text: str = self.categories[self.codes[index]]
        return text

    def __eq__(self, other: object) -> bool:
        return list(self) == list(other) if isinstance(other, Sequence) else NotImplemented

    def __repr__(self) -> str:
        return f"CategoricalTexts.of({list(self)!r})"

    def equals_any(self, texts: Collection[str]) -> NDArray[np.bool_]:
        """Return a mask, (n,), that is True for each row whose text is one of the given texts."""
        is_equal: NDArray[np.bool_] = np.array([word in texts for word in self.categories], np.bool_)[self.codes]
        return is_equal

    def count_values(self, rows: NDArray[np.bool_] | slice = slice(None)) -> Counter[str]:
        """Return how often each text occurs in the selected rows; a category without such a row has count 0.

        Args:
            rows: a mask of the selected rows, (n,), or a slice; by default, all rows.
        """
        counts = np.bincount(self.codes[rows], minlength=len(self.categories))
        return Counter(dict(zip(self.categories, counts.tolist(), strict=True)))

    def first_index(self, rows: NDArray[np.bool_]) -> dict[str, int]:
        """Return the index of the first selected row with each text, by text; texts without a selected row are absent.

        Args:
            rows: a mask of the selected rows, (n,).
        """
        indices = np.flatnonzero(rows)
        codes, firsts = np.unique(self.codes[indices], return_index=True)
        first_indices = indices[firsts].tolist()
        return {self.categories[code]: index for code, index in zip(codes.tolist(), first_indices, strict=True)}


KeyOrFrame = TypeVar("KeyOrFrame", KeyPressed, FrameShown)
NO_ACTION = -1  # stands for None in a column of actions


class EventColumns(Sequence[KeyOrFrame], Generic[KeyOrFrame]):
    """A sequence of events of one kind, stored by column.

    Raises:
        LogError: when a column or an event is accessed that cannot be read.
    """

    __slots__ = ("_column", "_kind", "_rows")

    def __init__(self, kind: type[KeyOrFrame], column: Callable[[str], Any], rows: range) -> None:
        """Create the sequence.

        Args:
            kind: the class of the events.
            column: returns the field of a given name for all recorded events.
            rows: the recorded events that belong to this sequence.
        """
        self._kind: type[KeyOrFrame] = kind
        self._column = column
        self._rows = rows

    @classmethod
    def of(cls, kind: type[KeyOrFrame], events: Iterable[KeyOrFrame]) -> "EventColumns[KeyOrFrame]":
        """Build the columns of events that exist as objects."""
        event_list = tuple(events)

        @cache
        def column(name: str) -> Any:
            return _build_column(name, [getattr(event, name) for event in event_list])

        return cls(kind, column, range(len(event_list)))

    @classmethod
    def joined(cls, parts: "Sequence[EventColumns[KeyOrFrame]]") -> "EventColumns[KeyOrFrame]":
        """Concatenate one or more sequences of events."""
        if len(parts) == 1:
            return parts[0]

        @cache
        def column(name: str) -> Any:
            columns = [part.column(name) for part in parts]
            if isinstance(columns[0], CategoricalTexts):
                return CategoricalTexts.joined(columns)
            return np.concatenate(columns)

        return cls(parts[0]._kind, column, range(sum(map(len, parts))))

    def column(self, name: str) -> Any:
        """Return one field of every event as ``CategoricalTexts`` or an array, in which NO_ACTION means no action."""
        return self._column(name)[self._rows.start : self._rows.stop : self._rows.step]

    def place(self, part: "EventColumns[KeyOrFrame]") -> slice:
        """Return the slice of this sequence that holds the events of ``part``, which is a contiguous slice of it."""
        begin = part._rows.start - self._rows.start
        return slice(begin, begin + len(part))

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[KeyOrFrame]:
        return map(self._kind, *(_convert_column(field.name, self.column(field.name)) for field in fields(self._kind)))

    @overload
    def __getitem__(self, index: int) -> KeyOrFrame: ...
    @overload
    def __getitem__(self, index: slice) -> "EventColumns[KeyOrFrame]": ...
    def __getitem__(self, index: int | slice) -> "KeyOrFrame | EventColumns[KeyOrFrame]":
        rows = self._rows[index]
        if isinstance(rows, range):
            return EventColumns(self._kind, self._column, rows)
        return self._kind(*(_convert_cell(field.name, self._column(field.name)[rows]) for field in fields(self._kind)))


def _convert_column(name: str, column: Any) -> Iterable[Any]:
    """Return the column of the field with a name as values of event objects, in which None stands for no action."""
    if isinstance(column, CategoricalTexts):
        return column
    values: list[Any] = column.tolist()
    if name == "action":
        return [None if value == NO_ACTION else value for value in values]
    return values


def _convert_cell(name: str, cell: Any) -> Any:
    """Return one value of the field with a name as in an event object, in which None stands for no action."""
    if isinstance(cell, str):
        return cell
    number = cell.item()
    if name == "action" and number == NO_ACTION:
        return None
    return number


def _build_column(name: str, values: list[Any]) -> Any:
    """Build the column of a field, given its name, from the values that the event objects have."""
    match name:
        case "key" | "symbol" | "verdict" | "phase":
            return CategoricalTexts.of(values)
        case "action":
            actions = [NO_ACTION if action is None else action for action in values]
            return np.array(actions, np.int64)
        case "down":
            return np.array(values, np.bool_)
        case "picture_hash":
            return np.array(values, np.uint64)
    return np.array(values, np.int64)
