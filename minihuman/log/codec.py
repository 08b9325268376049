"""Encode events as protobuf messages and decode them, by schema version; opens no file.

One table has a row for each event: its topic, and the fields that differ on the wire. All other fields are the
message's fields of the same name. A kind of activity adds rows for events of its own (its ``rows`` module).
``decode_event`` undoes ``encode_event`` exactly.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal, Protocol, get_args, get_origin, get_type_hints

import msgspec
from google.protobuf.message import Message

from minihuman.errors import LogError, NewerLogError, ProtocolError
from minihuman.experiment.machine import events
from minihuman.experiment.machine.activity import GROUP, ActivityKind, find_kind, list_built_in_kinds
from minihuman.experiment.plan.designs import GroupAssignment
from minihuman.experiment.plan.session_plan import (
    BlockText,
    BonusSpec,
    EpisodePlan,
    KeyMap,
    Participant,
    PlannedPart,
    ResumeState,
    SessionPlan,
)
from minihuman.experiment.words import ENGLISH
from minihuman.log import topics
from minihuman.log.names import SCHEMA_VERSION
from minihuman.log.observations import decode_observation, encode_observation
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.topics import Topic
from minihuman.plugins import list_plugin_names
from minihuman.worlds.pose import Map, Pose, Thing


def require_one_of(allowed: tuple[str, ...], value: str) -> Any:
    """Pass a word of a fixed vocabulary (a ``Literal``'s arguments) through.

    Raises:
        LogError: if the word is not of the vocabulary.
    """
    if value not in allowed:
        raise LogError(
            f"value {value!r} in the log is not one of {', '.join(allowed)}; the log is damaged, or a newer minihuman "
            "wrote it"
        )
    return value


class Codec(Protocol):
    """Encodes a value as a message and decodes it."""

    def encode(self, value: Any, /) -> Any:
        """Put a value into its message."""

    def decode(self, message: Any, /) -> Any:
        """Read the value in a message."""


@dataclass(frozen=True, slots=True)
class FieldCodec:
    """A field that has another name or another form on the wire."""

    name: str
    encode: Callable[[Any], Any] | None = None
    decode: Callable[[Any], Any] | None = None


def nested(name: str, codec: Codec) -> FieldCodec:
    """A field that is a message of its own."""
    return FieldCodec(name, codec.encode, codec.decode)


def repeated(name: str, codec: Codec) -> FieldCodec:
    """A tuple whose items are messages."""
    return FieldCodec(
        name, lambda values: list(map(codec.encode, values)), lambda messages: tuple(map(codec.decode, messages))
    )


def json_field(name: str, kind: Any = Any, *, default: str = "null") -> FieldCodec:
    """A field that travels as JSON; ``default`` stands for the empty text of logs that are older than the field."""
    return FieldCodec(name, _to_json, lambda text: msgspec.json.decode(text or default, type=kind))


def _to_json(value: Any) -> str:
    return msgspec.json.encode(value).decode()


class MessageCodec:
    """Encodes a dataclass or a msgspec struct field by field.

    A ``Literal`` is checked against its vocabulary, a repeated field is a tuple, and an absent optional field is None.

    Args:
        kind: the class of the values.
        message: the type of their messages.
        fields: the fields that differ on the wire, by their names in ``kind``.
    """

    def __init__(self, kind: type[Any], message: type[Message], fields: Mapping[str, FieldCodec] | None = None) -> None:
        hints = get_type_hints(kind)
        fields = fields or {}
        names = msgspec.structs.fields(kind) if issubclass(kind, msgspec.Struct) else dataclasses.fields(kind)
        self._names = tuple(its.name for its in names)
        self._wire_names = tuple(fields[name].name if name in fields else name for name in self._names)
        self._kind = kind
        self._message = message
        self._from_message = _values_getter(self._wire_names)
        encoders: dict[str, Callable[[Any], Any]] = {}
        self._decoders: list[tuple[int, Callable[[Any], Any]]] = []
        self._vocabularies: list[tuple[int, tuple[str, ...]]] = []
        self._optional: list[tuple[int, str]] = []
        for place, (name, wire_name) in enumerate(zip(self._names, self._wire_names, strict=True)):
            its = message.DESCRIPTOR.fields_by_name[wire_name]
            hint = hints[name]
            codec = fields.get(name, FieldCodec(wire_name))
            decode = codec.decode
            if decode is None and its.default_value == []:  # a repeated field's, in every release of protobuf
                decode = tuple
            optional = its.has_presence and (its.message_type is None or type(None) in get_args(hint))
            if optional:
                self._optional.append((place, wire_name))
            if get_origin(hint) is Literal:
                self._vocabularies.append((place, get_args(hint)))
            if codec.encode is not None:
                encoders[name] = _unless_none(codec.encode) if optional else codec.encode
            if decode is not None:
                self._decoders.append((place, _unless_none(decode) if optional else decode))
        self._build = _message_builder(message, zip(self._names, self._wire_names, strict=True), encoders)

    def encode(self, value: Any, /) -> Any:
        """Put a value into its message."""
        return self._build(value)

    def decode(self, message: Any, /) -> Any:
        """Read the value in a message.

        Raises:
            LogError: if a word in it is outside its vocabulary.
        """
        values = list(self._from_message(message))
        for place, wire_name in self._optional:
            if not message.HasField(wire_name):
                values[place] = None
        for place, decode in self._decoders:
            values[place] = decode(values[place])
        for place, allowed in self._vocabularies:
            if values[place] not in allowed:
                require_one_of(allowed, values[place])
        return self._kind(*values)


def _message_builder(
    message: type[Message], names: Iterable[tuple[str, str]], encoders: Mapping[str, Callable[[Any], Any]]
) -> Callable[[Any], Any]:
    """Compile a function that makes a value's message, as dataclasses do with ``__init__``: 1.6 us instead of 2.4."""
    encode = {f"encode_{name}": encoder for name, encoder in encoders.items()}
    fields = (
        f"{wire_name}=encode_{name}(value.{name})" if name in encoders else f"{wire_name}=value.{name}"
        for name, wire_name in names
    )
    build: Callable[[Any], Any] = eval(f"lambda value: message({', '.join(fields)})", {"message": message, **encode})
    return build


def _values_getter(names: Iterable[str]) -> Callable[[Any], tuple[Any, ...]]:
    first, *rest = names
    get = attrgetter(first, *rest)
    return get if rest else lambda value: (get(value),)


def _unless_none(convert: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else convert(value)


@dataclass(frozen=True, slots=True)
class CustomCodec:
    """Encodes a value as a message where the two have different shapes."""

    encode: Callable[[Any], Any]
    decode: Callable[[Any], Any]


def _decode_part(message: v1.Part) -> PlannedPart:
    """A part as its kind reads it; as plain JSON where this machine has no such kind, so that the log opens even so."""
    plan = msgspec.json.decode(message.plan_json)
    with suppress(ProtocolError):
        plan = find_kind(message.kind).read(plan)
    return PlannedPart(message.kind, message.name, plan)


POSE = MessageCodec(Pose, v1.Pose)
_WALL = CustomCodec(
    lambda wall: v1.Wall(x0=wall[0], z0=wall[1], x1=wall[2], z1=wall[3]), attrgetter("x0", "z0", "x1", "z1")
)
_MAP = MessageCodec(
    Map,
    v1.Map,
    {
        "bounds": nested("bounds", _WALL),
        "walls": repeated("walls", _WALL),
        "things": repeated("things", MessageCodec(Thing, v1.Thing)),
    },
)
_KEY_BINDINGS = FieldCodec(
    "keys",
    lambda keys: [v1.Binding(key=key, action=action) for key, action in keys.items()],
    lambda bindings: {one.key: one.action for one in bindings},
)
_KEY_MAP = MessageCodec(KeyMap, v1.KeyMap, {"keys": _KEY_BINDINGS})
_EPISODE_PLAN = MessageCodec(
    EpisodePlan,
    v1.EpisodePlan,
    {
        "key_map": nested("key_map", _KEY_MAP),
        "options": json_field("options_json"),
        "labels": FieldCodec(
            "labels_json",
            lambda labels: _to_json(labels) if labels else "",
            lambda text: msgspec.json.decode(text or "{}"),
        ),
        "hold": FieldCodec("hold", lambda hold: "" if hold == "once" else hold, lambda hold: hold or "once"),
    },
)
_PARTICIPANT = MessageCodec(Participant, v1.Participant, {"assigned": json_field("assigned_json", GroupAssignment)})
_SESSION_PLAN = MessageCodec(
    SessionPlan,
    v1.SessionPlan,
    {
        "participant": nested("participant", _PARTICIPANT),
        "texts": repeated("texts", MessageCodec(BlockText, v1.BlockText)),
        "episodes": repeated("episodes", _EPISODE_PLAN),
        "parts": repeated(
            "parts",
            CustomCodec(
                lambda part: v1.Part(kind=part.kind, name=part.name, plan_json=_to_json(part.plan)), _decode_part
            ),
        ),
        "words": json_field("words_json", default="{}"),
        "language": FieldCodec("language", decode=lambda language: language or ENGLISH),
        "standing": json_field("standing_json", ResumeState, default="{}"),
        "bonus": json_field("bonus_json", BonusSpec | None),
        "files": FieldCodec(
            "files",
            lambda files: [v1.ProtocolFile(name=name, content=content) for name, content in sorted(files.items())],
            lambda files: {one.name: one.content for one in files},
        ),
    },
)


def _encode_session_start(event: events.SessionStarted) -> v1.SessionPlan:
    message: v1.SessionPlan = _SESSION_PLAN.encode(event.plan)
    message.t_ns = event.t_ns
    message.facts.extend(v1.Fact(name=name, value=value) for name, value in event.facts.items())
    return message


def _decode_session_start(message: v1.SessionPlan) -> events.SessionStarted:
    facts = {fact.name: fact.value for fact in message.facts}
    return events.SessionStarted(message.t_ns, _SESSION_PLAN.decode(message), facts)


def _encode_stored_observation(event: events.ObservationStored) -> v1.Observation:
    held = encode_observation(event.observation)
    return v1.Observation(t_ns=event.t_ns, episode=event.episode, step=event.step, **held)


def _encode_pause(event: events.Paused | events.Resumed) -> v1.Pause:
    if isinstance(event, events.Paused):
        return v1.Pause(t_ns=event.t_ns, paused=True, reason=event.reason)
    return v1.Pause(t_ns=event.t_ns, paused=False)


def _decode_pause(message: v1.Pause) -> events.Paused | events.Resumed:
    if message.paused:
        return events.Paused(message.t_ns, require_one_of(get_args(events.PauseReason), message.reason))
    return events.Resumed(message.t_ns)


@dataclass(frozen=True, slots=True)
class EventRow:
    """An event, the topic that it travels on, and how.

    Args:
        event: the event's class.
        topic: the topic; its message has the event's fields.
        fields: the fields that differ on the wire.
        codec: encodes the whole event where its message has another shape.
    """

    event: type[Any]
    topic: Topic
    fields: Mapping[str, FieldCodec] = field(default_factory=dict, hash=False)
    codec: Codec | None = None


Decoder = tuple[Callable[[bytes], Message], Callable[[Any], Any]]
_DECODERS: dict[str, Decoder] = {}  # by topic; a topic of no kind is looked up again, as a plug-in may come later
_PAUSE = CustomCodec(_encode_pause, _decode_pause)
_OWN_ROWS = tuple(
    EventRow(event, topics.BY_NAME[topic], *rest)
    for event, topic, *rest in (
        (events.SessionStarted, topics.PLAN, {}, CustomCodec(_encode_session_start, _decode_session_start)),
        (events.Noted, topics.NOTE),
        (events.Paused, topics.PAUSE, {}, _PAUSE),
        (events.Resumed, topics.PAUSE, {}, _PAUSE),
        (events.KeyMapDrawn, topics.KEY_MAP, {"key_map": nested("key_map", _KEY_MAP)}),
        (
            events.EpisodeStarted,
            topics.EPISODE_START,
            {"plan": nested("plan", _EPISODE_PLAN), "map": nested("map", _MAP), "pose": nested("pose", POSE)},
        ),
        (events.KeyPressed, topics.KEY),
        (
            events.ObservationStored,
            topics.OBSERVATION,
            {},
            CustomCodec(
                _encode_stored_observation,
                lambda it: events.ObservationStored(it.t_ns, it.episode, it.step, decode_observation(it)),
            ),
        ),
        (events.Stepped, topics.STEP, {"return_": FieldCodec("episode_return"), "pose": nested("pose", POSE)}),
        (events.FrameShown, topics.FRAME),
        (events.Sampled, topics.SAMPLE),
        (events.Linked, topics.LINK),
        (events.EpisodeEnded, topics.EPISODE_END, {"return_": FieldCodec("episode_return")}),
        (events.EpisodesSkipped, topics.SKIP),
        (events.Scored, topics.POINTS),
        (events.ClauseDone, topics.CLAUSE),
        (events.PartStarted, topics.PART),
        (events.PartEnded, topics.PART_END),
        (events.PageShown, topics.PAGE),
        (events.TextTyped, topics.TEXT),
        (events.PointerUsed, topics.POINTER),
        (events.AxisMoved, topics.AXIS),
        (events.AnswerChanged, topics.ANSWER_CHANGE),
        (events.Answered, topics.ANSWER),
        (events.ModelCall, topics.MODEL_CALL),
        (
            events.DesignDecided,
            topics.DESIGN,
            {
                "options": json_field("options_json", dict[str, Any]),
                "estimates": json_field("estimates_json", dict[str, float]),
            },
        ),
        (events.SessionEnded, topics.SESSION_END),
    )
)


def encode_event(event: events.Event) -> tuple[str, Message]:
    """Name the topic of an event and put all of it into one message."""
    kind: type = type(event)
    topic, encode = _find_encoder(kind)
    return topic, encode(event)


def decode_event(topic: str, data: bytes) -> events.Event | None:
    """Read the event in a message; None for a preview, or for a topic of another program.

    Raises:
        google.protobuf.message.DecodeError: if the bytes are no such message.
        LogError: if a word in it is outside its vocabulary.
    """
    if (found := _find_decoder(topic)) is None:
        return None
    parse, decode = found
    event: events.Event = decode(parse(data))
    return event


@cache
def _find_encoder(event: type) -> tuple[str, Callable[[Any], Message]]:
    for row in _rows():
        if row.event is event:
            return row.topic.name, _codec_of_row(row).encode
    raise AssertionError(f"event {event.__name__} has no EventRow; add one to the rows of its activity kind")


def _find_decoder(topic: str) -> Decoder | None:
    decoder = _DECODERS.get(topic)
    if decoder is None:
        row = _find_row(topic)
        if row is None:
            return None
        decoder = _DECODERS[topic] = row.topic.message.FromString, _codec_of_row(row).decode
    return decoder


def _codec_of_row(row: EventRow) -> Codec:
    return row.codec or MessageCodec(row.event, row.topic.message, row.fields)


def _find_row(topic: str) -> EventRow | None:
    known = topics.BY_NAME.get(topic)
    if known is not None and known.is_preview:
        return None
    return next((row for row in _rows() if row.topic.name == topic), None)


def _rows() -> Iterator[EventRow]:
    """Every row; plug-ins are loaded only where no row of our own fits."""
    yield from _OWN_ROWS
    built_in = list_built_in_kinds()
    for kind in (*built_in, *sorted({*list_plugin_names(GROUP)} - {*built_in})):
        yield from _rows_of_kind(kind)


def _rows_of_kind(kind: str) -> tuple[EventRow, ...]:
    """A kind's rows; none where it is not installed here or cannot be loaded: its topics are then another program's."""
    try:
        return load_activity_rows(find_kind(kind))
    except (ProtocolError, ImportError):
        return ()


@cache
def load_activity_rows(kind: ActivityKind) -> tuple[EventRow, ...]:
    """Load the rows that a kind of activity names."""
    module, _, name = kind.messages.partition(":")
    if module:
        return tuple(getattr(import_module(module), name))
    return ()


def list_activity_topics(kinds: Iterable[str]) -> tuple[Topic, ...]:
    """List the topics that these kinds of activity add, each once."""
    rows = (row for kind in dict.fromkeys(kinds) for row in _rows_of_kind(kind))
    return tuple(dict.fromkeys(row.topic for row in rows))


def find_topic(topic: str) -> Topic | None:
    """Find a topic of ours or of a kind of activity; None for another program's."""
    known = topics.BY_NAME.get(topic)
    if known is None:
        row = _find_row(topic)
        known = None if row is None else row.topic
    return known


class RecordTopics:
    """The topics that hold the record, as a container: those of the session and those of every kind of activity."""

    def __contains__(self, topic: object) -> bool:
        found = find_topic(str(topic))
        return found is not None and not found.is_preview


RECORD_TOPICS = RecordTopics()


def event_cause_ns(event: events.Event) -> int:
    """When what caused an event arrived: a press, a step's key, the hand-over of a frame; else the event's own time."""
    match event:
        case events.Stepped():
            return event.key_t_ns
        case events.KeyPressed() | events.PointerUsed() | events.AxisMoved():
            return event.t_ns - event.waited_ns
        case events.FrameShown():
            return event.submit_ns
        case _:
            return event.t_ns


# One decoder per schema version, and none is ever removed. The version goes up when an older reader would misread a
# newer log; a field or topic that is only added is a minor change ("1.2"), which readers skip.
EventDecoder = Callable[[str, bytes], events.Event | None]

DECODERS: dict[int, EventDecoder] = dict.fromkeys((1, 2, 3), decode_event)  # 2 and 3: see segment_schema
assert max(DECODERS) == SCHEMA_VERSION, "every version that is written can be read"


def select_decoder(facts: Mapping[str, str], path: Path) -> EventDecoder:
    """Select the decoder of a segment's messages by the version in its metadata.

    Raises:
        LogError: if there is no version; ``NewerLogError`` if it is newer than this software.
    """
    stated = facts.get("schema_version", "none")
    number, _, minor = stated.partition(".")
    if not number.isdigit() or number == "0" or (minor and not minor.isdigit()):
        raise LogError(
            f"{path} has log schema version {stated}, which is not valid; the file is damaged or is not a session log"
        )
    reader = DECODERS.get(int(number))
    if reader is None:
        raise NewerLogError(
            f"{path} was written by a newer minihuman "
            f"({facts.get('minihuman', 'unknown')}, log schema version {stated}; this version reads up to "
            f"{max(DECODERS)}); upgrade minihuman to read it"
        )
    return reader
