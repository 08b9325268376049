"""Files made durable together: nobody is told so too early, a slow disk serves many, an error finds its file."""

import os
import threading
import time

import pytest

from minihuman.log.record.group_sync import GroupSync, syncfs
from minihuman.log.record.mcap_recorder import McapRecorder
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


def written_by_many(disk: SlowDisk, sync: GroupSync, *, times: int) -> list[tuple[int, str]]:
    """Each file is written and synced so often, by a thread of its own; what was promised and not kept, or refused."""
    wrong: list[tuple[int, str]] = []

    def write(fd: int) -> None:
        for _ in range(times):
            disk.written[fd] += 1
            promised = disk.written[fd]
            try:
                sync(fd)
            except OSError as error:
                wrong.append((fd, str(error)))
                continue
            if disk.kept[fd] < promised:
                wrong.append((fd, f"{disk.kept[fd]} of {promised}"))

    threads = [threading.Thread(target=write, args=(fd,)) for fd in disk.written]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=60)
    assert not any(thread.is_alive() for thread in threads)
    return wrong


@pytest.fixture
def one_device(monkeypatch):
    real = os.fstat
    monkeypatch.setattr(os, "fstat", lambda fd: real(0))  # the disk's files are numbers


@pytest.mark.usefixtures("one_device")
def test_what_is_promised_is_kept_and_a_slow_disk_serves_a_hundred_people():
    disk = SlowDisk(100, 0.002)
    sync = GroupSync(sync_one=disk.one, sync_all=disk.all)
    assert written_by_many(disk, sync, times=10) == []
    assert disk.turns < 500  # for a thousand promises
    assert disk.kept == disk.written


@pytest.mark.usefixtures("one_device")
def test_one_person_alone_is_fsynced_alone():
    disk = SlowDisk(1, 0.0)
    sync = GroupSync(sync_one=disk.one, sync_all=lambda fd: pytest.fail("everything was synced for one file"))
    assert written_by_many(disk, sync, times=20) == []


@pytest.mark.usefixtures("one_device")
def test_a_file_that_fails_fails_alone():
    disk = SlowDisk(30, 0.002)
    disk.bad.add(7)
    wrong = written_by_many(disk, GroupSync(sync_one=disk.one, sync_all=disk.all), times=5)
    assert {fd for fd, _ in wrong} == {7}
    assert len(wrong) == 5


def test_the_systems_own_call_takes_a_file_and_says_what_is_wrong(tmp_path):
    with (tmp_path / "x").open("wb") as file:
        syncfs(file.fileno())
    with pytest.raises(OSError, match="Bad file descriptor"):
        syncfs(10_000)


def test_recorders_share_it(tmp_path):
    disk = GroupSync()
    plan = session_plan()
    recorders = [McapRecorder(tmp_path / str(number), plan, started_ns=STARTED_NS, sync=disk) for number in range(12)]
    for event in session_events(plan):
        for recorder in recorders:
            recorder.write([event])
    for recorder in recorders:
        recorder.drain()
        assert recorder.durable_steps > 0
        assert recorder.close() is not None
