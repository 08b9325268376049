"""What kinds of activity add to a log: topics, messages and events of their own, found through the registry.

A kind's events travel like our plain ones: their fields are their message's, name by name. ``minihuman.log.agent`` is
such a list of rows.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from importlib import import_module
from typing import Any

from google.protobuf.message import Message

from minihuman.errors import ProtocolError
from minihuman.log import topics
from minihuman.log.plan_messages import one_of
from minihuman.log.topics import Topic
from minihuman.plugins import names
from minihuman.study.activities.port import Kind
from minihuman.study.activities.registry import GROUP, OURS, kind_of
from minihuman.study.events import KindEvent


@dataclass(frozen=True, slots=True)
class Row:
    """An event of a kind, and the topic that it travels on."""

    event: type[KindEvent]
    topic: Topic
    words: Mapping[str, tuple[str, ...]] = field(default_factory=dict, hash=False)  # all that a field may say


class Truths:
    """The topics that hold the truth, a container: those of the session and those of every kind there is."""

    def __contains__(self, topic: object) -> bool:
        found = known(str(topic))
        return found is not None and not found.for_viewers


TRUTHS = Truths()
_ROWS_FOR: dict[type[KindEvent], Row] = {}


@cache
def known(topic: str) -> Topic | None:
    """What is known of a topic; None for a guest's."""
    row = None if topic in topics.BY_NAME else _row_of(topic)
    return topics.BY_NAME.get(topic) if row is None else row.topic


def topics_of(kinds: Iterable[str]) -> tuple[Topic, ...]:
    """The topics that these kinds of activity add, each once."""
    rows = (row for kind in dict.fromkeys(kinds) for row in _rows(kind))
    return tuple(dict.fromkeys(row.topic for row in rows))


def message_of(event: KindEvent) -> tuple[str, Message]:
    """The topic and the message of a kind's event."""
    row = _ROWS_FOR.get(type(event)) or _ROWS_FOR.setdefault(type(event), _row_for(type(event)))
    values = {name.name: getattr(event, name.name) for name in fields(event)}
    return row.topic.name, row.topic.message(**values)


@cache
def reader_of(topic: str) -> Callable[[bytes], KindEvent] | None:
    """What makes an event of a message's bytes; None for a topic of no kind."""
    row = None if topic in topics.BY_NAME else _row_of(topic)
    if row is None:
        return None
    message, event, words = row.topic.message, row.event, row.words
    lists = {name for name in message.DESCRIPTOR.fields_by_name if hasattr(getattr(message(), name), "append")}
    optional = {name for name, its in message.DESCRIPTOR.fields_by_name.items() if its.has_presence}
    wanted = [its.name for its in fields(event)]

    def read(data: bytes) -> KindEvent:
        found = message.FromString(data)
        values: dict[str, Any] = {}
        for name in wanted:
            value: Any = None if name in optional and not found.HasField(name) else getattr(found, name)
            values[name] = tuple(value) if name in lists else value
        for name, allowed in words.items():
            one_of(allowed, values[name])
        return event(**values)

    return read


def _row_for(event: type[KindEvent]) -> Row:
    for row in (*_ours(), *_others()):
        if row.event is event:
            return row
    raise AssertionError(f"{event.__name__} has no message; give it a row in the messages of its kind")


def _row_of(topic: str) -> Row | None:
    for rows in (_ours, _others):  # what is installed is only looked for where a topic is none of ours
        for row in rows():
            if row.topic.name == topic:
                return row
    return None


@cache
def _ours() -> tuple[Row, ...]:
    return tuple(dict.fromkeys(row for kind in OURS for row in _rows(kind)))


@cache
def _others() -> tuple[Row, ...]:
    return tuple(row for kind in names(GROUP) if kind not in OURS for row in _rows(kind))


@cache
def _rows(kind: str) -> tuple[Row, ...]:
    """A kind's rows; none where it is not installed here, or cannot be loaded: its topics are then a guest's."""
    try:
        return rows_of(kind_of(kind))
    except (ProtocolError, ImportError):
        return ()


def rows_of(kind: Kind) -> tuple[Row, ...]:
    """The rows that a kind names."""
    module, _, name = kind.messages.partition(":")
    return tuple(getattr(import_module(module), name)) if module else ()
