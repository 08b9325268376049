"""Files made durable together: nobody is told so too early, a slow disk serves many, an error finds its file."""

import os
import threading
import time

import pytest

from minihuman.log.record.disk import GroupCommit, RecorderSettings, sync_file_system
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.counts import PATIENCE_S
from tests.log.samples import STARTED_NS, session_events, session_plan


class SlowDisk:
    """Does one thing at a time, and each takes as long; knows what of each file it keeps."""

    def __init__(self, files: int, busy_s: float) -> None:
        self.written = dict.fromkeys(range(files), 0)
        self.kept = dict(self.written)
        self.turns = 0
        self.bad: set[int] = set()
        self._busy_s = busy_s
        self._arm = threading.Lock()

    def one(self, fd: int) -> None:
        self._turn((fd,))
        if fd in self.bad:
            raise OSError(5, "Input/output error")

    def all(self, fd: int) -> None:
        self._turn(tuple(self.written))
        if self.bad:
            raise OSError(5, "Input/output error")

    def _turn(self, fds: tuple[int, ...]) -> None:
        with self._arm:
            found = {fd: self.written[fd] for fd in fds}
            time.sleep(self._busy_s)
            self.turns += 1
            self.kept |= {fd: found[fd] for fd in fds if fd not in self.bad}


class File:
    """One of its files, as rounds know it: keeps what it was told of each write."""

    def __init__(self, fd: int, disk: SlowDisk) -> None:
        self.fd = fd
        self.wrong: list[str] = []  # refused, or promised and not kept
        self.settled = 0
        self._disk = disk
        self._waiting = self._promised = 0

    def writes(self, rounds: GroupCommit) -> None:
        self._waiting += 1
        rounds.expect(self)

    def write_waiting(self) -> bool:
        new, self._waiting = self._waiting, 0
        self._disk.written[self.fd] += new
        self._promised = self._disk.written[self.fd]
        return bool(new)

    def finish_commit(self, failed: Exception | None) -> None:
        if failed is not None:
            self.wrong.append(str(failed))
        elif self._disk.kept[self.fd] < self._promised:
            self.wrong.append(f"{self._disk.kept[self.fd]} of {self._promised}")
        self.settled = self._promised


def written_by_many(disk: SlowDisk, rounds: GroupCommit, *, times: int) -> list[File]:
    """Each file is written so often, each time after it heard what became of the last time."""
    files = [File(fd, disk) for fd in disk.written]
    give_up_s = time.monotonic() + PATIENCE_S
    for turn in range(times):
        for file in files:
            file.writes(rounds)
        while any(file.settled <= turn for file in files):
            assert time.monotonic() < give_up_s
            time.sleep(0.001)
    return files


@pytest.fixture
def one_device(monkeypatch):
    real = os.fstat
    monkeypatch.setattr(os, "fstat", lambda fd: real(0))  # the disk's files are numbers


@pytest.fixture(autouse=True)
def no_moment(monkeypatch):
    monkeypatch.setattr("minihuman.log.record.disk.GATHER_S", 0.0)


@pytest.mark.usefixtures("one_device")
def test_what_is_promised_is_kept_and_a_slow_disk_serves_a_hundred_people():
    disk = SlowDisk(100, 0.002)
    files = written_by_many(disk, GroupCommit(sync_one=disk.one, sync_all=disk.all), times=10)
    assert [file.wrong for file in files] == [[]] * 100
    assert disk.turns < 500  # for a thousand promises
    assert disk.kept == disk.written == dict.fromkeys(range(100), 10)


@pytest.mark.usefixtures("one_device")
def test_one_person_alone_is_fsynced_alone():
    disk = SlowDisk(1, 0.0)
    rounds = GroupCommit(sync_one=disk.one, sync_all=lambda fd: pytest.fail("everything was synced for one file"))
    [file] = written_by_many(disk, rounds, times=20)
    assert (file.wrong, disk.turns) == ([], 20)


@pytest.mark.usefixtures("one_device")
def test_a_round_of_two_files_is_one_sync_where_that_is_asked_for():
    disk = SlowDisk(32, 0.002)
    rounds = GroupCommit(sync_one=disk.one, sync_all=disk.all, max_single_syncs=1)
    for _ in range(10):
        before = disk.turns, rounds.rounds
        files = [File(fd, disk) for fd in disk.written]
        for file in files:
            file._waiting = 1
        rounds.commit(files)
        assert (disk.turns - before[0], rounds.rounds - before[1]) == (1, 1)
    assert disk.kept == disk.written == dict.fromkeys(range(32), 10)


@pytest.mark.usefixtures("one_device")
def test_a_file_that_fails_fails_alone():
    disk = SlowDisk(30, 0.002)
    disk.bad.add(7)
    files = written_by_many(disk, GroupCommit(sync_one=disk.one, sync_all=disk.all), times=5)
    assert {file.fd: len(file.wrong) for file in files if file.wrong} == {7: 5}


@pytest.mark.usefixtures("one_device")
def test_a_bug_in_one_file_is_no_other_file_s_trouble(caplog, monkeypatch):
    monkeypatch.setattr("minihuman.log.record.disk.GATHER_S", 0.05)  # both are of one round

    class Bug(File):
        def write_waiting(self) -> bool:
            raise ZeroDivisionError

    disk = SlowDisk(2, 0.0)
    rounds = GroupCommit(sync_one=disk.one, sync_all=disk.all)
    other = File(1, disk)
    Bug(0, disk).writes(rounds)
    for turn in range(2):
        other.writes(rounds)
        while other.settled <= turn:
            time.sleep(0.001)
    assert other.wrong == []
    assert "committing a log's live file failed" in caplog.text


def test_a_write_waits_for_others_of_its_file_and_the_hurried_does_not(monkeypatch):
    monkeypatch.setattr("minihuman.log.record.disk.GATHER_S", 3600.0)
    disk = SlowDisk(2, 0.0)
    rounds = GroupCommit(sync_one=disk.one, sync_all=disk.all)
    patient, hurried = File(0, disk), File(1, disk)
    patient.writes(rounds)
    hurried.writes(rounds)
    rounds.expect(hurried, at_once=True)
    while not hurried.settled:
        time.sleep(0.001)
    assert (patient.settled, disk.turns) == (0, 1)


def test_the_systems_own_call_takes_a_file_and_says_what_is_wrong(tmp_path):
    with (tmp_path / "x").open("wb") as file:
        sync_file_system(file.fileno())
    with pytest.raises(OSError, match="Bad file descriptor"):
        sync_file_system(10_000)


def test_recorders_share_it(tmp_path):
    rounds = GroupCommit()
    plan = session_plan()
    recorders = [
        McapRecorder(tmp_path / str(number), plan, started_ns=STARTED_NS, settings=RecorderSettings(group=rounds))
        for number in range(12)
    ]
    events = session_events(plan)
    for event in events:
        for recorder in recorders:
            recorder.write([event])
    for recorder in recorders:
        recorder.drain()
        assert recorder.durable_steps > 0
        assert recorder.durable_writes == len(events)
        assert recorder.close() is not None
    assert rounds.rounds < len(events)
