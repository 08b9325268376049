"""What a recorder does with a disk that is slow, full, failing, or taken away."""

import os
import shutil
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from minihuman.errors import DataLossError, LogError
from minihuman.experiment.machine.events import Event, Stepped
from minihuman.log.paths import SegmentPath
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.disk import RESERVE_BYTES, GroupCommit, RecorderSettings
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.live_log import LiveLogEncoder
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.counts import PATIENCE_S
from tests.disks import small_disk
from tests.lab.station import play_until_full, stations
from tests.log.samples import STARTED_NS, session_events, session_plan

PLAN = session_plan(episodes=2)
EVENTS = session_events(PLAN, steps=10)
STEPS = sum(isinstance(event, Stepped) for event in EVENTS)


def test_writing_never_waits_for_the_disk(tmp_path: Path) -> None:
    disk = threading.Event()
    recorder = McapRecorder(
        tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(sync=lambda _fd: _stall(disk))
    )
    for event in EVENTS:
        recorder.write([event])
    assert recorder.durable_steps == 0, "a write waited for the disk, which has not answered yet"
    disk.set()
    recorder.drain()
    assert recorder.durable_steps == STEPS
    recorder.close()


def test_where_nobody_waits_what_comes_within_a_moment_is_one_fsync_and_who_cannot_wait_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("minihuman.log.record.disk.GATHER_S", 3600.0)  # a moment
    synced: list[int] = []
    recorder = McapRecorder(
        tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(group=GroupCommit(sync_one=synced.append))
    )
    for event in EVENTS[:20]:
        recorder.write([event])
    assert (recorder.durable_writes, synced) == (0, [])
    recorder.drain()
    assert (recorder.durable_writes, len(synced)) == (20, 1)
    for event in EVENTS[20:]:
        recorder.write([event])
    log = recorder.close()
    assert recorder.durable_writes == len(EVENTS)
    assert log is not None
    assert read_log(log).clean


BOUND_S = 2.0  # a disk that takes longer has stalled; a busy machine takes less


def test_what_was_begun_is_written_once_it_is_settled_and_only_then_waited_for(tmp_path: Path) -> None:
    disk, stalls = threading.Event(), threading.Event()
    disk.set()

    def put(fd: int, data: memoryview) -> int:
        stalls.set()
        _stall(disk)
        return os.write(fd, data)

    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(put=put, bound_s=BOUND_S))
    recorder.write(EVENTS[:20])
    disk.clear()
    stalls.clear()
    for event in EVENTS[20:24]:
        recorder.begin([event])  # a disk that takes nothing holds up nobody here
    assert stalls.wait(timeout=PATIENCE_S)
    assert (len(list(read_events(recorder.segment_path.part))), recorder.late_writes) == (20, 0)
    recorder.settle()  # the picture waits for as long as the bound
    recorder.settle()  # and nothing is waited for twice
    assert recorder.late_writes == 1
    recorder.begin(EVENTS[24:25])
    recorder.settle()  # another picture does not wait for the same disk
    assert (len(list(read_events(recorder.segment_path.part))), recorder.late_writes) == (20, 2)
    disk.set()
    recorder.drain()
    for number, event in enumerate(EVENTS[25:], 26):
        recorder.begin([event])
        recorder.settle()
        assert len(list(read_events(recorder.segment_path.part))) == number
    assert recorder.late_writes == 2
    recorder.close()


def _write_all(recorder: McapRecorder, events: Sequence[Event], *, waiting: bool = False) -> None:
    for event in events:
        recorder.write([event])
        if waiting:
            recorder.drain()


def _stall(disk: threading.Event) -> None:
    assert disk.wait(timeout=PATIENCE_S)


def test_what_was_written_outlives_the_process_before_the_disk_has_it(tmp_path: Path) -> None:
    disk = threading.Event()
    recorder = McapRecorder(
        tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(sync=lambda _fd: _stall(disk))
    )
    for number, event in enumerate(EVENTS, 1):
        recorder.write([event])
        assert len(list(read_events(recorder.segment_path.part))) == number
    assert (recorder.durable_steps, recorder.late_writes) == (0, 0)
    disk.set()
    recorder.close()


def test_a_disk_that_takes_nothing_holds_up_one_picture_and_no_more(tmp_path: Path) -> None:
    disk = threading.Event()
    recorder = McapRecorder(
        tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(put=_Stalling(disk), bound_s=0.02)
    )
    _write_all(recorder, EVENTS)
    assert recorder.late_writes == len(EVENTS)
    disk.set()
    log = recorder.close()
    assert log is not None
    assert list(read_events(log)) == EVENTS
    (end,) = read_log(log).metadata["ends"]
    assert (end["late_writes"], end["clean"]) == (str(len(EVENTS)), "true")
    assert int(end["longest_wait_ms"]) >= 20


class _Stalling:
    """A disk that takes nothing before it is told to."""

    def __init__(self, disk: threading.Event) -> None:
        self._disk = disk

    def __call__(self, fd: int, data: memoryview) -> int:
        _stall(self._disk)
        return os.write(fd, data)


def test_a_write_that_the_system_takes_in_parts_is_whole(tmp_path: Path) -> None:
    recorder = McapRecorder(
        tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(put=lambda fd, data: os.write(fd, data[:100]))
    )
    recorder.write(EVENTS)
    log = recorder.close()
    assert log is not None
    assert list(read_events(log)) == EVENTS


@pytest.mark.parametrize("taken", ["removed", "moved", "with its folder"])
def test_a_live_file_that_is_taken_away_is_put_back(
    tmp_path: Path, taken: str, caplog: pytest.LogCaptureFixture
) -> None:
    recorder = McapRecorder(tmp_path / "data", PLAN, started_ns=STARTED_NS)
    recorder.write(EVENTS[:20])
    recorder.drain()
    if taken == "removed":
        recorder.segment_path.part.unlink()
    elif taken == "moved":
        recorder.segment_path.part.rename(tmp_path / "elsewhere")
    else:
        shutil.rmtree(tmp_path / "data")
    recorder.write(EVENTS[20:21])
    recorder.drain()
    assert list(read_events(recorder.segment_path.part)) == EVENTS[:21], "noticed at the next flush"
    part = recorder.segment_path.part
    assert f"{part} was deleted or moved while it was being written; it was restored" in caplog.text
    with pytest.raises(LogError, match="still being written by a running session"):
        recover_log(recorder.segment_path.part)
    recorder.write(EVENTS[21:])
    log = recorder.close()
    assert log is not None
    assert list(read_events(log)) == EVENTS


@pytest.mark.parametrize("harm", ["a bit", "the end"])
def test_a_live_file_that_was_changed_ends_as_a_failed_check_that_names_what_was_found(
    tmp_path: Path, harm: str
) -> None:
    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    recorder.write(EVENTS[:20])
    recorder.drain()
    found = bytearray(recorder.segment_path.part.read_bytes())
    if harm == "a bit":
        found[-40] ^= 1
        recorder.segment_path.part.write_bytes(found)
    else:
        os.truncate(recorder.segment_path.part, len(found) - 500)
    recorder.write(EVENTS[20:])
    with pytest.raises(DataLossError, match=rf"kept \d+ of {STEPS} steps, .*an unchanged copy is .*as-found-1") as loss:
        recorder.close()
    assert loss.value.exit_code == 1
    assert (recorder.segment_path.part.with_name(f"{recorder.segment_path.part.name}.as-found-1")).exists()
    assert not read_log(recorder.segment_path.log).clean


def test_a_disk_that_falls_far_behind_is_an_error_not_a_silent_loss(tmp_path: Path) -> None:
    disk = threading.Event()
    recorder = McapRecorder(
        tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(put=_Stalling(disk), backlog=4, bound_s=0.001)
    )
    with pytest.raises(LogError, match=r"4 writes behind; 0 steps are safe in .*minihuman recover"):
        _write_all(recorder, EVENTS)
    disk.set()
    with pytest.raises(LogError, match="recording stopped"):
        recorder.close()
    kept = list(read_events(recorder.segment_path.part))
    assert kept == EVENTS[: len(kept)]
    assert len(kept) >= 4, "what was queued before is written once the disk answers"


def test_a_failing_disk_is_said_at_the_next_write(tmp_path: Path) -> None:
    good = [True]
    recorder = McapRecorder(
        tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(sync=lambda _fd: _sync_while(good))
    )
    recorder.write(EVENTS[:20])
    recorder.drain()
    steps = recorder.durable_steps
    good.clear()
    with pytest.raises(LogError, match="Input/output error"):
        _write_all(recorder, [EVENTS[20]], waiting=True)
    with pytest.raises(LogError, match=f"Input/output error; {steps} steps are safe"):
        recorder.write([EVENTS[21]])
    with pytest.raises(LogError, match="Input/output error"):
        recorder.close()
    recover_log(recorder.segment_path.part)
    kept = list(read_events(recorder.segment_path.log))
    assert kept[:20] == EVENTS[:20]


def _sync_while(good: list[bool]) -> None:
    if not good:
        raise OSError(5, os.strerror(5))


def test_a_full_disk_stops_the_recorder_and_keeps_what_was_written(tmp_path: Path) -> None:
    said, durable = _until_full(tmp_path, file_bytes=_size(EVENTS[:50]))
    assert len(said) == 2
    assert all("File too large" in line and "minihuman recover" in line for line in said), said
    _check_kept(tmp_path, durable)


def test_a_full_tmpfs_stops_the_recorder_and_keeps_what_was_written(tmp_path: Path) -> None:
    size = RESERVE_BYTES + 2**20
    with small_disk(tmp_path, size):
        recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
        recorder.write(EVENTS[:20])
        recorder.drain()
        with pytest.raises(OSError, match="No space left"):
            (tmp_path / "ballast").write_bytes(b"x" * size)
        with pytest.raises(LogError, match=r"(No space left on device|0\.0 MiB free).*; \d+ steps are safe"):
            _write_all(recorder, EVENTS[20:], waiting=True)
        with pytest.raises(LogError, match=r"No space left on device|0\.0 MiB free"):
            recorder.close()
        _check_kept(tmp_path, recorder.durable_steps, recovering=False)
        (tmp_path / "ballast").unlink()
        _check_kept(tmp_path, recorder.durable_steps)


def test_an_episode_that_may_not_fit_is_not_begun(tmp_path: Path) -> None:
    with small_disk(tmp_path, 2 * 2**20):
        recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
        with pytest.raises(LogError, match=r"MiB free, but episode 1 needs 16\.2 MiB; free some space"):
            recorder.write(EVENTS)
        with pytest.raises(LogError, match="MiB free"):
            recorder.close()
        assert list(read_events(recorder.segment_path.part)) == EVENTS[:3]


def _size(events: list[Event]) -> int:
    """Of the live file with these events."""
    live = LiveLogEncoder(started_ns=STARTED_NS)
    return sum(len(piece.data) for event in events for piece in live.encode([event]))


def _until_full(data: Path, *, file_bytes: int) -> tuple[list[str], int]:
    context = stations()
    told, tell = context.Pipe(duplex=False)
    process = context.Process(target=play_until_full, args=(data, PLAN, EVENTS, tell, file_bytes))
    process.start()
    tell.close()
    said, durable = told.recv()
    process.join()
    return said, durable


def _check_kept(data: Path, durable: int, *, recovering: bool = True) -> None:
    where = SegmentPath.of_plan(data, PLAN)
    path = recover_log(where.part).path if recovering else where.part
    kept = list(read_events(path))
    assert kept == EVENTS[: len(kept)]
    assert 0 < durable <= sum(isinstance(event, Stepped) for event in kept) < STEPS
    assert not read_log(path).clean
