"""Reads one log file as events: checks its version, reports damage, and collects the metadata of its segments."""

from collections.abc import Iterator
from pathlib import Path

from mcap.records import Metadata

from minihuman.errors import LogError
from minihuman.experiment.machine.events import Event
from minihuman.log.codec import EventDecoder, select_decoder
from minihuman.log.names import END_METADATA, SEGMENT_METADATA
from minihuman.log.paths import PART_SUFFIX, raise_as_log_error
from minihuman.log.salvage.records import ChunkMessages, LogMessage
from minihuman.log.salvage.scan import LogScanner, MissingMessages
from minihuman.log.topics import PLAN


class LogReader:
    """Reads one log file. ``starts`` and ``ends`` are complete once its messages have been read.

    Of a live or cut-off log (``.mcap.part``) the intact part is read; a finished log must be intact.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.starts: list[dict[str, str]] = []  # metadata of each segment with a plan: version, wall clock, study
        self.ends: list[dict[str, str]] = []  # metadata of each finished segment: reason, clean
        self.damage = ""  # describes what could not be read
        self.missing: list[MissingMessages] = []  # messages that were lost
        self._chunk_position = 0  # position of the chunk that is being read
        self._decode: EventDecoder  # for the segment that is being read

    def messages(self) -> Iterator[LogMessage]:
        """Yield every message in file order.

        Raises:
            LogError: as ``chunks`` does.
        """
        for chunk in self.chunks():
            yield from chunk

    def chunks(self) -> Iterator[ChunkMessages]:
        """Yield every chunk of messages in file order.

        Raises:
            LogError: if the file cannot be opened, is not a session log, has a newer schema version, or is damaged.
        """
        scan = LogScanner(self.path)
        start: dict[str, str] = {}
        for record in scan.records():
            match record:
                case ChunkMessages():
                    if not start:
                        raise LogError(f"{self.path} is not a minihuman log: it has no schema version")
                    self._decode = select_decoder(start, self.path)
                    self.starts += [start] * record.count(PLAN)  # once if the chunk has the segment's plan
                    self._chunk_position = scan.position
                    yield record
                case Metadata() if record.name == SEGMENT_METADATA:
                    start = record.metadata
                case Metadata() if record.name == END_METADATA and "segment" in record.metadata:  # else damaged
                    self.ends.append(record.metadata)
        self.damage = scan.damage
        self.missing = scan.missing
        incomplete_segments = {str(gap.segment) for gap in scan.declared}
        for index, end in enumerate(self.ends):
            if end["segment"] in incomplete_segments:
                self.ends[index] = end | {"clean": "false"}
        if not self.path.name.endswith(PART_SUFFIX) and (defect := scan.unfinished_reason):
            raise LogError(f"{self.path} is {defect}; to keep the intact part, run: minihuman recover {self.path}")

    def events(self) -> Iterator[Event]:
        """Yield every event in the order in which it was recorded.

        Raises:
            LogError: as ``messages`` does, and if a message cannot be decoded.
        """
        with raise_as_log_error(self.path):
            for message in self.messages():
                event = self.decode(message.channel.topic, message.data)
                if event is not None:
                    yield event

    def decode(self, topic: str, data: bytes) -> Event | None:
        """Decode the event in a message's bytes; return None for a preview.

        Raises:
            LogError: if the event cannot be decoded.
        """
        try:
            return self._decode(topic, data)
        except Exception as error:  # a foreign or newer message can make protobuf raise anything
            chunk_name = f"the chunk at byte {self._chunk_position}"
            raise LogError(f"{self.path}: in {chunk_name}, a message on {topic} cannot be read: {error}") from error


def read_segment_starts(path: Path, *, first: bool = False) -> dict[int, str]:
    """Return the wall-clock time at which each segment with a plan starts, by segment number.

    The times are texts, as in the log: nanoseconds since 1970. With ``first``, reading stops after the first of these
    segments has begun; otherwise the whole file is read.

    Raises:
        LogError: as ``LogReader.chunks`` does.
    """
    reader = LogReader(path)
    for _ in reader.chunks():
        if first and reader.starts:
            break
    return {int(facts["segment"]): facts["started_unix_ns"] for facts in reader.starts}
