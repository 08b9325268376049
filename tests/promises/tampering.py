"""Logs changed by a careful hand: one thing is another, every checksum is right, the hash chain too if asked for."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from google.protobuf.message import Message
from mcap.records import Attachment, Metadata
from mcap.writer import Writer

from minihuman.log import integrity, names, topics
from minihuman.log.integrity import HashChain
from minihuman.log.names import CHAIN_KEY
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner

Record = LogMessage | Metadata | Attachment
Change = Callable[[list[Record]], None]


def rewritten(log: Path, target: Path, change: Change, *, chained: bool) -> Path:
    """A copy of a log in which something is changed; ``chained``: with the chain made again over what is there now."""
    scan = LogScanner(log)
    records: list[Any] = list(scan)
    change(records)
    chain = HashChain()
    with target.open("wb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start(profile=names.PROFILE)
        for schema in sorted(scan.schemas.values(), key=lambda schema: schema.id):
            assert writer.register_schema(schema.name, schema.encoding, schema.data) == schema.id
        for channel in sorted(scan.channels.values(), key=lambda channel: channel.id):
            number = writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id)
            assert number == channel.id
        pending = False
        for record in records:
            if not isinstance(record, LogMessage) and pending:
                writer.flush()
                pending = False
            match record:
                case LogMessage():
                    writer.add_message(
                        record.channel.id, record.log_time, record.data, record.publish_time, record.sequence
                    )
                    chain.add_message(record, scan.schemas.get(record.channel.schema_id))
                    pending = True
                case Metadata():
                    chain.add_metadata(record)
                    facts = dict(record.metadata)
                    if chained and CHAIN_KEY in facts:
                        facts[CHAIN_KEY] = chain.head
                    writer.add_metadata(record.name, facts)
                case Attachment():
                    chain.add_attachment(record)
                    writer.add_attachment(
                        record.create_time, record.log_time, record.name, record.media_type, record.data
                    )
        writer.finish()
    return target


def at(records: list[Record], topic: str, which: int = 0) -> int:
    """The place of a message on a topic, counted among those."""
    places = [
        place
        for place, record in enumerate(records)
        if isinstance(record, LogMessage) and record.channel.topic == topic
    ]
    return places[which]


def fields_changed(message: Message, path: str = "") -> Iterator[tuple[str, Message]]:
    """Every field of a message, and of what it holds, set to another value: its path and the changed message."""
    for field in message.DESCRIPTOR.fields:
        name = f"{path}{field.name}"
        changed = type(message)()
        changed.CopyFrom(message)
        value = getattr(message, field.name)
        if field.is_repeated:
            many = getattr(changed, field.name)
            if field.type == field.TYPE_MESSAGE:
                if len(value):
                    for inner, other in fields_changed(value[0], f"{name}[0]."):
                        again = type(message)()
                        again.CopyFrom(message)
                        getattr(again, field.name)[0].CopyFrom(other)
                        yield inner, again
                    del many[-1]
                else:
                    many.add()
            elif len(value):
                del many[-1]
            else:
                many.append(_another(field, None))
            yield f"{name}[]", changed
        elif field.type == field.TYPE_MESSAGE:
            if message.HasField(field.name):
                for inner, other in fields_changed(value, f"{name}."):
                    again = type(message)()
                    again.CopyFrom(message)
                    getattr(again, field.name).CopyFrom(other)
                    yield inner, again
                changed.ClearField(field.name)
                yield name, changed
        else:
            setattr(changed, field.name, _another(field, value))
            yield name, changed


def _another(field: Any, value: Any) -> Any:
    if field.type == field.TYPE_STRING:
        return f"{value or ''}x"
    if field.type == field.TYPE_BYTES:
        return (value or b"") + b"x"
    if field.type == field.TYPE_BOOL:
        return not value
    if field.type == field.TYPE_ENUM:
        return 0 if value else 1
    if field.type in (field.TYPE_DOUBLE, field.TYPE_FLOAT):
        return (value or 0.0) + 0.5
    return (value or 0) + 1


def messages_changed(records: list[Record], topic: str) -> Iterator[tuple[str, Change]]:
    """Changes of one field each in a message of a topic: the third, where there are three."""
    count = sum(isinstance(record, LogMessage) and record.channel.topic == topic for record in records)
    which = min(2, count - 1)
    original = records[at(records, topic, which)]
    assert isinstance(original, LogMessage)
    for name, changed in fields_changed(topics.BY_NAME[topic].message.FromString(original.data)):
        data = changed.SerializeToString(deterministic=True)
        if data != original.data:
            yield f"{topic} {name}", _put(topic, which, original._replace(data=data))
    for name in ("log_time", "publish_time", "sequence"):
        yield f"{topic} {name}", _put(topic, which, original._replace(**{name: getattr(original, name) + 1}))


def _put(topic: str, which: int, message: LogMessage) -> Change:
    def change(records: list[Record]) -> None:
        records[at(records, topic, which)] = message

    return change


def others_changed(records: list[Record]) -> Iterator[tuple[str, Change]]:
    """Changes of metadata and attachments: every fact, all content and names, each taken out and doubled."""
    for place, record in enumerate(records):
        if isinstance(record, Metadata):
            for name in record.metadata:
                facts = record.metadata | {name: record.metadata[name] + "1"}
                yield f"metadata {record.name} {name}", _set(place, Metadata(record.name, facts))
            yield (
                f"metadata {record.name} and one more",
                _set(place, Metadata(record.name, record.metadata | {"x": "y"})),
            )
        elif isinstance(record, Attachment):
            content = record.data[:-1] + bytes([record.data[-1] ^ 1])
            if record.name != integrity.SEGMENT_HEAD_NAME:
                yield f"attachment {record.name}", _set(place, _attachment(record, data=content))
            yield f"attachment {record.name} named otherwise", _set(place, _attachment(record, name="x"))
        else:
            continue
        yield f"{type(record).__name__} {record.name} taken out", lambda found, place=place: found.pop(place)
        yield (
            f"{type(record).__name__} {record.name} twice",
            lambda found, place=place: found.insert(place, found[place]),
        )


def _set(place: int, record: Record) -> Change:
    def change(records: list[Record]) -> None:
        records[place] = record

    return change


def _attachment(record: Attachment, **changed: Any) -> Attachment:
    return Attachment(**{**vars(record), **changed})


def moved(records: list[Record], topic: str) -> Iterator[tuple[str, Change]]:
    """A message taken out, with its number and without; written twice; two in a row swapped."""

    def taken_out(found: list[Record]) -> None:
        found.pop(at(found, topic, -1))

    def closed_up(found: list[Record]) -> None:
        """Nothing is missing by the numbers."""
        gone = at(found, topic, -1)
        number = found.pop(gone).sequence  # type: ignore[union-attr]
        for place, record in enumerate(found):
            if number and isinstance(record, LogMessage) and record.sequence > number:
                found[place] = record._replace(sequence=record.sequence - 1)

    def twice(found: list[Record]) -> None:
        place = at(found, topic, -1)
        found.insert(place, found[place])

    def swapped(found: list[Record]) -> None:
        place = at(found, topic, -1)
        other = next(n for n in range(place - 1, 0, -1) if isinstance(found[n], LogMessage))
        one, two = found[other], found[place]
        found[other] = two._replace(sequence=one.sequence)  # type: ignore[union-attr]
        found[place] = one._replace(sequence=two.sequence)  # type: ignore[union-attr]

    yield f"{topic} taken out", taken_out
    yield f"{topic} taken out, numbers closed up", closed_up
    yield f"{topic} twice", twice
    if topic != topics.PLAN:
        yield f"{topic} swapped with the one before", swapped
