"""The recorder on disk: every event is in an MCAP file before its frame is shown, and every step is fsynced soon after.

``write`` encodes the events and passes the bytes to the operating system; from then on killing the process cannot lose
them. ``begin`` and ``settle`` are its two halves, so that the frame can be drawn in between. fsync, which survives a
power cut, takes 4 ms at the median and 25 ms at worst, so it runs in a separate thread. A live file that a killed
program left is resumed here, in the same segment and without a gap.
"""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Metadata

from minihuman.errors import DataLossError, LogError
from minihuman.experiment.machine.events import Event, SessionEnded, SessionStarted
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.codec import select_decoder
from minihuman.log.names import SEGMENT_METADATA, STEP
from minihuman.log.paths import SegmentPath
from minihuman.log.record.disk import FileWriter, LiveFile, RecorderSettings
from minihuman.log.record.file_lock import create_live_file, open_leftover
from minihuman.log.record.finalization import ExpectedContent, FinalizedLog, NotPublishedError, finish_log
from minihuman.log.record.live_log import LiveLogEncoder
from minihuman.log.record.recorder import Recorder
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner
from minihuman.log.segment_schema import find_schema_version
from minihuman.log.topics import RARE_TOPICS
from minihuman.storage.durable_files import write_again
from minihuman.storage.system import current_system

_SETTINGS = RecorderSettings()
_TORN = re.compile(r"cut off at byte (\d+)")


@dataclass(frozen=True, slots=True)
class LeftoverSegment:
    """The content of a leftover live file, and the file itself, open and locked."""

    part: Path
    fd: int
    started_ns: int  # the wall clock at the segment's time 0, ns since 1970
    events: tuple[Event, ...]
    messages: int
    steps: int
    crc: int  # of all its bytes
    rare: tuple[str, ...] = ()  # topics with channels in this file that not every log has

    def close(self) -> None:
        """Close the file without changing it."""
        os.close(self.fd)


def resume_segment(part: Path) -> LeftoverSegment:
    """Lock a live file, truncate a torn last write, read the file, and make its content durable.

    Raises:
        LogError: if a live process is writing it, or it does not exist, is damaged, has another version or no plan, or
            its session is over. The file then has to be recovered.
        OSError: if the disk cannot be written.
    """
    fd = open_leftover(part, os.O_RDWR | os.O_APPEND)
    try:
        _cut_torn_end(part, fd)
        leftover = _read_leftover(part, fd)
        write_again(part)  # the writer may have stopped after a failed fsync
        return leftover
    except BaseException:
        os.close(fd)
        raise


def _cut_torn_end(part: Path, fd: int) -> None:
    """Truncate a live file, of which ``fd`` is a descriptor, after its last whole record.

    Raises:
        LogError: if the file is damaged in another way.
    """
    scan = LogScanner(part)
    for _ in scan.records():  # finds the damage
        pass
    if torn := _TORN.fullmatch(scan.damage):
        current_system().disk.truncate(fd, int(torn[1]))
    elif scan.damage:
        raise LogError(f"{part} is {scan.damage}; run: minihuman recover {part}")


def _read_leftover(part: Path, fd: int) -> LeftoverSegment:
    """Read the content of a live file that was left behind, to resume its segment.

    Args:
        part: the path of the file.
        fd: its descriptor, which the result keeps open.

    Raises:
        LogError: if the file holds no plan, the session has ended, or another version of minihuman wrote the file.
    """
    scan = LogScanner(part)
    start: dict[str, str] = {}
    events: list[Event] = []
    messages = 0
    steps = 0
    for record in scan:
        match record:
            case Metadata() if record.name == SEGMENT_METADATA:
                start = record.metadata
                decode = select_decoder(start, part)
            case LogMessage():
                event = decode(record.channel.topic, record.data)
                if event is not None:
                    messages = record.sequence
                    if record.channel.topic == STEP:
                        steps += 1
                    events.append(event)
    if not events:
        raise LogError(f"{part} contains no session plan; run: minihuman recover {part}")
    first = events[0]
    if isinstance(events[-1], SessionEnded):
        raise LogError(f"{part} cannot be resumed: its session has ended; run: minihuman recover {part}")
    assert isinstance(first, SessionStarted)
    channel_numbers = {channel.topic: number for number, channel in scan.channels.items()}
    rare = tuple(topic.name for topic in RARE_TOPICS if topic.name in channel_numbers)
    own_numbers = LiveLogEncoder.resume(first.plan, started_ns=0, messages=0, steps=0, rare=rare).channels
    is_own_version = start["schema_version"] == str(find_schema_version(first.plan, first.facts))
    if not is_own_version or own_numbers != channel_numbers:
        raise LogError(f"{part} was written by another version of minihuman; run: minihuman recover {part}")
    return LeftoverSegment(part, fd, int(start["started_unix_ns"]), tuple(events), messages, steps, scan.crc, rare)


class McapRecorder(Recorder):
    """Writes one segment of a session. The first event must be its ``SessionStarted``.

    Args:
        data: the data folder; file names below it follow from the plan.
        plan: the session's plan.
        started_ns: the wall clock at the segment's time 0, in nanoseconds since 1970.
        settings: the settings of the recorder's use of its disk.
        left: a locked live file of this segment, left by a killed program, to be resumed.

    Raises:
        LogError: if the session's log exists already or is being written, or the folder cannot be written.
    """

    def __init__(
        self,
        data: Path,
        plan: SessionPlan,
        *,
        started_ns: int,
        settings: RecorderSettings = _SETTINGS,
        left: LeftoverSegment | None = None,
    ) -> None:
        self.segment_path = SegmentPath.of_plan(data, plan)
        if left is None:
            self._fd = create_live_file(self.segment_path)
            self._live = LiveLogEncoder(started_ns=started_ns)
        else:
            self._fd = left.fd
            self._live = LiveLogEncoder.resume(
                plan, started_ns=started_ns, messages=left.messages, steps=left.steps, rare=left.rare
            )
        crc = 0 if left is None else left.crc
        file = LiveFile(self._fd, self.segment_path.part, settings, crc=crc)
        self._disk = FileWriter(file, settings)
        self.publish: Callable[[Path], None] = lambda _: None  # as in ``finish_log``
        self._ended = False
        self._closed = False

    def begin(self, events: Sequence[Event]) -> None:
        """Begin to write the events of one input; ``settle`` must be called before their picture is shown.

        Raises:
            LogError: if an earlier write failed, the disk is a whole backlog behind, or the recorder is closed.
        """
        self.require_writable()
        if self._closed:
            raise LogError(f"{self.segment_path.part} is closed; open a new recorder to record another segment")
        if not events:
            return
        self._ended = self._ended or any(isinstance(event, SessionEnded) for event in events)
        try:
            pieces = self._live.encode(events)
        except Exception as error:  # a bug of ours or of a world: the log must not go on with a gap
            self._disk.failure = error
        else:
            self._disk.begin(pieces, steps=self._live.steps)
        self.require_writable()

    def settle(self) -> None:
        """Wait until the begun write survives the process, or until the disk has stalled for too long.

        Raises:
            LogError: if it could not be written.
        """
        self._disk.settle()
        self.require_writable()

    @property
    def is_broken(self) -> bool:
        """Return whether a write failed, so that the log cannot go on."""
        return self._disk.failure is not None

    def require_writable(self) -> None:
        """Check that no write has failed so far.

        Raises:
            LogError: if one has; it says why, what is safe, and what to do.
        """
        if self._disk.failure is not None:
            raise self._describe_failure() from self._disk.failure

    @property
    def durable_steps(self) -> int:
        """Return the number of this segment's steps that are fsynced."""
        return self._disk.durable_steps

    @property
    def durable_writes(self) -> int:
        """Return the number of this recorder's writes with events that are fsynced."""
        return self._disk.durable_writes

    @property
    def late_writes(self) -> int:
        """Return the number of writes that the disk finished only after their pictures had been shown."""
        return self._disk.late

    def drain(self) -> None:
        """Wait until all writes are durable; this is for players without a frame loop.

        Raises:
            LogError: if writing failed.
        """
        self._disk.drain()
        self.require_writable()

    def leave(self) -> None:
        """Make all writes durable and close the live file without finishing it, for another process to resume.

        A second call, or one after ``close``, does nothing.
        """
        if not self._closed:
            self._closed = True
            self._disk.close()
            os.close(self._fd)

    def close(self) -> Path | None:
        """Write the remaining messages, finish the log and return its path. A second call only returns the path.

        Raises:
            LogError: if something could not be written; the rest is kept, and the message says where.
            DataLossError: if the log has less content than was written, because the live file was damaged meanwhile.
            NotPublishedError: if ``publish`` does; this can then be called again.
        """
        if self._closed:
            return self.segment_path.log if self.segment_path.log.exists() else None
        self._closed = True
        self._disk.close()
        try:
            self.require_writable()
            promised = ExpectedContent(
                self._live.messages, self._disk.file.crc, self._disk.late, self._disk.longest_wait_s
            )
            return self._require_undamaged(
                finish_log(self.segment_path, clean=self._ended, promised=promised, publish=self.publish)
            ).path
        except NotPublishedError:
            self._closed = False
            raise
        except OSError as error:
            self._disk.failure = error
            raise self._describe_failure() from error
        finally:
            if self._closed:
                os.close(self._fd)

    def _require_undamaged(self, finished: FinalizedLog) -> FinalizedLog:
        """Return the outcome of finishing a log.

        Raises:
            DataLossError: if the log lacks something that was written.
        """
        if not finished.damage or not self._live.messages:  # without messages nothing can be lost
            return finished
        raise DataLossError(
            f"{finished.path}: kept {finished.steps} of {self._live.steps} steps, {finished.messages} of "
            f"{self._live.messages} messages; the live file was changed during recording "
            f"({finished.damage}); an unchanged copy is {finished.damaged_copy_path}"
        )

    def _describe_failure(self) -> LogError:
        """Return the error that says why recording stopped, what is safe, and what to do."""
        failure = self._disk.failure
        reason = str(failure)
        if isinstance(failure, OSError) and failure.strerror:
            reason = failure.strerror
        return LogError(
            f"recording stopped: {reason}; {self.durable_steps} steps are safe in {self.segment_path.part}; "
            f"fix the cause, then run: minihuman recover {self.segment_path.part}"
        )
