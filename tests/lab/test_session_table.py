"""A study at a glance: a row a session, up to date, each log read once, the unreadable ones named."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import duckdb
import pytest

from minihuman.admin import session_index
from minihuman.admin.session_index import LOCK_WAIT_S, read_session_index
from minihuman.admin.session_summary import SessionSummary
from minihuman.admin.status import format_status
from minihuman.dataset import caches
from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.errors import LogError
from minihuman.experiment.machine.events import SessionEnded
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.counts import count
from tests.log.played import record
from tests.log.samples import STARTED_NS, session_events, session_plan
from tests.programs import running


def _record(data: Path, participant: str, *, episodes: int = 2, steps: int = 5) -> Path:
    plan = session_plan(episodes=episodes, participant=participant)
    return record(data, plan, session_events(plan, steps=steps))


def _count_reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The logs that are summed up from now on."""
    read: list[Path] = []
    really = session_index.summarize_session

    def counting(files: list[Path]) -> SessionSummary:
        read.extend(files)
        return really(files)

    monkeypatch.setattr(session_index, "summarize_session", counting)
    return read


def test_a_row_says_what_a_session_holds(tmp_path: Path) -> None:
    log = _record(tmp_path, "sub-01")
    (row,) = read_session_index(tmp_path)
    assert row.path == log
    assert row.problem == ""
    assert row.summary == SessionSummary(
        study="fourrooms",
        participant="sub-01",
        group="transfer",
        session=1,
        player="human",
        started_at="2026-09-21T14:13:20.000000000Z",
        segments=1,
        clean=True,
        end_reason="complete",
        episodes_planned=2,
        episodes_completed=2,
        steps=10,
        duration_s=pytest.approx(5.2, abs=0.001),
        complete=True,
    )


def test_rows_come_in_order_and_follow_what_happens_in_the_folder(tmp_path: Path) -> None:
    assert list(read_session_index(tmp_path)) == []
    second = _record(tmp_path, "sub-02")
    first = _record(tmp_path, "sub-01")
    assert [row.path for row in read_session_index(tmp_path)] == [first, second]
    first.unlink()
    assert [row.path for row in read_session_index(tmp_path)] == [second]


def test_a_live_session_has_a_row_that_grows(tmp_path: Path) -> None:
    plan = session_plan(episodes=2)
    events = session_events(plan, steps=5)
    recorder = McapRecorder(tmp_path, plan, started_ns=STARTED_NS)
    recorder.write(events[:20])
    recorder.drain()
    (row,) = read_session_index(tmp_path)
    assert row.path == recorder.segment_path.part
    assert row.summary is not None
    assert (row.summary.steps, row.summary.clean, row.summary.end_reason) == (4, False, "cut_off")
    assert [line.split()[-1] for line in format_status(tmp_path) if plan.participant.id in line] == ["running"]
    recorder.write(events[20:])
    recorder.close()
    (row,) = read_session_index(tmp_path)
    assert row.path == recorder.segment_path.log
    assert row.summary is not None
    assert (row.summary.steps, row.summary.clean) == (10, True)


def test_a_resumed_session_is_one_row(tmp_path: Path) -> None:
    plan, again = session_plan(episodes=2), session_plan(episodes=2, segment=2)
    events = session_events(plan, steps=5)
    record(tmp_path, plan, [*events[:10], SessionEnded(events[9].t_ns, "quit", "", 0)])
    recorder = McapRecorder(tmp_path, again, started_ns=STARTED_NS + 10**12)
    recorder.write(session_events(again, steps=5))
    recorder.drain()
    for _ in ("live", "closed"):
        (row,) = read_session_index(tmp_path)
        assert row.summary is not None
        assert (row.summary.segments, row.summary.episodes_completed) == (2, 2)
        recorder.close()


def test_a_copy_of_a_log_is_said(tmp_path: Path) -> None:
    log = record(tmp_path, session_plan(), session_events(session_plan()))
    study = log.parents[2]
    (study / "backup").mkdir()
    shutil.copy(log, study / "backup")
    lines = [line for line in format_status(study) if line.startswith("sub-07")]
    assert len(lines) == 2
    assert all("one of 2 logs of this session, of which one counts: " in line for line in lines)


def test_a_log_is_summed_up_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in (1, 2, 3):
        _record(tmp_path, f"sub-{number:02d}")
    read = _count_reads(monkeypatch)
    assert len(list(read_session_index(tmp_path))) == 3
    assert len(list(read_session_index(tmp_path))) == 3
    assert len(read) == 3
    new = _record(tmp_path, "sub-04")
    assert len(list(read_session_index(tmp_path))) == 4
    assert read[3:] == [new]


def test_unreadable_logs_are_named_with_their_reason_and_the_rest_is_read(tmp_path: Path) -> None:
    good = _record(tmp_path, "sub-01")
    cut = _record(tmp_path, "sub-02")
    cut.write_bytes(cut.read_bytes()[:500])
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "foreign.mcap").write_text("dear diary")
    rows = {row.path: row for row in read_session_index(tmp_path)}
    assert rows[good].summary is not None
    assert "is cut off at byte" in rows[cut].problem
    assert "is empty" in rows[tmp_path / "empty.mcap"].problem
    assert "is not a session log" in rows[tmp_path / "foreign.mcap"].problem
    assert all(rows[path].summary is None for path in rows if path != good)


def test_the_table_may_be_deleted_spoilt_or_unwritable(tmp_path: Path) -> None:
    log = _record(tmp_path, "sub-01")
    list(read_session_index(tmp_path))
    (tmp_path / TABLE_CACHE).unlink()
    assert [row.path for row in read_session_index(tmp_path)] == [log]
    (tmp_path / TABLE_CACHE).write_text("not a table" * 1000)
    assert [row.path for row in read_session_index(tmp_path)] == [log]
    (tmp_path / TABLE_CACHE).unlink()
    (tmp_path / TABLE_CACHE).mkdir()
    assert [row.path for row in read_session_index(tmp_path)] == [log]


HOLD = """
import sys, duckdb
with duckdb.connect(sys.argv[1], read_only=sys.argv[2] == "reading") as held:
    print("held", flush=True)
    sys.stdin.read()
"""


class OwnTime:
    """Time that passes by sleeping alone, however busy the machine is."""

    now_s = 0.0
    time_ns = staticmethod(time.time_ns)

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@contextmanager
def held(cache: Path, how: str) -> Iterator[None]:
    """Another process has the study's cache open."""
    command = [sys.executable, "-c", HOLD, cache, how]
    with running(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        yield


@pytest.mark.parametrize("how", ["reading", "writing"])
def test_a_table_that_another_process_holds_is_done_without(
    tmp_path: Path, how: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = _record(tmp_path, "sub-01")
    list(read_session_index(tmp_path))
    second = _record(tmp_path, "sub-02")
    waiting = OwnTime()
    monkeypatch.setattr(caches, "time", waiting)
    with held(tmp_path / TABLE_CACHE, how):
        assert [row.path for row in read_session_index(tmp_path)] == [first, second]
    assert waiting.now_s < 2 * LOCK_WAIT_S
    assert ["cannot be used now" in line for line in caplog.messages] == [True] * (how == "writing")
    assert (tmp_path / TABLE_CACHE).exists()


def test_a_row_in_hand_keeps_nobody_from_the_table(tmp_path: Path) -> None:
    for number in range(3):
        _record(tmp_path, f"sub-{number:02d}")
    rows = read_session_index(tmp_path)
    next(rows)
    with held(tmp_path / TABLE_CACHE, "writing"):
        assert len(list(rows)) == 2


def test_the_index_is_read_while_a_report_has_the_tables_open(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    logs = [_record(tmp_path, f"sub-{number:02d}").relative_to(tmp_path) for number in range(2)]
    study = tmp_path / logs[0].parts[0]
    list(read_session_index(study))
    sessions = StudySessions(study, processes=1)
    with StudyStore(sessions, with_shortest=False) as store:
        for _ in range(2):
            ran = subprocess.run([sys.executable, "-c", READ_ALL, study], capture_output=True, text=True, check=True)
            assert (ran.stdout.split()[0], ran.stderr) == ("2", "")
        assert [row.path.relative_to(tmp_path) for row in read_session_index(study)] == logs
        assert len(store.cached_sessions) == 2
    assert (caplog.messages, sessions.account.notes) == ([], [])


def test_the_table_is_read_by_duckdb(tmp_path: Path) -> None:
    _record(tmp_path, "sub-01")
    list(read_session_index(tmp_path))
    with duckdb.connect(str(tmp_path / TABLE_CACHE), read_only=True) as table:
        found = table.execute("SELECT participant, steps FROM session_index.sessions").fetchall()
    assert found == [("sub-01", 10)]


@pytest.mark.parametrize("places", [(-10,), (2, -10), (300,)])
def test_a_log_changed_at_its_head_or_end_with_its_size_and_time_kept_is_read_again(
    tmp_path: Path, places: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = _record(tmp_path, "sub-01")
    (row,) = read_session_index(tmp_path)
    assert row.summary is not None
    assert row.summary.complete
    facts, content = log.stat(), bytearray(log.read_bytes())
    for at in places:
        content[at] ^= 1
    log.write_bytes(content)
    os.utime(log, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    read = _count_reads(monkeypatch)
    (changed,) = read_session_index(tmp_path)
    assert read == [log]
    assert -10 not in places or changed.summary is None


READ_ALL = """
import sys, tracemalloc
from pathlib import Path
from minihuman.admin.session_index import read_session_index

tracemalloc.start()
print(sum(row.summary is not None for row in read_session_index(Path(sys.argv[1]))), tracemalloc.get_traced_memory()[1])
"""


@pytest.mark.nightly(sample=True)
def test_a_study_of_ten_thousand_sessions_takes_no_more_memory_than_a_small_one(tmp_path: Path) -> None:
    """In a fresh process: Python's table of names doubles at once, and another test may have brought it near that."""
    log = _record(tmp_path / "one", "sub-01", episodes=1)
    study = tmp_path / "study"
    for number in range(count(40, 10_000)):
        path = study / f"sub-{number:05d}" / "ses-01" / f"sub-{number:05d}_ses-01.mcap"
        path.parent.mkdir(parents=True)
        path.hardlink_to(log)
    ran = subprocess.run([sys.executable, "-c", READ_ALL, study], capture_output=True, text=True, check=True)
    read, peak_bytes = map(int, ran.stdout.split())
    assert read == count(40, 10_000)
    assert peak_bytes < 8 * 2**20


def test_a_folder_that_does_not_exist_is_said(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="none does not exist; name a study's folder"):
        list(read_session_index(tmp_path / "none"))
    (tmp_path / "file").touch()
    with pytest.raises(LogError, match="file is not a folder; name a study's folder"):
        list(read_session_index(tmp_path / "file"))
