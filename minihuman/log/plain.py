"""Events whose fields are their message's fields, name by name: one row each, and nothing else to write.

What a kind of activity adds is in its own rows: ``minihuman.log.kinds``.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, get_args

from google.protobuf.message import Message

from minihuman.log import topics
from minihuman.log.plan_messages import one_of
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.study import events as ev

PLAIN: dict[type, tuple[str, type[Message]]] = {
    ev.EpisodesSkipped: (topics.SKIP, v1.EpisodesSkipped),
    ev.Scored: (topics.POINTS, v1.Scored),
    ev.ClauseDone: (topics.CLAUSE, v1.ClauseDone),
    ev.PartStarted: (topics.PART, v1.PartStarted),
    ev.PartEnded: (topics.PART_END, v1.PartEnded),
    ev.PageShown: (topics.PAGE, v1.PageShown),
    ev.TextTyped: (topics.TEXT, v1.TextTyped),
    ev.PointerUsed: (topics.POINTER, v1.PointerUsed),
    ev.AnswerChanged: (topics.ANSWER_CHANGE, v1.AnswerChanged),
    ev.Answered: (topics.ANSWER, v1.Answered),
    ev.Linked: (topics.LINK, v1.Linked),
}
_WORDS: dict[tuple[type, str], tuple[str, ...]] = {
    (ev.EpisodesSkipped, "reason"): get_args(ev.SkipReason),
    (ev.PartEnded, "end"): get_args(ev.PartEnd),
    (ev.PointerUsed, "what"): ("pressed", "moved", "released"),
}


def message_of(event: ev.Event) -> tuple[str, Message] | None:
    """The topic and the message of an event; None if it is none of these."""
    row = PLAIN.get(type(event))
    if row is None:
        return None
    topic, message = row
    return topic, message(**{field.name: getattr(event, field.name) for field in fields(event)})


def readers() -> dict[str, Callable[[bytes], Any]]:
    """For each topic, what makes an event of a message's bytes."""
    return {topic: _reader(event, message) for event, (topic, message) in PLAIN.items()}


def _reader(event: type, message: type[Message]) -> Callable[[bytes], Any]:
    optional = {name for name, field in message.DESCRIPTOR.fields_by_name.items() if field.has_presence}
    names = [field.name for field in fields(event)]
    words = {name: allowed for (kind, name), allowed in _WORDS.items() if kind is event}

    def read(data: bytes) -> Any:
        found = message.FromString(data)
        values = {name: getattr(found, name) for name in names}
        for name in optional:
            if not found.HasField(name):
                values[name] = None
        for name, allowed in words.items():
            one_of(allowed, values[name])
        return event(**values)

    return read
