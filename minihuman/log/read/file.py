"""One log file as the events in it: its version checked, its damage said, its segments' facts gathered on the way."""

from collections.abc import Iterator
from pathlib import Path

from mcap.records import Metadata

from minihuman.errors import LogError
from minihuman.log.paths import PART_SUFFIX
from minihuman.log.read.chunk import LogMessage, Messages
from minihuman.log.read.guard import guarded
from minihuman.log.read.scan import Missing, Scan
from minihuman.log.topics import END_METADATA, PLAN, SEGMENT_METADATA
from minihuman.log.versions import Decode, reader_for
from minihuman.study.events import Event


class Reading:
    """A file being read. ``starts`` and ``ends`` are complete once its messages are read.

    A live or cut-off log (``.mcap.part``) gives what is whole; a finished one must be whole.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.starts: list[dict[str, str]] = []  # one a segment whose plan is there: version, wall clock, study
        self.ends: list[dict[str, str]] = []  # one a finished segment: reason, clean
        self.damage = ""  # what could not be read
        self.missing: list[Missing] = []  # messages that are not there
        self._at = 0  # where the chunk begins that is being read
        self._decode: Decode  # of the segment that is being read

    def messages(self) -> Iterator[LogMessage]:
        """Yield every message in file order.

        Raises:
            LogError: as ``chunks``.
        """
        for chunk in self.chunks():
            yield from chunk

    def chunks(self) -> Iterator[Messages]:
        """Yield every chunk of messages in file order.

        Raises:
            LogError: if the file cannot be opened, is no session log, of a newer schema version, or damaged.
        """
        scan = Scan(self.path)
        start: dict[str, str] = {}
        for record in scan.records():
            match record:
                case Messages():
                    if not start:
                        raise LogError(f"{self.path} is not a minihuman log: nothing in it says which version it has")
                    self._decode = reader_for(start, self.path)
                    self.starts += [start] * record.count(PLAN)
                    self._at = scan.at
                    yield record
                case Metadata() if record.name == SEGMENT_METADATA:
                    start = record.metadata
                case Metadata() if record.name == END_METADATA and "segment" in record.metadata:  # else it is damaged
                    self.ends.append(record.metadata)
        self.damage, self.missing = scan.damage, scan.missing
        holed = {str(gap.segment) for gap in scan.declared}
        self.ends = [end | {"clean": "false"} if end["segment"] in holed else end for end in self.ends]
        if not self.path.name.endswith(PART_SUFFIX) and (lacks := scan.unfinished):
            raise LogError(f"{self.path} is {lacks}; to keep what is whole, run: minihuman recover {self.path}")

    def events(self) -> Iterator[Event]:
        """Yield every event in the order it was recorded.

        Raises:
            LogError: as ``messages``, and if a message is none of ours.
        """
        with guarded(self.path):
            for message in self.messages():
                event = self.event(message.channel.topic, message.data)
                if event is not None:
                    yield event

    def event(self, topic: str, data: bytes) -> Event | None:
        """Read the event in a message's bytes; None in one that is for viewers.

        Raises:
            LogError: if it cannot be read.
        """
        try:
            return self._decode(topic, data)
        except Exception as error:  # a foreign or newer message can make protobuf raise anything
            where = f"{self.path}: in the chunk at byte {self._at}"
            raise LogError(f"{where} a message on {topic} cannot be read: {error}") from error


def segment_starts(path: Path) -> dict[int, str]:
    """Read which segments a file holds, and the wall clock at which each started.

    Raises:
        LogError: as ``Reading.chunks``.
    """
    reading = Reading(path)
    for _ in reading.chunks():
        pass
    return {int(facts["segment"]): facts["started_unix_ns"] for facts in reading.starts}
