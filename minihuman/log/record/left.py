"""A live file that a killed program left, taken up again to go on with: the same segment, as if nothing had been."""

import fcntl
import os
import re
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Metadata

from minihuman.errors import LogError
from minihuman.log.read.chunk import LogMessage
from minihuman.log.read.scan import Scan
from minihuman.log.record.claim import is_at, lock
from minihuman.log.record.live_file import LiveLog
from minihuman.log.topics import SEGMENT_METADATA, STEP
from minihuman.log.versions import reader_for
from minihuman.study.events import Event, SessionEnded, SessionStarted

_TORN = re.compile(r"cut off at byte (\d+)")


@dataclass(frozen=True, slots=True)
class Left:
    """What a live file holds, and the file itself, open and locked."""

    part: Path
    fd: int
    started_ns: int  # the wall clock at the segment's time 0, ns since 1970
    events: tuple[Event, ...]
    messages: int
    steps: int
    crc: int  # of all of its bytes

    def close(self) -> None:
        """Let go of it as it is."""
        os.close(self.fd)


def take_up(part: Path) -> Left:
    """Lock a live file, take a torn last write off its end, and read it.

    Raises:
        LogError: if a living process writes it, it is gone, damaged, of another version, without a plan, or its session
            is over: then ``recover`` is the way.
    """
    try:
        fd = os.open(part, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
    except OSError as error:
        raise LogError(f"{part} cannot be gone on with: {error.strerror}") from error
    try:
        try:
            lock(fd, part, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LogError(f"{part} is still being written by a running session; let it end first") from None
        if not is_at(fd, part):
            raise LogError(f"{part} has just been recovered by another process")
        _cut_torn_end(part, fd)
        return _read(part, fd)
    except BaseException:
        os.close(fd)
        raise


def _cut_torn_end(part: Path, fd: int) -> None:
    scan = Scan(part)
    for _ in scan.records():
        pass
    if torn := _TORN.fullmatch(scan.damage):
        os.ftruncate(fd, int(torn[1]))
        os.fsync(fd)
    elif scan.damage:
        raise LogError(f"{part} is {scan.damage}; run: minihuman recover {part}")


def _read(part: Path, fd: int) -> Left:
    scan = Scan(part)
    start: dict[str, str] = {}
    events: list[Event] = []
    messages = steps = 0
    for record in scan:
        match record:
            case Metadata() if record.name == SEGMENT_METADATA:
                start = record.metadata
                decode = reader_for(start, part)
            case LogMessage():
                event = decode(record.channel.topic, record.data)
                if event is not None:
                    messages = record.sequence
                    steps += record.channel.topic == STEP
                    events.append(event)
    if not events:
        raise LogError(f"{part} holds no session plan")
    if isinstance(events[-1], SessionEnded):
        raise LogError(f"{part}: its session is over")
    assert isinstance(events[0], SessionStarted)
    numbered = LiveLog.going_on(events[0].plan, started_ns=0, messages=0, steps=0).channels
    if numbered != {channel.topic: number for number, channel in scan.channels.items()}:
        raise LogError(f"{part} was begun by another version of minihuman")
    return Left(part, fd, int(start["started_unix_ns"]), tuple(events), messages, steps, scan.crc)
