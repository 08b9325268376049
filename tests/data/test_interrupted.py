"""A command killed while it brings the store up to date: what is read afterwards is what a fresh store holds."""

import os
import random
import shutil
import signal
from collections.abc import Callable
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import duckdb
import pytest

from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_database import TableDatabase
from tests.builders import session, write_log
from tests.counts import PATIENCE_S, count

pytestmark = pytest.mark.program
_PEOPLE = 3
_CONTEXT = get_context("forkserver")
_CONTEXT.set_forkserver_preload(["tests.data.test_interrupted"])  # a fork per command: Python and DuckDB are loaded
Rows = dict[str, list[dict[str, object]]]


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("data")
    for index in range(_PEOPLE):
        one = session(participant=f"sub-0{index + 1}", index=index, seed=index, blocks=("grid",), episodes=2)
        write_log(one, data)
    return data / "transfer"


@pytest.fixture
def study(played: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(played, tmp_path / "transfer"))


def kept(study: Path) -> Rows:
    with StudyStore(StudySessions(study, processes=1), with_shortest=False) as store:
        return {name: without_world(store.tables.table(name).to_pylist()) for name in TABLES}


def fresh(study: Path, elsewhere: Path) -> Rows:
    """What a store holds that nothing ever happened to."""
    copy = Path(shutil.copytree(study, elsewhere, ignore=shutil.ignore_patterns(f"{TABLE_CACHE}*")))
    return kept(copy)


def without_world(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """Rows without what only the world can tell, which is there or not as the last command needed it."""
    return [{name: value for name, value in row.items() if name not in COLUMNS_NEEDING_WORLD} for row in rows]


def command(arguments: list[str], begun: Connection) -> None:
    """Run a command of ours as the shell would; say when it begins."""
    from minihuman.cli import main

    with ExitStack() as stack:
        silence = stack.enter_context(open(os.devnull, "w"))
        stack.enter_context(redirect_stdout(silence))
        stack.enter_context(redirect_stderr(silence))
        begun.send(None)
        stack.enter_context(pytest.MonkeyPatch.context()).setattr("sys.argv", ["minihuman", *arguments])
        main()


def killed_after(method: str, study: Path) -> None:
    """Bring a store up to date, and die as soon as a method of its database has returned."""
    done: Callable[..., None] = getattr(TableDatabase, method)

    def die(self: TableDatabase, *given: object) -> None:
        done(self, *given)
        os.kill(os.getpid(), signal.SIGKILL)

    setattr(TableDatabase, method, die)
    kept(study)


def set_time(study: Path, time_ns: int) -> None:
    """Give every log a time; set back after a kill, the store finds each log as it was when it was read."""
    for log in study.rglob("*.mcap"):
        os.utime(log, ns=(time_ns, time_ns))


@pytest.mark.parametrize("method", ["remove", "insert"])
def test_a_refresh_that_dies_between_two_changes_leaves_no_session_half_there(
    study: Path, tmp_path: Path, method: str
) -> None:
    set_time(study, 1)
    expected = kept(study)
    set_time(study, 2)
    process = _CONTEXT.Process(target=killed_after, args=(method, study))
    process.start()
    process.join(PATIENCE_S)
    assert process.exitcode == -signal.SIGKILL
    set_time(study, 1)
    assert kept(study) == expected == fresh(study, tmp_path / "anew")


def test_commands_killed_at_any_moment_leave_a_store_that_equals_a_fresh_one(study: Path, tmp_path: Path) -> None:
    moments = random.Random(20)
    runs = count(6, 200)
    away = tmp_path / "away"
    expected = {False: fresh(study, tmp_path / "all")}
    shutil.move(study / "sub-02", away)
    expected[True] = fresh(study, tmp_path / "fewer")
    is_away, killed = True, 0
    for number in range(runs):
        if moments.random() < 0.5:
            shutil.move(*((away, study / "sub-02") if is_away else (study / "sub-02", away)))
            is_away = not is_away
        set_time(study, 1)
        kept(study)
        set_time(study, 2)
        out = tmp_path / f"out-{number}"
        arguments = (
            ["query", str(study), "select count(*) from steps"],
            ["export", "csv", str(study), str(out)],
            ["report", str(study), "--out", str(out)],
        )[number % 3]
        here, there = _CONTEXT.Pipe()
        process = _CONTEXT.Process(target=command, args=(arguments, there))
        process.start()
        assert here.poll(PATIENCE_S)
        process.join(moments.uniform(0, 1.2))
        if process.is_alive():
            process.kill()
            killed += 1
        process.join(PATIENCE_S)
        assert process.exitcode in (0, -signal.SIGKILL), arguments
        set_time(study, 1)
        assert kept(study) == expected[is_away], (number, arguments)
        shutil.rmtree(out, ignore_errors=True)
    assert killed >= runs // 6


def test_rows_that_went_missing_are_noticed(study: Path) -> None:
    expected = kept(study)
    for change in ("DELETE FROM kept.steps WHERE log = 2", "INSERT INTO kept.steps SELECT * FROM kept.steps LIMIT 1"):
        with duckdb.connect(str(study / TABLE_CACHE)) as tables:
            tables.execute(change)
        assert kept(study) == expected


def test_a_log_that_changed_is_noticed_though_its_size_and_time_are_the_same(study: Path) -> None:
    expected = kept(study)
    one, two, _ = sorted(study.rglob("*.mcap"))
    facts = one.stat()
    content = bytearray(one.read_bytes())
    content[:8] = b"\0" * 8
    one.write_bytes(content)
    os.utime(one, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    changed = kept(study)
    assert len(changed["participants"]) <= len(expected["participants"])
    with StudyStore(StudySessions(study, processes=1), with_shortest=False) as store:
        fingerprints = dict(store.tables.connection.execute("SELECT key, fingerprint FROM kept.logs").fetchall())
    assert {Path(key).name for key in fingerprints} >= {two.name}
    content[:8] = b"\x89MCAP0\r\n"
    one.write_bytes(content)
    os.utime(one, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert kept(study) == expected


def test_a_write_ahead_log_whose_database_was_deleted_is_not_replayed_into_the_next(study: Path) -> None:
    expected = kept(study)
    (study / TABLE_CACHE).rename(study / "copy")
    (study / f"{TABLE_CACHE}.wal").write_bytes(b"of a database that is gone")
    assert kept(study) == expected


def test_while_another_process_has_the_file_the_tables_are_made_for_once_and_it_is_said(study: Path) -> None:
    expected = kept(study)
    process = _CONTEXT.Process(target=hold, args=(study, (pipe := _CONTEXT.Pipe())[1]))
    process.start()
    assert pipe[0].poll(PATIENCE_S)
    sessions = StudySessions(study, processes=1)
    with StudyStore(sessions, with_shortest=False) as store:
        rows = {name: without_world(store.tables.table(name).to_pylist()) for name in TABLES}
    process.kill()
    process.join(PATIENCE_S)
    assert rows == expected
    (note,) = sessions.account.notes
    assert note.startswith(f"{study / TABLE_CACHE} cannot be used now")
    assert "made anew for this once" in note
    sessions = StudySessions(study, processes=1)
    StudyStore(sessions, with_shortest=False).close()
    assert sessions.account.notes == []


def hold(study: Path, begun: Connection) -> None:
    with duckdb.connect(str(study / TABLE_CACHE)):
        begun.send(None)
        signal.pause()
