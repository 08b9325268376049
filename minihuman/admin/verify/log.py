"""Verify a whole log: not only its worlds and steps, but every message in it and that nothing was changed.

The session is replayed; each message is compared with its event (bytes, times and the previews for viewers), the plan
with the protocol's bytes, metadata and attachments with the plan, and the hash chain with all of it. The report puts
the replay of the episodes first.
"""

import hashlib
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path

import msgspec
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import Message
from mcap.records import Attachment, Metadata
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import PlayPlan
from minihuman.admin.design_decisions import decide_again, verify_design_decisions
from minihuman.admin.enrolment_entries import (
    find_incomplete_logs,
    find_slots_without_log,
    open_enrolment_log,
    read_chain_heads,
)
from minihuman.admin.erasure_ledger import find_pending_machines
from minihuman.admin.manifest import GONE, find_changed_files
from minihuman.admin.policies import verify_advice
from minihuman.admin.session_index import find_double_sessions
from minihuman.admin.unfinished_withdrawals import find_unfinished_withdrawals
from minihuman.admin.verify.episodes import describe_other_rules, verify_episodes
from minihuman.admin.verify.shown_pictures import verify_pictures
from minihuman.dataset.annotations import describe_useless_annotation, read_annotations, split_annotations
from minihuman.dataset.withdrawn_codes import read_withdrawn_codes
from minihuman.display.text import is_division
from minihuman.errors import LogError, MinihumanError
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import (
    EpisodeEnded,
    EpisodesSkipped,
    Event,
    ModelCall,
    SessionEnded,
    SessionStarted,
    Stepped,
)
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.expansion import expand_protocol
from minihuman.experiment.plan.part_plans import find_paged_text
from minihuman.experiment.plan.participant_codes import parse_participant_code
from minihuman.experiment.plan.session_plan import EpisodePlan, PlannedPart, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.experiment.protocol.strata import build_strata
from minihuman.experiment.replay import MACHINE_VERSION, compare_replay
from minihuman.log import integrity, names as log_names, topics
from minihuman.log.codec import EventDecoder, encode_event, event_cause_ns, find_topic, select_decoder
from minihuman.log.evidence import find_evidence
from minihuman.log.integrity import METADATA_PREFIX, HashChain, SegmentHead
from minihuman.log.model.doubtful_presses import describe_doubtful_presses, find_doubtful_presses
from minihuman.log.names import CHAIN_KEY
from minihuman.log.paths import (
    LOG_SUFFIX,
    PART_SUFFIX,
    SYSTEM_COMPANION,
    find_log_folders,
    find_system_companions,
    group_sessions,
    raise_as_log_error,
    study_folder,
)
from minihuman.log.preview import PreviewEncoder
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.session_reader import list_session_files, read_log
from minihuman.log.record.live_log import build_attachments, build_segment_metadata
from minihuman.log.salvage.records import ChunkMessages, LogMessage
from minihuman.log.salvage.scan import LogScanner
from minihuman.log.salvage.summary_section import read_summary
from minihuman.simulation.model_conversation import ConversationRecord, find_picture_size
from minihuman.trust import Trust, find_changed_sources, list_foreign_modules
from minihuman.worlds.adapters.world import World
from minihuman.worlds.hashing import resolve_files
from minihuman.worlds.isolation.isolated_world import IsolatedWorlds

_FOR_VIEWERS = frozenset(topic.name for topic in topics.TOPICS if topic.is_preview)


class MessageVerifier:
    """Takes a segment's messages in their order.

    Args:
        started_ns: the wall clock at the segment's time 0.
        decode: reads its messages.
        live: it is of a live file, in which nothing is repeated for viewers yet.
    """

    def __init__(self, started_ns: int, decode: EventDecoder, *, live: bool) -> None:
        self._started_ns = started_ns
        self._decode = decode
        self._live = live
        self._previews = PreviewEncoder(started_ns)
        self._drawn: list[LogMessage] = []  # for viewers, since the last message that holds the truth
        self._last: LogMessage | None = None  # of those

    def check(self, message: LogMessage, schema: str) -> tuple[Event | None, list[str]]:
        """The event in a message, None in one for viewers; and what of it is not as minihuman writes it."""
        topic = message.channel.topic
        if topic in _FOR_VIEWERS:
            self._drawn.append(message)
            self._previews.is_pose_per_step |= schema == PoseInFrame.DESCRIPTOR.full_name
            return None, []
        drawn = self._drawn
        self._drawn = []
        self._last = message
        where = f"message {message.sequence} on {topic}"
        try:
            event = self._decode(topic, message.data)
        except Exception as error:  # a changed message can make protobuf raise anything
            return None, [f"{where} cannot be read: {error}"]
        if event is None:
            return None, [f"{where} says nothing"]
        wrong = []
        again, encoded = encode_event(event)
        if again != topic or not _is_as_written(encoded, message.data):
            wrong.append(f"{where} is not as it is written")
        if message.log_time != self._started_ns + event.t_ns:
            wrong.append(f"{where}: log time {message.log_time}, by its own time {self._started_ns + event.t_ns}")
        if message.publish_time != self._started_ns + event_cause_ns(event):
            wrong.append(f"{where}: publish time {message.publish_time} is not when it was caused")
        expected = list(self._previews.encode(topic, message.data))
        return event, wrong + self._compare(expected, message, drawn, where)

    def left(self) -> list[str]:
        """What is for viewers at the end: the poses of an episode that was cut off, and nothing else."""
        if self._last is None:
            return [f"a message on {message.channel.topic} repeats nothing" for message in self._drawn]
        return self._compare(list(self._previews.finish()), self._last, self._drawn, "the segment's end")

    def _compare(
        self, expected: list[tuple[str, Message]], message: LogMessage, drawn: list[LogMessage], where: str
    ) -> list[str]:
        if self._live and not drawn:
            return []
        if [topic for topic, _ in expected] != [other.channel.topic for other in drawn]:
            found = ", ".join(other.channel.topic for other in drawn) or "none"
            return [f"{where} is repeated for viewers on {found}; it should be on {[topic for topic, _ in expected]}"]
        wrong = []
        for (topic, again), other in zip(expected, drawn, strict=True):
            times = (other.sequence, other.log_time, other.publish_time)
            same = times == (0, message.log_time, message.publish_time)
            if not same or not _bytes_match(topic, again.SerializeToString(deterministic=True), other.data):
                wrong.append(f"{where}: its copy for viewers on {topic} is another")
        return wrong


def _is_as_written(again: Message, logged: bytes) -> bool:
    """Tell whether a message is as minihuman writes it, or wrote it: a plan may lack fields that parts got since."""
    if again.SerializeToString(deterministic=True) == logged:
        return True
    if not isinstance(again, v1.SessionPlan):
        return False
    for part, logged_part in zip(again.parts, v1.SessionPlan.FromString(logged).parts, strict=False):
        part.plan_json = _without_later_defaults(part.plan_json, logged_part.plan_json)
    return again.SerializeToString(deterministic=True) == logged


def _without_later_defaults(plan_json: str, logged_json: str) -> str:
    """Return a part's plan, as read from the logged one, without the fields that reading added with their defaults."""
    plan = msgspec.json.decode(plan_json)
    logged = msgspec.json.decode(logged_json)
    if not isinstance(plan, dict) or not isinstance(logged, dict):
        return plan_json
    return msgspec.json.encode({name: value for name, value in plan.items() if name in logged}).decode()


def _bytes_match(topic: str, again: bytes, found: bytes) -> bool:
    """Whether two messages show the same; another version of a library may compress a picture differently."""
    if again == found or topic not in (topics.MAP_IMAGE, topics.OBSERVATION_IMAGE):
        return again == found
    try:
        if _without_picture(again) != _without_picture(found):
            return False
        expected = _picture(again)
        logged = _picture(found)
        if topic == topics.MAP_IMAGE:  # Pillow 10 and 12 put the outline of a disc on different pixels
            return _differ_by_a_pixel(expected, logged)
        return bool((expected == logged).all())
    except Exception:  # what is no picture
        return False


def _differ_by_a_pixel(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """Whether two drawings [H, W, 3] are the same but for edges that lie up to one pixel apart."""
    return one.shape == other.shape and _lies_within(one, other) and _lies_within(other, one)


def _lies_within(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """Whether each pixel of one has a colour between those of the other within one pixel of it."""
    drawing = Image.fromarray(other)
    low, high = (np.asarray(drawing.filter(filters(3))) for filters in (ImageFilter.MinFilter, ImageFilter.MaxFilter))
    return bool(((low <= one) & (one <= high)).all())


def _without_picture(data: bytes) -> bytes:
    message = CompressedImage.FromString(data)
    message.data = b""
    return message.SerializeToString(deterministic=True)


def _picture(data: bytes) -> NDArray[np.uint8]:
    return np.array(Image.open(io.BytesIO(CompressedImage.FromString(data).data)))


_KNOWN = (
    log_names.SEGMENT_METADATA,
    log_names.FACTS_METADATA,
    log_names.END_METADATA,
    log_names.MISSING_METADATA,
    log_names.REPAIRED_METADATA,
)
_ONCE_PER_PLAN = ("first_episode", "segment", "standing")  # what a resumed session changes in its plan


@dataclass(slots=True)
class _LogSegment:
    facts: dict[str, str]
    station: dict[str, str] | None = None
    end: dict[str, str] | None = None
    events: list[Event] = field(default_factory=list)
    last_sequence: int = 0
    last_ns: int = 0
    first_ns: int = 0
    head: str = ""  # of the chain, at its end

    @property
    def number(self) -> str:
        return self.facts.get("segment", "?")

    @property
    def started(self) -> SessionStarted | None:
        """Its plan and facts; None where they are missing."""
        first = self.events[0] if self.events else None
        return first if isinstance(first, SessionStarted) else None

    @property
    def provable(self) -> bool:
        """Whether it was recorded by the session machine's present rules, and so by all that is checked here."""
        return self.facts.get("session_rules") == str(MACHINE_VERSION)


@dataclass(slots=True)
class _LogContents:
    segments: list[_LogSegment] = field(default_factory=list)
    finished: bool = False
    attached: list[Attachment] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)
    plans: list[bytes] = field(default_factory=list)  # the messages
    copies: list[bytes] = field(default_factory=list)  # of those, in the second copies of the segments' starts


def find_log_differences(path: Path, make_world: WorldFactory) -> Iterator[str]:
    """Yield everything in a log that does not follow from the rest of it; nothing for a log that is proven.

    Segments of before there were session rules and a chain are left to ``verify``.

    Raises:
        LogError: if the log cannot be read.
        WorldError: if a world of its plan cannot be made here.
    """
    found = _read(path)
    yield from found.complaints
    if not any(segment.provable for segment in found.segments):
        return
    yield from _attachments(found)
    for number, segment in enumerate(found.segments):
        if segment.provable:
            where = f"segment {segment.number}"
            for complaint in (
                *_metadata(segment, number),
                *_end(segment, found.segments[: number + 1], finished=found.finished),
                *_plan(segment),
                *(f"well-formed: {rule}" for rule in find_violations(segment.events)),
                *_replay(segment, make_world),
            ):
                yield f"{where}: {complaint}"
    known = read_chain_heads(study_folder(path), path.name)
    for segment in found.segments:
        chain = (segment.end or {}).get(CHAIN_KEY, "")
        if segment.end is not None and known.get(segment.number, chain) != chain:
            yield (
                f"segment {segment.number} ended with chain {chain[:16]}; the enrolment log says "
                f"{known[segment.number][:16]}"
            )


def _replay(segment: _LogSegment, make_world: WorldFactory) -> Iterator[str]:
    """Compare with a replay; where a model sat, also every prompt, its picture and how each answer was read.

    A world that failed may end its process, or run without end: it is replayed in a process of its own.
    """
    if segment.events and isinstance(end := segment.events[-1], SessionEnded) and end.reason == "world_error":
        worlds = IsolatedWorlds(make_world)
        try:
            yield from _compare_segment(segment, worlds)
        finally:
            worlds.close()
        return
    yield from _compare_segment(segment, make_world)


def _compare_segment(segment: _LogSegment, make_world: WorldFactory) -> Iterator[str]:
    started = segment.started
    if started is None or not any(isinstance(event, ModelCall) for event in segment.events):
        yield from compare_replay(segment.events, make_world)
        return
    spec = decode_logged_protocol(started.plan.protocol_toml).model
    picture_px = find_picture_size(spec)
    yield from compare_replay(segment.events, make_world, follow=ConversationRecord(spec).follow, picture_px=picture_px)


def _read(path: Path) -> _LogContents:
    """Everything of a log, with what is wrong with single records."""
    found = _LogContents()
    scan = LogScanner(path)
    chain = HashChain()
    proof: MessageVerifier | None = None
    for record in scan:
        match record:
            case Metadata():
                chain.metadata(record)
                if record.name == log_names.SEGMENT_METADATA:
                    found.complaints += proof.left() if proof else ()
                    found.segments.append(_LogSegment(record.metadata))
                    decode: EventDecoder = select_decoder(record.metadata, path)
                    proof = None
                elif not record.name.startswith(METADATA_PREFIX):
                    continue
                elif record.name not in _KNOWN or not found.segments:
                    found.complaints.append(f"metadata {record.name} is none that minihuman writes there")
                elif record.name == log_names.FACTS_METADATA:
                    if found.segments[-1].station is not None:
                        found.complaints.append(f"metadata {record.name} is there twice")
                    found.segments[-1].station = record.metadata
                elif record.name == log_names.END_METADATA:
                    if found.segments[-1].end is not None:
                        found.complaints.append(f"metadata {record.name} is there twice")
                    found.segments[-1].end, found.segments[-1].head = record.metadata, chain.head
                elif record.name == log_names.MISSING_METADATA:
                    gap = record.metadata
                    found.complaints.append(
                        f"segment {gap.get('segment')}: messages {gap.get('first')} to {gap.get('last')} are missing: "
                        "they were lost to damage"
                    )
            case Attachment() if record.name == integrity.SEGMENT_HEAD_NAME:
                with suppress(ValueError):
                    copied = ChunkMessages(SegmentHead.of(record.data).records, scan.channels)
                    found.copies += (message.data for message in copied)
            case Attachment():
                chain.attachment(record)
                found.attached.append(record)
            case LogMessage() if find_topic(record.channel.topic) is not None:
                schema = scan.schemas.get(record.channel.schema_id)
                chain.message(record, schema)
                segment = found.segments[-1]
                if segment.end is not None:
                    found.complaints.append(f"a message on {record.channel.topic} lies behind the end of its segment")
                segment.first_ns = segment.first_ns or record.log_time
                segment.last_ns = max(segment.last_ns, record.log_time)
                if not segment.provable:
                    continue
                proof = proof or MessageVerifier(
                    int(segment.facts["started_unix_ns"]), decode, live=path.name.endswith(PART_SUFFIX)
                )
                if record.channel.topic == topics.PLAN:
                    found.plans.append(record.data)
                event, wrong = proof.check(record, "" if schema is None else schema.name)
                found.complaints += (f"segment {segment.number}: {complaint}" for complaint in wrong)
                if event is not None:
                    segment.events.append(event)
                    segment.last_sequence = record.sequence
    found.finished = scan.finished
    found.complaints += proof.left() if proof else ()
    if found.copies != found.plans and all(segment.provable for segment in found.segments):
        found.complaints.append(
            f"attachment {integrity.SEGMENT_HEAD_NAME} is not a copy of the plan, or not there once a segment"
        )
    return found


def _attachments(found: _LogContents) -> Iterator[str]:
    """Hold the attachments against the plans: all that belong there are, once, and no other of ours."""
    plans = [segment.started.plan for segment in found.segments if segment.started]
    expected = {
        (name, content) for plan in plans for name, _, content in build_attachments(plan) if name != "packages.txt"
    }
    names = {name for plan in plans for name, *_ in build_attachments(plan)}
    seen = Counter((attached.name, attached.data) for attached in found.attached if attached.name in names)
    for attached, count in seen.items():
        if count > 1:
            yield f"attachment {attached[0]} is there twice"
        if attached[0] != "packages.txt" and attached not in expected and all(s.provable for s in found.segments):
            yield f"attachment {attached[0]} is not what the plan says"
    there = {name for name, _ in seen}
    for name in sorted(names - there):
        yield f"attachment {name} is missing"
    for name, content in expected - set(seen):
        if name in there:
            yield f"attachment {name} of {len(content)} bytes is missing"


def _metadata(segment: _LogSegment, number: int) -> Iterator[str]:
    started = segment.started
    if started is None:
        yield "its plan is missing"
        return
    expected = build_segment_metadata(started.plan, int(segment.facts["started_unix_ns"]))
    for name in sorted({*expected, *segment.facts} - {"minihuman", "schema_version"}):  # of what wrote it
        if expected.get(name) != segment.facts.get(name):
            yield (
                f"metadata {log_names.SEGMENT_METADATA}: {name} {segment.facts.get(name)!r}, "
                f"by the plan {expected.get(name)!r}"
            )
    if segment.station != started.facts:
        yield f"metadata {log_names.FACTS_METADATA} is not what the plan's message says"


def _end(segment: _LogSegment, so_far: Sequence[_LogSegment], *, finished: bool) -> Iterator[str]:
    """Hold what a segment's end says against what is in it."""
    end = segment.end
    if end is None:
        if finished:
            yield f"metadata {log_names.END_METADATA} is missing"
        return
    if end.get(CHAIN_KEY) != segment.head:
        logged = end.get(CHAIN_KEY, "none")
        yield f"the hash chain is {segment.head[:16]}, its end says {logged[:16]}: something was changed"
    if segment.events and isinstance(segment.events[-1], SessionEnded):
        ended = segment.events[-1]
    else:
        ended = None
    completed = {
        event.episode
        for earlier in so_far
        for event in earlier.events
        if isinstance(event, EpisodeEnded) and event.outcome != "abandoned"
    }
    skipped = sum(event.count for earlier in so_far for event in earlier.events if isinstance(event, EpisodesSkipped))
    expected = {
        "segment": segment.number,
        "reason": ended.reason if ended else "cut_off",
        "steps": str(sum(isinstance(event, Stepped) for event in segment.events)),
        "last_message": str(segment.last_sequence),
        "planned": str(len(segment.started.plan.episodes) - skipped if segment.started else 0),
        "lasted_ns": str(segment.last_ns - segment.first_ns),
    }
    if all(earlier.provable for earlier in so_far):
        expected["completed"] = str(len(completed))
    for name, value in expected.items():
        if end.get(name) != value:
            yield f"metadata {log_names.END_METADATA}: {name} {end.get(name)!r}, by the messages {value!r}"
    if end.get("clean") not in ("true", "false") or (end.get("clean") == "true" and not ended):
        yield f"metadata {log_names.END_METADATA}: clean {end.get('clean')!r}, but the segment says no end"
    stopped = end.get("stopped", "")
    if stopped.startswith(log_names.FINISHED_LOG_WAS):
        yield stopped
    elif stopped and not stopped.startswith("cut off"):
        yield f"its live file was damaged: {stopped}"


def _plan(segment: _LogSegment) -> Iterator[str]:
    """Hold a plan against the protocol that it was made of."""
    if segment.started is None:
        return
    plan = segment.started.plan
    if hashlib.sha256(plan.protocol_toml).hexdigest() != plan.protocol_sha256:
        yield "plan: protocol_sha256 is not the protocol's"
    try:
        protocol = decode_logged_protocol(plan.protocol_toml)
        protocol = msgspec.structs.replace(protocol, files=_page_pictures(protocol, plan) | plan.files)
        again = expand_protocol(
            protocol,
            plan.participant,
            session=plan.session,
            overridden=plan.overridden,
            outcome_rules=plan.outcome_rules,
        )
        yield from _slot(protocol, segment, plan)
        if parse_participant_code(plan.participant.id) != plan.participant.index:
            yield f"plan: participant {plan.participant.id} is at index {plan.participant.index}"
    except MinihumanError as error:
        yield f"plan: {error}"
        return
    for name in SessionPlan.__struct_fields__:
        logged = getattr(plan, name)
        now = getattr(again, name)
        if name == "parts":
            now = tuple(_as_part_before(protocol, plan, *parts) for parts in zip_longest(now, logged))
        if name == "words":  # a language has got more of them since
            now = {key: text for key, text in now.items() if key in logged}
        if name == "episodes":
            now = tuple(_as_planned_before(episode, before) for episode, before in zip_longest(now, logged))
        if name not in _ONCE_PER_PLAN and logged != now:
            yield f"plan: {name} is not what the protocol gives"


def _page_pictures(protocol: Protocol, plan: SessionPlan) -> dict[str, bytes]:
    """The pictures of pages by the names that the protocol has for them; the log holds them page by page."""
    named = [(part.plan, protocol.page_for(part.name, plan.participant.group)) for part in plan.parts]
    logo = protocol.study.logo
    return {
        name: picture
        for pages, page in named
        if isinstance(pages, PagePlan)
        for name, picture in zip((page and page.images) or (logo,), pages.pictures, strict=False)
    }


def _as_part_before(
    protocol: Protocol, plan: SessionPlan, part: PlannedPart | None, logged: PlannedPart | None
) -> PlannedPart | None:
    """Return a planned part as it was planned when the logged one was: divided into those pages, with those fields."""
    if part is None or logged is None or part.name != logged.name:
        return part
    return _without_later_fields(_divided_as_before(protocol, plan, part, logged), logged)


def _divided_as_before(protocol: Protocol, plan: SessionPlan, part: PlannedPart, logged: PlannedPart) -> PlannedPart:
    """Take over the logged pages of a plan from before there were rules of pagination, if they are the whole text.

    Pages were measured by the fonts and the libraries of the machine then, so no other machine can find them again.
    """
    match part.plan, logged.plan:
        case PagePlan(), PagePlan(pages=pages, pagination=msgspec.UNSET) as page:
            pictures = len(page.pictures) or bool(page.example)
            divided = {"pages": pages, "pagination": msgspec.UNSET}
        case PlayPlan(), PlayPlan(instruction=pages, pagination=msgspec.UNSET) if pages:
            pictures = 0
            divided = {"instruction": pages, "pagination": msgspec.UNSET}
        case _:
            return part
    text = find_paged_text(protocol, part.name, plan.participant.group)
    if text is None or not is_division(pages, text, pictures=pictures):
        return part
    return msgspec.structs.replace(part, plan=msgspec.structs.replace(part.plan, **divided))


def _without_later_fields(part: PlannedPart, logged: PlannedPart) -> PlannedPart:
    """Return a planned part without what plans did not say yet when the logged one was made."""
    if not isinstance(part.plan, PlayPlan) or not isinstance(logged.plan, PlayPlan):
        return part
    if logged.plan.computed == "page":
        return part
    # the server computed all first-person worlds, before that nothing was said
    return msgspec.structs.replace(part, plan=msgspec.structs.replace(part.plan, computed=logged.plan.computed))


def _as_planned_before(episode: EpisodePlan | None, logged: EpisodePlan | None) -> EpisodePlan | None:
    """A planned episode as plans were: with images and labels in its options, and first-person worlds by the host's
    sine alone.
    """
    if episode is None or logged is None:
        return episode
    options = {k: v for k, v in episode.options.items() if k != "trig" or k in logged.options}
    if options.get("image") == logged.options.get("image"):
        held = options
    else:
        held = resolve_files(options)
    if not logged.labels and not set(episode.labels).isdisjoint(logged.options):
        return msgspec.structs.replace(episode, options=held | episode.labels, labels={})
    return msgspec.structs.replace(episode, options=held)


def _slot(protocol: Protocol, segment: _LogSegment, plan: SessionPlan) -> Iterator[str]:
    """Hold group and stratum against the allocation list, and the stratum against the answer."""
    who = plan.participant
    slots = build_allocation_list(protocol)
    if not 0 <= who.place < len(slots):
        yield f"plan: slot {who.place} is outside the allocation list of {len(slots)}"
        return
    slot = slots[who.place]
    if who.assigned is not None and protocol.allocation.design is not None:
        again = decide_again(protocol, who.assigned, who.index, who.stratum).group
        if again != who.group:
            yield f"plan: participant's group {who.group!r}, by the statistics of {who.assigned.design} {again!r}"
    elif (who.assigned is None) == (protocol.allocation.design is not None) and not plan.overridden:
        yield "plan: the group's assignment is not by the protocol's design"
    elif not plan.overridden and slot.group != who.group:
        yield f"plan: participant's group {who.group!r}, in the allocation list {slot.group!r}"
    if slot.stratum != who.stratum:
        yield f"plan: participant's stratum {who.stratum!r}, in the allocation list {slot.stratum!r}"
    strata = build_strata(protocol)
    if strata is None or plan.session > 1 or plan.segment > 1:
        return
    answered = strata.find_stratum(segment.events)
    if answered not in (None, who.stratum):
        yield f"plan: participant's stratum {who.stratum!r}, by the answer to {strata.question} {answered!r}"


MAX_DIFFERENCES = 20  # of differences, a log


def find_studies(given: Path) -> list[Path]:
    """Find the folders with an enrolment log: this one, or those in it."""
    if not given.is_dir():
        return []
    if open_enrolment_log(given).begun:
        return [given]
    return sorted(path for path in given.iterdir() if path.is_dir() and open_enrolment_log(path).begun)


def find_sessions(given: Path, *, required: bool = True) -> list[Path]:
    """Where the sessions of a folder, or of all folders in it, are: log by log; a folder where one is in several files.

    Raises:
        LogError: if there is none, although one is required.
    """
    if not given.is_dir():
        return [given]
    found: list[Path] = []
    for folder, names in find_log_folders(given):
        sessions = list(group_sessions(folder, names).values())
        alone = len(sessions) == 1
        found += [folder] if alone and len(sessions[0]) > 1 else [file for files in sessions for file in files]
    if not found and required:
        raise LogError(
            f"{given} contains no session logs (*{LOG_SUFFIX} or *{PART_SUFFIX}); name a log or a study's folder"
        )
    return sorted(found)


def verify_session(log: Path, *, trust: bool = False, policies: bool = False) -> Iterator[tuple[str, bool]]:
    """Yield lines on a session, each with whether it is good news; with ``policies`` on what its agents thought, too.

    ``log`` is a log, or the folder of the one session that is in it, in as many files as it may be. With ``trust`` the
    modules of its worlds are trusted from now on.

    Raises:
        LogError: if the log cannot be read, or the file of a policy.
        WorldError: if a world of it cannot be made here, or is in a module that is not trusted.
    """
    session = read_log(log)
    if trust:
        Trust(modules=list_foreign_modules(episode.plan.world for episode in session.episodes)).record()
    if other := describe_other_rules(session):
        yield other, True
    with raise_as_log_error(log, "played again"):
        steps = verify_episodes(session)
        pictures = None if steps.difference else verify_pictures(session)
    for module in find_changed_sources(session.facts):
        yield f"recorded with another file of the module {module}", True
    if steps.difference:
        yield steps.difference, False
    if warning := describe_doubtful_presses(find_doubtful_presses(session)):
        yield warning, True
    if steps.n_other_renderer:
        yield (
            f"{steps.n_other_renderer} episodes with an earlier renderer's pictures: these are not compared",
            True,
        )
    differences: list[str] = []
    for file in list_session_files(log):
        with raise_as_log_error(file, "proven"):
            differences += find_log_differences(file, World)
    for difference in differences[:MAX_DIFFERENCES]:
        yield difference, False
    if len(differences) > MAX_DIFFERENCES:
        yield f"and {len(differences) - MAX_DIFFERENCES} more", False
    if policies:
        yield from verify_advice(session, World)
    if find_evidence(session.facts) == "consistent":
        yield "imported from a page: consistent, not witnessed", True
    _, useless = split_annotations(session, read_annotations(session.path))
    yield from ((describe_useless_annotation(annotation), False) for annotation in useless)
    if pictures is not None:
        yield str(pictures), pictures.verdict != "different"
    if not steps.difference and not differences:
        yield f"{steps.episodes} episodes, {steps.steps} steps, all as logged", True


def verify_enrolment(study: Path) -> Iterator[tuple[str, bool]]:
    """Compare a study's enrolment log with its session logs; yield lines, each with whether it is good news.

    Each chain head has its log, each segment of a finished log its chain head, and each slot that was taken a log. No
    session was completed twice.

    Raises:
        LogError: if a line of the enrolment log is damaged.
    """
    folders = list(find_log_folders(study))
    yield from ((f"skipped {path.name}: {SYSTEM_COMPANION}", True) for path in find_system_companions(folders))
    yield from ((double, False) for double in find_double_sessions(folders))
    yield from ((pending, False) for pending in find_pending_machines(study))
    journal = open_enrolment_log(study)
    if not journal.begun:
        return
    sessions = [one for folder, names in folders for one in group_sessions(folder, names).items()]
    ends = {log.name: _read_ends(log) for log, files in sessions if log in files}
    yield from find_incomplete_logs(journal.read(), ends)
    yield from find_slots_without_log(journal.read(), {log.name.partition("_")[0] for log, _ in sessions})
    for unfinished in find_unfinished_withdrawals(study):
        yield unfinished, False
    if protocol := _read_protocol(log for log, files in sessions if log in files):
        yield from verify_design_decisions(study, protocol)
    if journal.unchained:
        yield f"{journal.unchained} lines of the enrolment log are unchained: an earlier version wrote them", True


def _read_protocol(sessions: Iterable[Path]) -> Protocol | None:
    """The protocol of a study's first log, where it has designs of the study; None if there is none."""
    for log in sessions:
        protocol = decode_logged_protocol(read_log(log).plan.protocol_toml)
        if protocol.allocation.design or protocol.allocation.stopping:
            return protocol
        return None
    return None


def _read_ends(log: Path) -> tuple[str, ...]:
    """The segments of a log that have a chain head; none of a log that cannot be read."""
    found = read_summary(log)
    if found is not None:
        return tuple(end["segment"] for end in found.ends if CHAIN_KEY in end)
    return ()


def verify_manifest(study: Path, seal: str) -> Iterator[tuple[str, bool]]:
    """Yield lines on a sealed study, each with whether it is good news.

    Raises:
        LogError: if the seal is none.
    """
    withdrawn = read_withdrawn_codes(study)
    by_code: Counter[str] = Counter()
    changes: list[str] = []
    for line in find_changed_files(study, seal):
        code = line.partition("/")[0]
        if code in withdrawn and line.endswith(GONE):
            by_code[code] += 1
        else:
            changes.append(line)
    for code, files in sorted(by_code.items()):
        yield f"{files} files of {code} are gone: {code} withdrew after the manifest was made", True
    yield from ((line, False) for line in changes)
    if not changes:
        yield f"every {'other ' if by_code else ''}file is as it was sealed", True
