"""Read everything in a log, record by record, and note what is wrong with single records.

Here each record is only read, chained and decoded; other modules compare the records with each other.
"""

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Attachment, Metadata, Schema

from minihuman.admin.verify.messages import MessageVerifier
from minihuman.experiment.machine.events import Event, SessionEnded, SessionStarted
from minihuman.experiment.replay import MACHINE_VERSION
from minihuman.log import integrity, names as log_names, topics
from minihuman.log.codec import EventDecoder, find_topic, select_decoder
from minihuman.log.integrity import METADATA_PREFIX, HashChain, SegmentHead
from minihuman.log.paths import PART_SUFFIX
from minihuman.log.read.event_batches import decode_sure_events
from minihuman.log.salvage.records import ChunkMessages, LogMessage
from minihuman.log.salvage.scan import LogScanner

_KNOWN_METADATA = (
    log_names.SEGMENT_METADATA,
    log_names.FACTS_METADATA,
    log_names.END_METADATA,
    log_names.MISSING_METADATA,
    log_names.REPAIRED_METADATA,
)


@dataclass(slots=True)
class LogSegment:
    """A segment of a log, as its records describe it."""

    facts: dict[str, str]  # the metadata at its start
    station: dict[str, str] | None = None  # the metadata about the station; None if missing
    end: dict[str, str] | None = None  # the metadata at its end; None if missing
    events: list[Event] = field(default_factory=list)
    last_sequence: int = 0  # the number of its last message
    last_ns: int = 0  # the latest log time of its messages, since 1970
    first_ns: int = 0  # the log time of its first message
    head: str = ""  # the chain's head at the segment's end

    @property
    def number(self) -> str:
        """Return the segment's number; "?" if its metadata lack it."""
        return self.facts.get("segment", "?")

    @property
    def started(self) -> SessionStarted | None:
        """Return the event with the segment's plan and facts; None if it is missing."""
        if not self.events or not isinstance(self.events[0], SessionStarted):
            return None
        return self.events[0]

    @property
    def ended(self) -> SessionEnded | None:
        """Return the event that ends the segment; None if the segment was cut off."""
        if not self.events or not isinstance(self.events[-1], SessionEnded):
            return None
        return self.events[-1]

    @property
    def provable(self) -> bool:
        """Return whether the session machine's current rules recorded the segment, so that all checks apply to it."""
        return self.facts.get("session_rules") == str(MACHINE_VERSION)


@dataclass(slots=True)
class LogContents:
    """The contents of a log."""

    segments: list[LogSegment] = field(default_factory=list)
    finished: bool = False  # whether the file's end and its summary are intact
    attached: list[Attachment] = field(default_factory=list)  # without the copies of segments' starts
    differences: list[str] = field(default_factory=list)  # one line for each record not as minihuman writes it
    plans: list[bytes] = field(default_factory=list)  # the plans' messages
    plan_copies: list[bytes] = field(default_factory=list)  # the plans' messages in the segment heads


def read_log_contents(path: Path) -> LogContents:
    """Read everything in a log, and note the mistakes in single records.

    Raises:
        LogError: if the log cannot be read.
    """
    return _ContentsReader(path).read()


class _ContentsReader:
    """Reads a log's records in order.

    Args:
        path: the log.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._scan = LogScanner(path)
        self._chain = HashChain()
        self._contents = LogContents()
        self._schemas: dict[int, Schema] = {}  # those defined before the present record
        self._sure_events: deque[Event | None] = deque()  # events of the next messages; None if they are not sure
        self._decode: EventDecoder | None = None  # the decoder of the latest segment's messages
        self._verifier: MessageVerifier | None = None  # the verifier of these messages; None before the first

    def read(self) -> LogContents:
        """Read the log to its end and return its contents."""
        contents = self._contents
        records = [(record, dict(self._scan.schemas)) for record in self._scan.records()]
        self._decode_sure_events([record for record, _ in records])
        for record, schemas in records:
            self._schemas = schemas
            match record:
                case Metadata():
                    self._chain.add_metadata(record)
                    self._add_metadata(record)
                case Attachment() if record.name == integrity.SEGMENT_HEAD_NAME:
                    self._add_plan_copies(record)
                case Attachment():
                    self._chain.add_attachment(record)
                    contents.attached.append(record)
                case ChunkMessages():
                    self._add_chunk(record)
        contents.finished = self._scan.finished
        self._finish_messages()
        if contents.plan_copies != contents.plans and all(segment.provable for segment in contents.segments):
            contents.differences.append(
                f"attachment {integrity.SEGMENT_HEAD_NAME} is not a copy of the plan, or not there once a segment"
            )
        return contents

    def _add_metadata(self, record: Metadata) -> None:
        """Add a metadata record to the contents, and note what is wrong with it."""
        contents = self._contents
        if record.name == log_names.SEGMENT_METADATA:
            self._finish_messages()
            contents.segments.append(LogSegment(record.metadata))
            self._decode = select_decoder(record.metadata, self._path)
            return
        if not record.name.startswith(METADATA_PREFIX):
            return
        if record.name not in _KNOWN_METADATA or not contents.segments:
            contents.differences.append(f"metadata {record.name} is none that minihuman writes there")
            return
        segment = contents.segments[-1]
        match record.name:
            case log_names.FACTS_METADATA:
                self._note_duplicate(record.name, segment.station)
                segment.station = record.metadata
            case log_names.END_METADATA:
                self._note_duplicate(record.name, segment.end)
                segment.end = record.metadata
                segment.head = self._chain.head
            case log_names.MISSING_METADATA:
                gap = record.metadata
                contents.differences.append(
                    f"segment {gap.get('segment')}: messages {gap.get('first')} to {gap.get('last')} are missing: "
                    "they were lost to damage"
                )

    def _note_duplicate(self, name: str, earlier: dict[str, str] | None) -> None:
        """Note a difference if a segment has metadata with this name twice; ``earlier`` is the first one, if any."""
        if earlier is not None:
            self._contents.differences.append(f"metadata {name} is there twice")

    def _add_plan_copies(self, record: Attachment) -> None:
        """Add the plan in the second copy of a segment's start to the contents, unless the copy is damaged."""
        with suppress(ValueError):  # a damaged copy holds no plan; its hash tells of the damage
            messages = ChunkMessages(SegmentHead.of(record.data).records, self._scan.channels)
            self._contents.plan_copies += (message.data for message in messages)

    def _decode_sure_events(self, records: Sequence[Metadata | Attachment | ChunkMessages]) -> None:
        """Decode the events of all messages in advance, segment by segment, into the queue ``_sure_events``.

        An event is None if its message may not have the bytes that minihuman writes; the message is then decoded when
        it is added.
        """
        chunks: list[ChunkMessages] = []
        started_ns = ""
        for record in records:
            if isinstance(record, ChunkMessages):
                chunks.append(record)
            elif isinstance(record, Metadata) and record.name == log_names.SEGMENT_METADATA:
                self._sure_events += decode_sure_events(chunks, started_ns)
                chunks = []
                started_ns = record.metadata.get("started_unix_ns", "")
        self._sure_events += decode_sure_events(chunks, started_ns)

    def _add_chunk(self, chunk: ChunkMessages) -> None:
        """Add the messages of a chunk on our topics to the latest segment."""
        for record in chunk:
            event = self._sure_events.popleft()
            if find_topic(record.channel.topic) is not None:
                self._add_message(record, event)

    def _add_message(self, record: LogMessage, sure_event: Event | None) -> None:
        """Add a message to the hash chain and to its segment, and note how it differs from the expected message.

        Args:
            record: the message.
            sure_event: its event, if the message certainly has the bytes with which the event is written; else None.
        """
        contents = self._contents
        schema = self._schemas.get(record.channel.schema_id)
        self._chain.add_message(record, schema)
        segment = contents.segments[-1]
        if segment.end is not None:
            contents.differences.append(f"a message on {record.channel.topic} lies behind the end of its segment")
        segment.first_ns = segment.first_ns or record.log_time
        segment.last_ns = max(segment.last_ns, record.log_time)
        if not segment.provable:
            return
        if sure_event is not None and self._open_verifier(segment).try_accept(record, sure_event):
            segment.events.append(sure_event)
            segment.last_sequence = record.sequence
            return
        if record.channel.topic == topics.PLAN:
            contents.plans.append(record.data)
        schema_name = ""
        if schema is not None:
            schema_name = schema.name
        event, differences = self._open_verifier(segment).decode_and_compare(record, schema_name)
        contents.differences += (f"segment {segment.number}: {difference}" for difference in differences)
        if event is not None:
            segment.events.append(event)
            segment.last_sequence = record.sequence

    def _open_verifier(self, segment: LogSegment) -> MessageVerifier:
        """Return the segment's message verifier, created at its first message."""
        if self._verifier is None:
            assert self._decode is not None  # its segment's metadata came first
            is_unfinished = self._path.name.endswith(PART_SUFFIX)
            self._verifier = MessageVerifier(int(segment.facts["started_unix_ns"]), self._decode, live=is_unfinished)
        return self._verifier

    def _finish_messages(self) -> None:
        """Note the mistakes at the end of the latest segment's messages."""
        if self._verifier is not None:
            self._contents.differences += self._verifier.finish()
            self._verifier = None
