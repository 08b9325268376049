"""Recorders: the contract of both, and what only the one on disk can do wrong."""

import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import pytest

from minihuman.errors import LogError
from minihuman.experiment.machine.events import Noted, Stepped
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.live_log import LiveLogEncoder
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import BufferedRecorder, MemoryRecorder, Recorder
from tests.lab.station import stations, try_to_record
from tests.log.samples import STARTED_NS, session_events, session_plan

PLAN = session_plan(episodes=2)
EVENTS = session_events(PLAN, steps=10)
STEPS = sum(isinstance(event, Stepped) for event in EVENTS)


@pytest.fixture(params=["memory", "mcap", "gathered"])
def recorder(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Recorder]:
    recorder: Recorder = MemoryRecorder()
    if request.param != "memory":
        recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    if request.param == "gathered":
        recorder = BufferedRecorder(recorder)
    yield recorder
    recorder.close()


def test_every_step_written_becomes_durable(recorder: Recorder) -> None:
    assert recorder.durable_steps == 0
    for event in EVENTS:
        recorder.write([event])
    recorder.close()
    assert recorder.durable_steps == STEPS


def test_events_may_come_many_at_once_or_not_at_all(recorder: Recorder) -> None:
    recorder.write(EVENTS[:10])
    recorder.write([])
    recorder.write(EVENTS[10:])
    recorder.close()
    assert recorder.durable_steps == STEPS


def test_a_second_close_says_the_same(recorder: Recorder) -> None:
    recorder.write(EVENTS)
    assert recorder.close() == recorder.close()


def test_gathered_writes_make_the_same_log(tmp_path: Path) -> None:
    one_by_one = McapRecorder(tmp_path / "one by one", PLAN, started_ns=STARTED_NS)
    gathered = BufferedRecorder(McapRecorder(tmp_path / "gathered", PLAN, started_ns=STARTED_NS))
    for event in EVENTS:
        one_by_one.write([event])
        gathered.write([event])
    first, second = one_by_one.close(), gathered.close()
    assert first is not None
    assert second is not None
    assert list(read_events(first)) == list(read_events(second)) == list(EVENTS)


def test_the_log_lies_where_the_design_says(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    log = tmp_path / "fourrooms" / "sub-07" / "ses-01" / "sub-07_ses-01.mcap"
    assert recorder.segment_path.part == log.with_name("sub-07_ses-01.mcap.part")
    recorder.write(EVENTS)
    assert recorder.close() == log
    assert [path.name for path in log.parent.iterdir()] == [log.name]


@pytest.mark.parametrize("name", ["../up", "", "a/b", ".hidden", "sub 07"])
def test_a_name_that_is_no_folder_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogError, match="cannot be used as a folder name"):
        McapRecorder(tmp_path, session_plan(participant=name), started_ns=STARTED_NS)


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("a file")
    with pytest.raises(LogError, match=r"cannot be created: Not a directory; choose another folder with --data"):
        McapRecorder(tmp_path / "data", PLAN, started_ns=STARTED_NS)


def test_a_log_that_does_not_begin_with_the_plan_is_a_bug_that_is_said(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    with pytest.raises(LogError, match="starts with SessionStarted"):
        recorder.write(EVENTS[1:2])
    with pytest.raises(LogError, match="starts with SessionStarted"):
        recorder.close()


def test_after_close_nothing_is_taken(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    recorder.write(EVENTS)
    recorder.close()
    with pytest.raises(LogError, match="is closed"):
        recorder.write(EVENTS[:1])


def test_a_session_that_was_closed_without_its_end_is_not_clean(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    recorder.write(EVENTS[:30])
    log = recorder.close()
    assert log is not None
    session = read_log(log)
    assert (session.clean, session.end_reason) == (False, "cut_off")


def test_a_finished_session_is_never_recorded_over(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    recorder.write(EVENTS)
    log = recorder.close()
    assert log is not None
    before = log.read_bytes()
    with pytest.raises(
        LogError, match="already exists and has segment 1; choose another number with --session, or move the log"
    ):
        McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    assert log.read_bytes() == before
    assert [path.name for path in log.parent.iterdir()] == [log.name]


def test_a_live_session_is_neither_recorded_over_nor_recovered(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    recorder.write(EVENTS[:20])
    recorder.drain()
    with pytest.raises(LogError, match=r"already exists: the session is running elsewhere or was cut off"):
        McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    with pytest.raises(LogError, match="still being written by a running session"):
        recover_log(recorder.segment_path.part)
    recorder.write(EVENTS[20:])
    log = recorder.close()
    assert log is not None
    assert list(read_events(log)) == EVENTS


@pytest.mark.program
def test_of_many_stations_that_start_at_once_one_records(tmp_path: Path) -> None:
    stations_count = 8
    context = stations()
    ready = context.Barrier(stations_count)
    ends = []
    for _ in range(stations_count):
        told, tell = context.Pipe(duplex=False)
        process = context.Process(target=try_to_record, args=(tmp_path, PLAN, EVENTS, tell, ready))
        process.start()
        tell.close()
        ends.append((told, process))
    results = [told.recv() for told, _ in ends]
    for _, process in ends:
        process.join()
    logs = [path for kind, path in results if kind == "log"]
    assert len(logs) == 1, results
    assert list(read_events(Path(logs[0]))) == EVENTS
    assert all("already exists" in said for kind, said in results if kind == "error"), results


def test_what_a_live_file_holds_in_memory_does_not_grow_with_what_was_written() -> None:
    live = LiveLogEncoder(started_ns=STARTED_NS)
    live.encode(EVENTS[:1])

    def grown(writes: int) -> int:
        before = tracemalloc.get_traced_memory()[0]
        for number in range(writes):
            live.encode([Noted(number, "phase", "playing")])
        return tracemalloc.get_traced_memory()[0] - before

    tracemalloc.start()
    try:
        grown(50)
        assert grown(400) < 400 * 50, "bytes stay behind with every write"
    finally:
        tracemalloc.stop()
