"""Encodes events as protobuf messages and decodes them, by schema version; opens no file.

One table has a row for each event: its topic, and the fields that differ on the wire. All other fields are the fields
of the same name in the message. An activity kind adds rows for its own events (its ``rows`` module). ``decode_event``
undoes ``encode_event`` exactly.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any, get_args

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
from minihuman.log.field_codec import (
    Codec,
    CustomCodec,
    FieldCodec,
    MessageCodec,
    json_field,
    nested,
    repeated,
    require_one_of as require_one_of,
    to_json,
)
from minihuman.log.names import SCHEMA_VERSION
from minihuman.log.observations import decode_observation, encode_observation
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.topics import Topic
from minihuman.plugins import list_plugin_names
from minihuman.worlds.pose import Map, Pose, Thing


def _decode_part(message: v1.Part) -> PlannedPart:
    """Decode a part as its kind does; if the kind is not installed, decode plain JSON so that the log opens."""
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
    lambda bindings: {binding.key: binding.action for binding in bindings},
)
_KEY_MAP = MessageCodec(KeyMap, v1.KeyMap, {"keys": _KEY_BINDINGS})


def _encode_labels(labels: Mapping[str, Any]) -> str:
    """Encode an episode's labels as JSON; "" stands for none, as in logs older than labels."""
    if not labels:
        return ""
    return to_json(labels)


def _encode_hold(hold: str) -> str:
    """Encode the effect of a held key; "" stands for "once", as in logs older than that choice."""
    if hold == "once":
        return ""
    return hold


_EPISODE_PLAN = MessageCodec(
    EpisodePlan,
    v1.EpisodePlan,
    {
        "key_map": nested("key_map", _KEY_MAP),
        "options": json_field("options_json"),
        "labels": FieldCodec("labels_json", _encode_labels, lambda text: msgspec.json.decode(text or "{}")),
        "hold": FieldCodec("hold", _encode_hold, lambda hold: hold or "once"),
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
                lambda part: v1.Part(kind=part.kind, name=part.name, plan_json=to_json(part.plan)), _decode_part
            ),
        ),
        "words": json_field("words_json", default="{}"),
        "language": FieldCodec("language", decode=lambda language: language or ENGLISH),
        "standing": json_field("standing_json", ResumeState, default="{}"),
        "bonus": json_field("bonus_json", BonusSpec | None),
        "files": FieldCodec(
            "files",
            lambda files: [v1.ProtocolFile(name=name, content=content) for name, content in sorted(files.items())],
            lambda files: {file.name: file.content for file in files},
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
    payload = encode_observation(event.observation)
    return v1.Observation(t_ns=event.t_ns, episode=event.episode, step=event.step, **payload)


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
    """How an event is written to the log: its topic and its encoding.

    Args:
        event: the event's class.
        topic: the topic; its message has the event's fields.
        fields: the codecs of the fields that differ on the wire, by their names in the event.
        codec: the codec of the whole event, if its message has another shape; None if ``fields`` suffice.
    """

    event: type[Any]
    topic: Topic
    fields: Mapping[str, FieldCodec] = field(default_factory=dict, hash=False)
    codec: Codec | None = None


Decoder = tuple[Callable[[bytes], Message], Callable[[Any], Any]]
_DECODERS: dict[str, Decoder] = {}  # by topic; unknown topics are not cached, as a plug-in may be installed later
_PAUSE = CustomCodec(_encode_pause, _decode_pause)
_OWN_ROWS = tuple(
    EventRow(event, topics.BY_NAME[topic], *fields_and_codec)
    for event, topic, *fields_and_codec in (
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
                lambda message: events.ObservationStored(
                    message.t_ns, message.episode, message.step, decode_observation(message)
                ),
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
        (events.TextChanged, topics.ANSWER_TEXT),
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
    """Encode an event; return its topic and its message."""
    kind: type = type(event)
    topic, encode = _find_encoder(kind)
    return topic, encode(event)


def decode_event(topic: str, data: bytes) -> events.Event | None:
    """Decode the event in a message; return None for a preview, or for another program's topic.

    Raises:
        google.protobuf.message.DecodeError: if the bytes are not such a message.
        LogError: if a word in the message is outside its vocabulary.
    """
    decoder = _find_decoder(topic)
    if decoder is None:
        return None
    parse, decode = decoder
    event: events.Event = decode(parse(data))
    return event


def find_message_codec(topic: str) -> MessageCodec | None:
    """Return the codec of a topic whose messages have the fields of one event class; None for any other topic."""
    row = _find_row(topic)
    codec = None if row is None else _build_codec(row)
    if isinstance(codec, MessageCodec):
        return codec
    return None


@cache
def _find_encoder(event: type) -> tuple[str, Callable[[Any], Message]]:
    """Return the topic of an event class, and the function that encodes its events."""
    for row in _list_rows():
        if row.event is event:
            return row.topic.name, _build_codec(row).encode
    raise AssertionError(f"event {event.__name__} has no EventRow; add one to the rows of its activity kind")


def _find_decoder(topic: str) -> Decoder | None:
    """Return the functions that parse and decode a topic's messages; None for a preview or an unknown topic."""
    decoder = _DECODERS.get(topic)
    if decoder is None:
        row = _find_row(topic)
        if row is None:
            return None
        decoder = (row.topic.message.FromString, _build_codec(row).decode)
        _DECODERS[topic] = decoder
    return decoder


def _build_codec(row: EventRow) -> Codec:
    return row.codec or MessageCodec(row.event, row.topic.message, row.fields)


def _find_row(topic: str) -> EventRow | None:
    """Return the first event row of the topic with a name; None for a preview or an unknown topic."""
    session_topic = topics.BY_NAME.get(topic)
    if session_topic is not None and session_topic.is_preview:
        return None
    return next((row for row in _list_rows() if row.topic.name == topic), None)


def _list_rows() -> Iterator[EventRow]:
    """Yield every event row; plug-ins are loaded only after all built-in rows."""
    yield from _OWN_ROWS
    built_in = list_built_in_kinds()
    plugin_kinds = set(list_plugin_names(GROUP)).difference(built_in)
    for kind in (*built_in, *sorted(plugin_kinds)):
        yield from _load_rows_of_kind(kind)


def _load_rows_of_kind(kind: str) -> tuple[EventRow, ...]:
    """Return an activity kind's rows; none if the kind cannot be loaded, since its topics are then unknown."""
    try:
        return load_activity_rows(find_kind(kind))
    except (ProtocolError, ImportError):
        return ()


@cache
def load_activity_rows(kind: ActivityKind) -> tuple[EventRow, ...]:
    """Load the event rows that an activity kind defines; none if it adds no events to those of every session."""
    module, _, name = kind.messages.partition(":")
    if module:
        return tuple(getattr(import_module(module), name))
    return ()


def list_activity_topics(kinds: Iterable[str]) -> tuple[Topic, ...]:
    """Return the topics that these activity kinds add, each once."""
    rows = (row for kind in dict.fromkeys(kinds) for row in _load_rows_of_kind(kind))
    return tuple(dict.fromkeys(row.topic for row in rows))  # events can share a topic


def find_topic(topic: str) -> Topic | None:
    """Return the topic with a name, if every session or an activity kind has it; None for another program's topic."""
    session_topic = topics.BY_NAME.get(topic)
    if session_topic is not None:
        return session_topic
    row = _find_row(topic)
    return None if row is None else row.topic


class RecordTopics:
    """A container of the topics that form the record: the session's topics and those of every activity kind."""

    def __contains__(self, topic: object) -> bool:
        own_topic = find_topic(str(topic))
        return own_topic is not None and not own_topic.is_preview


RECORD_TOPICS = RecordTopics()


def event_cause_ns(event: events.Event) -> int:
    """Return the time at which the cause of an event, such as a key press, arrived; without a cause, the event's time.

    Both are nanoseconds since the segment began.
    """
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
    """Return the decoder of a segment's messages, selected by the schema version in the segment's metadata.

    Args:
        facts: the metadata at the segment's start.
        path: the log, for errors.

    Raises:
        LogError: if there is no valid version; ``NewerLogError`` if it is newer than this software.
    """
    version = facts.get("schema_version", "none")
    major, _, minor = version.partition(".")
    is_valid = major.isdigit() and major != "0" and (minor or "0").isdigit()
    if not is_valid:
        raise LogError(
            f"{path} has log schema version {version}, which is not valid; the file is damaged or is not a session log"
        )
    decoder = DECODERS.get(int(major))
    if decoder is None:
        software = facts.get("minihuman", "unknown")
        raise NewerLogError(
            f"{path} was written by a newer minihuman ({software}, log schema version {version}; this version reads up "
            f"to {max(DECODERS)}); upgrade minihuman to read it"
        )
    return decoder
