"""The whole proof of a log: not only its worlds and steps, but everything around them, and that nothing was changed.

``verify`` plays the episodes again; this here plays the session again, holds every message against the event in it, the
plan against the protocol's bytes, metadata and attachments against the plan, and the hash chain against all of it.
"""

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Attachment, Metadata

from minihuman.errors import MinihumanError
from minihuman.lab.prove_messages import MessageProof
from minihuman.lab.register_lines import sealed_heads
from minihuman.log import segment_head, topics
from minihuman.log.chain import HEAD, OURS, Chain
from minihuman.log.kinds import known
from minihuman.log.paths import PART_SUFFIX, study_folder
from minihuman.log.read.chunk import LogMessage, Messages
from minihuman.log.read.scan import Scan
from minihuman.log.record.live_file import attachments, segment_facts
from minihuman.log.segment_head import SegmentHead
from minihuman.log.versions import Decode, reader_for
from minihuman.study.again import RULES, differences
from minihuman.study.allocation import allocation
from minihuman.study.events import EpisodeEnded, EpisodesSkipped, Event, SessionEnded, SessionStarted, Stepped
from minihuman.study.expand import expand, participant_index
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Protocol, decode_logged
from minihuman.study.stage import MakeWorld
from minihuman.study.strata import strata_of
from minihuman.study.well_formed import complaints

_KNOWN = (
    topics.SEGMENT_METADATA,
    topics.FACTS_METADATA,
    topics.END_METADATA,
    topics.MISSING_METADATA,
    topics.REPAIRED_METADATA,
)
_ONCE_PER_PLAN = ("first_episode", "segment", "standing")  # what a resumed session changes in its plan


@dataclass(slots=True)
class _Segment:
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
        return self.facts.get("session_rules") == str(RULES)


@dataclass(slots=True)
class _Found:
    segments: list[_Segment] = field(default_factory=list)
    finished: bool = False
    attached: list[Attachment] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)
    plans: list[bytes] = field(default_factory=list)  # the messages
    copies: list[bytes] = field(default_factory=list)  # of those, in the second copies of the segments' starts


def prove(path: Path, make_world: MakeWorld) -> Iterator[str]:
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
                *(f"well-formed: {rule}" for rule in complaints(segment.events)),
                *differences(segment.events, make_world),
            ):
                yield f"{where}: {complaint}"
    last = found.segments[-1]
    known = sealed_heads(study_folder(path), path.name).get(last.number)
    if known is not None and last.end is not None and known != last.end.get(HEAD):
        yield f"the register says that the log ended with chain {known[:16]}, not {last.end.get(HEAD, '')[:16]}"


def _read(path: Path) -> _Found:
    """Everything of a log, with what is wrong with single records."""
    found, scan, chain = _Found(), Scan(path), Chain()
    proof: MessageProof | None = None
    for record in scan:
        match record:
            case Metadata():
                chain.metadata(record)
                if record.name == topics.SEGMENT_METADATA:
                    found.complaints += proof.left() if proof else ()
                    found.segments.append(_Segment(record.metadata))
                    decode: Decode = reader_for(record.metadata, path)
                    proof = None
                elif not record.name.startswith(OURS):
                    continue
                elif record.name not in _KNOWN or not found.segments:
                    found.complaints.append(f"metadata {record.name} is none that minihuman writes there")
                elif record.name == topics.FACTS_METADATA:
                    if found.segments[-1].station is not None:
                        found.complaints.append(f"metadata {record.name} is there twice")
                    found.segments[-1].station = record.metadata
                elif record.name == topics.END_METADATA:
                    if found.segments[-1].end is not None:
                        found.complaints.append(f"metadata {record.name} is there twice")
                    found.segments[-1].end, found.segments[-1].head = record.metadata, chain.head
                elif record.name == topics.MISSING_METADATA:
                    gap = record.metadata
                    found.complaints.append(
                        f"segment {gap.get('segment')}: messages {gap.get('first')} to {gap.get('last')} are missing: "
                        "they were lost to damage"
                    )
            case Attachment() if record.name == segment_head.NAME:
                with suppress(ValueError):
                    copied = Messages(SegmentHead.of(record.data).records, scan.channels)
                    found.copies += (message.data for message in copied)
            case Attachment():
                chain.attachment(record)
                found.attached.append(record)
            case LogMessage() if known(record.channel.topic) is not None:
                schema = scan.schemas.get(record.channel.schema_id)
                chain.message(record, schema)
                segment = found.segments[-1]
                if segment.end is not None:
                    found.complaints.append(f"a message on {record.channel.topic} lies behind the end of its segment")
                segment.first_ns = segment.first_ns or record.log_time
                segment.last_ns = max(segment.last_ns, record.log_time)
                if not segment.provable:
                    continue
                proof = proof or MessageProof(
                    int(segment.facts["started_unix_ns"]), decode, live=path.name.endswith(PART_SUFFIX)
                )
                if record.channel.topic == topics.PLAN:
                    found.plans.append(record.data)
                event, wrong = proof.check(record)
                found.complaints += (f"segment {segment.number}: {complaint}" for complaint in wrong)
                if event is not None:
                    segment.events.append(event)
                    segment.last_sequence = record.sequence
    found.finished = scan.finished
    found.complaints += proof.left() if proof else ()
    if found.copies != found.plans and all(segment.provable for segment in found.segments):
        found.complaints.append(
            f"attachment {segment_head.NAME} is not a copy of the plan, or not there once a segment"
        )
    return found


def _attachments(found: _Found) -> Iterator[str]:
    """Hold the attachments against the plans: all that belong there are, once, and no other of ours."""
    plans = [segment.started.plan for segment in found.segments if segment.started]
    expected = {(name, content) for plan in plans for name, _, content in attachments(plan) if name != "packages.txt"}
    names = {name for plan in plans for name, *_ in attachments(plan)}
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


def _metadata(segment: _Segment, number: int) -> Iterator[str]:
    started = segment.started
    if started is None:
        yield "its plan is missing"
        return
    expected = segment_facts(started.plan, int(segment.facts["started_unix_ns"]))
    for name in sorted({*expected, *segment.facts} - {"minihuman"}):  # which version wrote it
        if expected.get(name) != segment.facts.get(name):
            yield (
                f"metadata {topics.SEGMENT_METADATA}: {name} {segment.facts.get(name)!r}, "
                f"by the plan {expected.get(name)!r}"
            )
    if segment.station != started.facts:
        yield f"metadata {topics.FACTS_METADATA} is not what the plan's message says"


def _end(segment: _Segment, so_far: Sequence[_Segment], *, finished: bool) -> Iterator[str]:
    """Hold what a segment's end says against what is in it."""
    end = segment.end
    if end is None:
        if finished:
            yield f"metadata {topics.END_METADATA} is missing"
        return
    if end.get(HEAD) != segment.head:
        yield f"the hash chain is {segment.head[:16]}, its end says {end.get(HEAD, 'none')[:16]}: something was changed"
    ended = segment.events[-1] if segment.events and isinstance(segment.events[-1], SessionEnded) else None
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
            yield f"metadata {topics.END_METADATA}: {name} {end.get(name)!r}, by the messages {value!r}"
    if end.get("clean") not in ("true", "false") or (end.get("clean") == "true" and not ended):
        yield f"metadata {topics.END_METADATA}: clean {end.get('clean')!r}, but the segment says no end"
    stopped = end.get("stopped", "")
    if stopped.startswith(topics.FINISHED_LOG_WAS):
        yield stopped
    elif stopped and not stopped.startswith("cut off"):
        yield f"its live file was damaged: {stopped}"


def _plan(segment: _Segment) -> Iterator[str]:
    """Hold a plan against the protocol that it was made of."""
    if segment.started is None:
        return
    plan = segment.started.plan
    if hashlib.sha256(plan.protocol_toml).hexdigest() != plan.protocol_sha256:
        yield "plan: protocol_sha256 is not the protocol's"
    try:
        protocol = decode_logged(plan.protocol_toml)
        again = expand(protocol, plan.participant, session=plan.session, overridden=plan.overridden)
        yield from _slot(protocol, segment, plan)
        if participant_index(plan.participant.id) != plan.participant.index:
            yield f"plan: participant {plan.participant.id} is at index {plan.participant.index}"
    except MinihumanError as error:
        yield f"plan: {error}"
        return
    for name in SessionPlan.__struct_fields__:
        logged, now = getattr(plan, name), getattr(again, name)
        if name not in _ONCE_PER_PLAN and logged != now:
            yield f"plan: {name} is not what the protocol gives"


def _slot(protocol: Protocol, segment: _Segment, plan: SessionPlan) -> Iterator[str]:
    """Hold group and stratum against the allocation list, and the stratum against the answer."""
    who, slots = plan.participant, allocation(protocol)
    if not 0 <= who.place < len(slots):
        yield f"plan: slot {who.place} is outside the allocation list of {len(slots)}"
        return
    slot = slots[who.place]
    if not plan.overridden and slot.group != who.group:
        yield f"plan: participant's group {who.group!r}, in the allocation list {slot.group!r}"
    if slot.stratum != who.stratum:
        yield f"plan: participant's stratum {who.stratum!r}, in the allocation list {slot.stratum!r}"
    strata = strata_of(protocol)
    if strata is None or plan.session > 1 or plan.segment > 1:
        return
    answered = strata.drawn(segment.events)
    if answered not in (None, who.stratum):
        yield f"plan: participant's stratum {who.stratum!r}, by the answer to {strata.question} {answered!r}"
