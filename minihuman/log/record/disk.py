"""Writes live files: appends bytes in order, makes them durable soon after, and reports every failure.

If frames wait for their writes, two threads serve one file. One writes, which survives the death of the process; the
other fsyncs what was written, which survives a power cut. No frame waits for a slow disk longer than a bound.

If only durable bytes count, one thread serves all files (``GroupCommit``): writes that arrive for a file within a
moment are joined, and files that are due together are made durable together. A thread per file would pass the
interpreter lock back and forth at each write, and a slow disk manages only a few hundred fsyncs per second.
"""

import logging
import os
import queue
import shutil
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from minihuman.errors import LogError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.log.record.live_log import AppendBlock
from minihuman.operating_system import (
    lock_descriptor,
    make_private_folder,
    open_file,
    read_at,
    sync_file,
    sync_file_system,
)
from minihuman.storage.durable_files import sync_folder
from minihuman.storage.locks import is_file_at
from minihuman.storage.system import current_system

STEP_BYTES = 2_048  # twice what a step with its key events, frame and pose takes
OBSERVATION_BYTES = 32_768  # two PNGs of 80 x 60 pixels, of up to 15,000 bytes each
MAX_ESTIMATED_STEPS = 20_000  # more than anyone plays in one episode, even if the protocol allows more
RESERVE_BYTES = 16 * 1024 * 1024  # for finishing the log, floor plans, and data of other programs
_COPY_BYTES = 1 << 20  # that are copied at once when a file is restored


def require_disk_space(folder: Path, episode: EpisodePlan) -> None:
    """Refuse an episode that, at full length, would not fit on the disk of a folder.

    Raises:
        LogError: if there is too little free space.
    """
    step_bytes = STEP_BYTES
    if episode.record_observations:
        step_bytes += OBSERVATION_BYTES
    needed_bytes = RESERVE_BYTES + min(episode.max_steps, MAX_ESTIMATED_STEPS) * step_bytes
    free_bytes = shutil.disk_usage(folder).free
    if free_bytes < needed_bytes:
        free_mib = free_bytes / 2**20
        needed_mib = needed_bytes / 2**20
        raise LogError(
            f"{folder} has {free_mib:.1f} MiB free, but episode {episode.episode + 1} needs {needed_mib:.1f} MiB; "
            "free some space, or choose another folder with --data"
        )


LOGGER = logging.getLogger("minihuman")


MAX_PENDING_WRITES = 65_536  # enough for ten minutes at a hundred writes per second
WRITE_BOUND_S = 0.1  # the longest time for which a picture waits for a write


@dataclass(frozen=True, slots=True)
class RecorderSettings:
    """The settings of a recorder's use of its disk.

    Args:
        bound_s: how long ``settle`` waits for a stalled write, in seconds.
        backlog: the number of writes that may wait for the disk before the recorder gives up.
        group: writes and syncs the files of many recorders, if no picture waits for a write; None for threads of its
            own.
        on_sync: a function that another thread calls whenever more data have become durable.
        put: writes to a file descriptor and returns the number of bytes written; the system's disk by default.
        sync: makes a file descriptor's writes durable; the system's disk by default.
    """

    bound_s: float = WRITE_BOUND_S
    backlog: int = MAX_PENDING_WRITES
    group: "GroupCommit | None" = None
    on_sync: Callable[[], None] = lambda: None
    put: Callable[[int, memoryview], int] = field(default_factory=lambda: current_system().disk.write)
    sync: Callable[[int], None] = field(default_factory=lambda: current_system().disk.sync)


class LiveFile:
    """A live file that its owner has created and locked. One thread writes it, and another may make it durable.

    Args:
        fd: the file descriptor, which remains the owner's.
        part: the file's path.
        settings: the settings for writing it.
        crc: the checksum of its present content.
    """

    def __init__(self, fd: int, part: Path, settings: "RecorderSettings", *, crc: int = 0) -> None:
        self.fd = fd
        self.crc = crc  # of all bytes written
        self._part = part
        self._settings = settings
        self._write_lock = threading.Lock()  # held during each write and while the file is restored

    def append(self, pieces: Iterable[AppendBlock]) -> None:
        """Write blocks of bytes to the operating system.

        Raises:
            LogError: if there is too little disk space.
            OSError: if the disk refuses them.
        """
        for piece in _join_pieces(pieces):
            if piece.room_for is not None:
                require_disk_space(self._part.parent, piece.room_for)
            remaining = memoryview(piece.data)
            with self._write_lock:
                while remaining:
                    n_bytes = self._settings.put(self.fd, remaining)
                    remaining = remaining[n_bytes:]
                self.crc = zlib.crc32(piece.data, self.crc)

    def sync(self) -> None:
        """Make everything written so far durable.

        Raises:
            OSError: if that fails.
        """
        self._settings.sync(self.fd)

    def restore(self) -> None:
        """If the file was removed or moved, write it again from the open descriptor and make it durable.

        Raises:
            LogError: if it cannot be written again.
        """
        if is_file_at(self.fd, self._part):
            return
        try:
            with self._write_lock:
                make_private_folder(self._part.parent)
                new_fd = open_file(self._part, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_APPEND)
                try:
                    copied = self._copy_to(new_fd)
                    os.dup2(new_fd, self.fd, inheritable=False)
                finally:
                    os.close(new_fd)
        except OSError as error:
            raise LogError(
                f"{self._part} was deleted while it was being written, and it cannot be restored: {error.strerror}"
            ) from error
        LOGGER.warning(
            "%s was deleted or moved while it was being written; it was restored with all %d bytes", self._part, copied
        )

    def _copy_to(self, new_fd: int) -> int:
        """Copy the whole file to a new descriptor durably; return the number of bytes copied."""
        lock_descriptor(new_fd)
        copied = 0
        while block := read_at(self.fd, _COPY_BYTES, copied):
            copied += os.write(new_fd, block)
        self._settings.sync(new_fd)
        for folder in self._part.parents[:4]:  # session, participant, study and data folder, any of which may be new
            sync_folder(folder)
        return copied


def _join_pieces(pieces: Iterable[AppendBlock]) -> Iterator[AppendBlock]:
    """Yield blocks joined into as few as possible; a block for which the disk must have room stays separate."""
    buffered: list[bytes] = []
    for piece in pieces:
        if piece.room_for is not None and buffered:
            yield AppendBlock(b"".join(buffered))
            buffered = []
        if piece.room_for is not None:
            yield piece
        else:
            buffered.append(piece.data)
    if buffered:
        yield AppendBlock(b"".join(buffered))


@dataclass(slots=True)
class WriteJob:
    """The write of the events of one input."""

    pieces: Sequence[AppendBlock]
    steps: int  # of the segment, including these
    finished: threading.Lock = field(default_factory=threading.Lock)  # held until it is written or has failed
    over: bool = False  # whether it was written or has failed
    fully_written: bool = False  # whether all its bytes were written


class FileWriter:
    """Writes a live file and makes it durable in other threads: two that only it uses, or that of a ``GroupCommit``.

    With a ``GroupCommit`` the file's own ``sync`` is called only if the file was removed and has to be written again.
    """

    def __init__(self, file: LiveFile, settings: RecorderSettings) -> None:
        self.file = file
        self.failure: Exception | None = None
        self.durable_steps = 0  # number of fsynced steps
        self.durable_writes = 0  # number of fsynced writes
        self.late = 0  # number of writes that were not over when their picture was shown
        self.longest_wait_s = 0.0
        self._settings = settings
        self._begun_count = 0  # jobs
        self._written_count = 0
        self._settled_count = 0  # jobs that are durable or have failed
        self._settling = threading.Condition()
        self._is_broken = False  # whether making the file durable has failed
        self._last: WriteJob | None = None  # the last queued job that ``settle`` has not waited for
        self._stuck: WriteJob | None = None  # the last job whose wait timed out
        self._is_expected = False  # whether the group will write the queued jobs
        self._jobs: queue.SimpleQueue[WriteJob | None] = queue.SimpleQueue()
        self._unsynced: queue.SimpleQueue[WriteJob | None] = queue.SimpleQueue()
        # Daemons, so that a crash of the program is not held up; what was written stays and is recovered.
        self._threads = [
            threading.Thread(target=run, name=f"minihuman-log-{name}", daemon=True)
            for name, run in (("write", self._write_all), ("sync", self._sync_all))
            if settings.group is None
        ]
        for thread in self._threads:
            thread.start()

    @property
    def fd(self) -> int:
        """Return the file's descriptor."""
        return self.file.fd

    def begin(self, pieces: Sequence[AppendBlock], *, steps: int) -> None:
        """Queue blocks of bytes to be appended after all earlier ones; ``failure`` may state why they are not.

        Args:
            pieces: the blocks of bytes.
            steps: the number of steps that the file has with these blocks.
        """
        behind = self._begun_count - self._written_count
        if behind >= self._settings.backlog:
            self.failure = self.failure or TimeoutError(f"the disk is {behind} writes behind")
            return
        self._begun_count += 1
        job = WriteJob(pieces, steps)
        group = self._settings.group
        if group is None:
            job.finished.acquire()
            self._last = job
        self._jobs.put(job)
        if group is not None and not self._is_expected:
            self._is_expected = True
            group.expect(self)

    def settle(self) -> None:
        """Wait for the last queued write, at most ``bound_s``; ``failure`` states the error if it fails.

        With a ``GroupCommit`` this returns at once, because pictures then wait for ``durable_writes``.
        """
        job = self._last
        self._last = None
        if job is None:
            return
        if self._stuck is not None and not self._stuck.over:  # an earlier picture has waited for the disk already
            self.late += 1
            return
        began_s = time.monotonic()
        if job.finished.acquire(timeout=self._settings.bound_s):
            self._stuck = None
        else:
            self._stuck = job
            self.late += 1
        self.longest_wait_s = max(self.longest_wait_s, time.monotonic() - began_s)

    def drain(self) -> None:
        """Wait until every queued write is durable or has failed."""
        if self._settings.group is not None and self._settled_count < self._begun_count:
            self._settings.group.expect(self, at_once=True)
        with self._settling:
            self._settling.wait_for(lambda: self._settled_count >= self._begun_count)

    def close(self) -> None:
        """Make the remaining writes durable and stop writing; the file itself stays open."""
        if self._settings.group is not None:
            self.drain()
        self._jobs.put(None)
        for thread in self._threads:
            thread.join()

    def _write_jobs(self, jobs: Sequence[WriteJob]) -> None:
        """Append the blocks of jobs to the file, unless an earlier write failed; record an error in ``failure``."""
        if self.failure is None or isinstance(self.failure, TimeoutError):
            try:
                self.file.append(piece for job in jobs for piece in job.pieces)
                for job in jobs:
                    job.fully_written = True
            except Exception as error:  # the session raises it at this write or the next
                self.failure = error
        self._written_count += len(jobs)

    def _make_durable(self, jobs: Sequence[WriteJob], *, sync: Callable[[], None], closing: bool = False) -> None:
        """Sync the file after writes, and record how much is durable or why it is not.

        Args:
            jobs: the jobs that were written since the last call.
            sync: makes the file durable.
            closing: whether to sync even if there are no jobs.
        """
        if not self._is_broken and (jobs or closing):
            try:
                sync()
                self.file.restore()
                self.durable_steps = max([self.durable_steps, *(job.steps for job in jobs if job.fully_written)])
                if all(job.fully_written for job in jobs):
                    self.durable_writes += len(jobs)
            except Exception as error:
                self._is_broken = True
                self.failure = self.failure or error
                if isinstance(error, LogError):  # the file is gone
                    self.durable_steps = 0
        if jobs:
            self._settings.on_sync()
        with self._settling:
            self._settled_count += len(jobs)
            self._settling.notify_all()

    def _write_all(self) -> None:
        """Write queued jobs until the end of the queue is marked by None."""
        while (job := self._jobs.get()) is not None:
            self._write_jobs([job])
            job.over = True
            job.finished.release()
            self._unsynced.put(job)
        self._unsynced.put(None)

    def _sync_all(self) -> None:
        """Make written jobs durable, all that wait at once, until the end of the queue is marked by None."""
        closing = False
        while not closing:
            jobs = [self._unsynced.get(), *_take_waiting(self._unsynced)]
            closing = jobs[-1] is None
            self._make_durable([job for job in jobs if job is not None], sync=self.file.sync, closing=closing)

    def write_waiting(self) -> bool:
        """Write all queued blocks, for a ``GroupCommit``; return whether there were any."""
        self._is_expected = False  # first: jobs that are queued from here on need another commit
        jobs = [job for job in _take_waiting(self._jobs) if job is not None]
        self._write_jobs(jobs)
        for job in jobs:
            self._unsynced.put(job)
        return bool(jobs)

    def finish_commit(self, failed: Exception | None) -> None:
        """Record, for a ``GroupCommit``, that the written blocks are durable, or why they cannot be."""

        def raise_failure() -> None:
            if failed is not None:
                raise failed

        self._make_durable([job for job in _take_waiting(self._unsynced) if job is not None], sync=raise_failure)


def _take_waiting(jobs: "queue.SimpleQueue[WriteJob | None]") -> list[WriteJob | None]:
    """Take all jobs that are in a queue, and return them; the caller must be the queue's only reader."""
    waiting = []
    while not jobs.empty():
        waiting.append(jobs.get())
    return waiting


GATHER_S = 0.2  # how long a write waits for others of its file, such as a key's press, picture and release
COMMIT_WINDOW_S = 0.1  # a file is committed up to this much earlier, together with a file that is due
MAX_SINGLE_SYNCS = 12  # more files than a disk that keeps up has in most rounds


class GroupCommit:
    """Writes and syncs all files of a process in one thread, from the first write to the process's end.

    Args:
        sync_one: makes one file durable.
        sync_all: makes all files on a file's file system durable, or fails.
        max_single_syncs: the largest number of files to sync singly; for more, ``sync_all`` is called once per file
            system.
    """

    def __init__(
        self,
        *,
        sync_one: Callable[[int], None] = sync_file,
        sync_all: Callable[[int], None] = sync_file_system,
        max_single_syncs: int = MAX_SINGLE_SYNCS,
    ) -> None:
        self._max_single_syncs = max_single_syncs
        self.rounds = 0  # number of commits so far
        self._sync_one = sync_one
        self._sync_all = sync_all
        self._due: deque[tuple[float, FileWriter]] = deque()  # when each file is due, the earliest first
        self._hurried: deque[FileWriter] = deque()
        self._wake = threading.Event()
        self._idle = False  # whether nothing is due, so that the thread must be woken
        self._beginning = threading.Lock()
        self._thread: threading.Thread | None = None

    def expect(self, file: FileWriter, *, at_once: bool = False) -> None:
        """Schedule a commit of a file's queued blocks, in ``GATHER_S`` seconds or at once."""
        if at_once:
            self._hurried.append(file)
        else:
            self._due.append((time.monotonic() + GATHER_S, file))
        if at_once or self._idle:
            self._wake.set()
        if self._thread is None:
            self._start_thread()

    def _start_thread(self) -> None:
        """Start the thread that commits, unless it is running."""
        with self._beginning:
            if self._thread is None:
                # A daemon, so that a crash of the program is not held up; what was written stays and is recovered.
                self._thread = threading.Thread(target=self._run, name="minihuman-log-rounds", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        """Commit the files that are due, until the process ends."""
        while True:
            self._wait_until_due()
            self.commit(self._take_due_files())

    def _wait_until_due(self) -> None:
        """Wait until a file is due."""
        while True:
            self._wake.clear()
            remaining_s: float | None = None  # None while nothing is due
            if self._due:
                due_s, _ = self._due[0]
                remaining_s = due_s - time.monotonic()
            if self._hurried or (remaining_s is not None and remaining_s <= 0):
                return
            self._idle = remaining_s is None
            if not self._idle or not self._due:  # another thread may have added a file before it could see ``_idle``
                self._wake.wait(remaining_s)
            self._idle = False

    def _take_due_files(self) -> list[FileWriter]:
        """Take the files that are hurried, or due within ``COMMIT_WINDOW_S``, each once."""
        files: dict[FileWriter, None] = {}
        while self._hurried:
            files[self._hurried.popleft()] = None
        until_s = time.monotonic() + COMMIT_WINDOW_S
        while self._due:
            due_s, file = self._due[0]
            if due_s > until_s:
                break
            self._due.popleft()
            files[file] = None
        return list(files)

    def commit(self, files: Sequence[FileWriter]) -> None:
        """Write the queued blocks of these files and make them durable; errors are recorded in the files' writers."""
        written_files = []
        for file in files:
            with _isolate_failures():
                if file.write_waiting():
                    written_files.append(file)
        errors = self._sync_files([file.fd for file in written_files])
        self.rounds += 1
        for file in written_files:
            with _isolate_failures():
                file.finish_commit(errors.get(file.fd))

    def _sync_files(self, fds: Sequence[int]) -> dict[int, OSError]:
        """Make files durable; return the error of each file for which that failed."""
        if len(fds) > self._max_single_syncs:
            try:
                for fd in {os.fstat(fd).st_dev: fd for fd in fds}.values():
                    self._sync_all(fd)
                return {}
            except OSError:  # the error may concern one file only, so sync each by itself
                pass
        errors = {}
        for fd in fds:
            try:
                self._sync_one(fd)
            except OSError as error:
                errors[fd] = error
        return errors


@contextmanager
def _isolate_failures() -> Iterator[None]:
    """Log any error in the context instead of raising it."""
    try:
        yield
    except Exception:  # a bug of ours: the other files must still be committed
        LOGGER.exception("committing a log's live file failed")
