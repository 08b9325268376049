"""The store: kept rows are the rows, whatever became of logs, marks and the file itself."""

import os
import shutil
import subprocess
import sys
import tempfile

import duckdb
import pytest
import typer
from typer.testing import CliRunner

from minihuman.cli import export as export_commands
from minihuman.cli import see
from minihuman.data import store as the_store
from minihuman.data import writing
from minihuman.data.caches import FILES
from minihuman.data.columns import TABLES
from minihuman.data.marks import Mark, add_mark
from minihuman.data.selection import Selection
from minihuman.data.store import FILE_NAME, Store
from minihuman.data.study import Sessions
from minihuman.data.writing import write_tables
from minihuman.errors import StoreError
from minihuman.export.run import export
from minihuman.log.read.open_log import open_log
from tests.builders import session, write_log
from tests.disks import fill, read_only, small_disk


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    for index, seed in enumerate((0, 1, 2)):
        write_log(session(participant=f"sub-0{index + 1}", index=index, seed=seed, blocks=("grid",), episodes=2), data)
    return data / "transfer"


@pytest.fixture
def study(played, tmp_path):
    return shutil.copytree(played, tmp_path / "transfer")


def rows(study, **how) -> dict[str, list[dict]]:
    with Store(Sessions(study, processes=1, **how), with_shortest=False) as store:
        return {name: store.tables.table(name).to_pylist() for name in TABLES}


def by_hand(study, **how) -> dict[str, list[dict]]:
    found: dict[str, list[dict]] = {name: [] for name in TABLES}
    for one in Sessions(study, processes=1, **how).rows(with_shortest=False):
        for name in TABLES:
            found[name] += one.rows[name].to_pylist()
    return found


def no_reading(monkeypatch):
    def refuse(paths, work, processes=None):
        assert not paths
        return iter(())

    monkeypatch.setattr(the_store, "each_log", refuse)


def test_kept_rows_are_those_of_the_logs_and_are_made_once(study, monkeypatch):
    first = rows(study)
    assert first == by_hand(study)
    no_reading(monkeypatch)
    assert rows(study) == first


def test_a_study_that_was_moved_with_what_it_keeps_names_its_logs_where_they_are(study, tmp_path):
    rows(study)
    moved = shutil.move(study, tmp_path / "elsewhere")
    with Store(Sessions(moved, processes=1), with_shortest=False) as store:
        assert [one.path for one in store.kept] == [str(path) for path in sorted(moved.rglob("*.mcap"))]


def test_a_log_that_came_changed_or_went_and_a_mark_are_noticed_and_the_order_is_the_paths(study, tmp_path):
    shutil.move(study / "sub-02", tmp_path / "sub-02")
    rows(study)
    shutil.move(tmp_path / "sub-02", study / "sub-02")
    assert rows(study) == by_hand(study)
    assert [row["participant"] for row in rows(study)["participants"]] == ["sub-01", "sub-02", "sub-03"]
    log = next((study / "sub-03").rglob("*.mcap"))
    add_mark(open_log(log), Mark("exclude", "2026-01-06T10:00:00Z", episode=1))
    assert [row["left_out"] for row in rows(study)["episodes"]].count("tagged exclude") == 1
    shutil.rmtree(study / "sub-01")
    assert rows(study) == by_hand(study)


@pytest.mark.parametrize("become", ["gone", "rubbish", "of another version", "cut off"])
def test_whatever_became_of_the_file_the_rows_are_right(study, become):
    expected = rows(study)
    file = study / FILE_NAME
    match become:
        case "gone":
            file.unlink()
        case "rubbish":
            file.write_bytes(b"dear diary" * 1000)
        case "of another version":
            with duckdb.connect(str(file)) as tables:
                tables.execute("UPDATE kept.made_by SET version = 'older'")
        case "cut off":
            file.write_bytes(file.read_bytes()[:20_000])
    assert rows(study) == expected


def test_another_selection_has_its_own_rows_and_leaves_the_file_alone(study):
    rows(study)
    kept = (study / FILE_NAME).read_bytes()
    asked = {"selection": Selection(participant=("sub-02",))}
    assert rows(study, **asked) == by_hand(study, **asked)
    assert (study / FILE_NAME).read_bytes() == kept


def test_the_account_is_the_same_from_the_store_as_from_the_logs(study):
    accounts = []
    for _ in range(2):
        sessions = Sessions(study)
        with Store(sessions, with_shortest=False):
            accounts.append(list(sessions.account.lines()))
    assert accounts[0] == accounts[1]
    sessions = Sessions(study)
    assert sum(len(one.places) for one in sessions) == 6
    assert list(sessions.account.lines()) == accounts[0]


def test_a_folder_that_may_not_be_written_is_read_all_the_same(study):
    expected = by_hand(study)
    if os.geteuid() == 0:  # who may write wherever writing can be done
        with read_only(study):
            assert rows(study) == expected
    else:
        study.chmod(0o555)
        assert rows(study) == expected
    assert not (study / FILE_NAME).exists()


@pytest.mark.parametrize("free", [0, 8 * 1024, 64 * 1024, 256 * 1024, 512 * 1024])
def test_a_study_on_a_full_disk_is_read_all_the_same_and_takes_the_rest_of_it_for_nothing(played, tmp_path, free):
    with small_disk(tmp_path, 4 * 2**20):
        study = shutil.copytree(played, tmp_path / "transfer")
        expected = by_hand(study)
        fill(tmp_path, but=free)
        assert rows(study) == expected
        assert rows(study) == expected
        with Store(Sessions(study, processes=1), with_shortest=False) as store:
            write_tables(store.tables, tmp_path.parent / f"{tmp_path.name}-out", kept=store.files)
        kept = {path.name for path in (study / FILES).glob("*")}
        assert {name.removesuffix(".json") for name in kept if name.endswith(".json")} == {
            name for name in kept if not name.endswith(".json")
        }


def test_where_no_disk_has_room_for_the_tables_one_sentence_says_so(played, tmp_path, monkeypatch):
    with small_disk(tmp_path, 4 * 2**20):
        study = shutil.copytree(played, tmp_path / "transfer")
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        fill(tmp_path, but=0)
        with pytest.raises((StoreError, OSError), match=r"transfer: its tables cannot be made|No space left on device"):
            rows(study)


@pytest.mark.parametrize("name", ["[lab] a study", "[/red] it's 100% #1? &<b>", "two\nlines \x1b[2J"])
def test_a_folder_of_any_name_is_exported(played, tmp_path, name):
    study = shutil.copytree(played, tmp_path / name)
    app = typer.Typer()
    export_commands.add_to(app)
    for kind in ("csv", "bids"):
        result = CliRunner().invoke(app, [kind, str(study), str(tmp_path / name / f"out {kind}")])
        assert result.exit_code == 0, result.exception
        assert "6 episodes" in result.stdout


def test_a_table_that_a_disk_has_no_room_for_is_named(study, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    app = typer.Typer()
    export_commands.add_to(app)
    with small_disk(disk, 2**20):
        fill(disk, but=20 * 1024)
        for kind in ("csv", "parquet"):
            result = CliRunner().invoke(app, [kind, str(study), str(disk / "out")])
            assert isinstance(result.exception, OSError), result.output
            assert (result.exception.filename, result.exception.strerror) == (
                str(disk / "out"),
                "No space left on device",
            )
            assert [path.name for path in disk.iterdir()] == ["ballast"]


def test_a_query_is_answered_in_lines_or_as_csv_and_changes_nothing(study):
    app = typer.Typer()
    see.add_to(app)
    sql = "select participant, count(*) as n from episodes where left_out is null group by all order by all"
    told = CliRunner().invoke(app, ["query", str(study), sql])
    assert told.stdout.splitlines()[:2] == ["participant  n", "sub-01       2"]
    told = CliRunner().invoke(app, ["query", str(study), sql, "--csv"])
    assert told.stdout.splitlines() == ['"participant","n"', '"sub-01",2', '"sub-02",2', '"sub-03",2']
    before = rows(study)
    for wrong in ("select nothing from episodes", "drop table kept.steps", "nonsense"):
        with Store(Sessions(study), with_shortest=False) as store, pytest.raises(StoreError, match="the tables are"):
            store.tables.query(wrong)
    assert rows(study) == before


@pytest.mark.program
def test_tables_are_made_and_written_without_pandas(study, tmp_path):
    code = (
        "import sys; from pathlib import Path; from minihuman.data.selection import Selection; "
        "from minihuman.export.run import export; study, out = map(Path, sys.argv[1:]); "
        "export('parquet', study, out, Selection()); assert 'pandas' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code, study, tmp_path / "out"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def exported(study, out) -> dict[str, bytes]:
    export("parquet", study, out, Selection())
    return {path.name: path.read_bytes() for path in out.glob("*.parquet")}


def no_writing(monkeypatch):
    def refuse(*_):
        raise AssertionError("a table was written again")

    monkeypatch.setitem(writing._WRITERS, "parquet", refuse)


def test_table_files_of_an_unchanged_study_are_copied(study, tmp_path, monkeypatch):
    first = exported(study, tmp_path / "first")
    no_writing(monkeypatch)
    assert exported(study, tmp_path / "again") == first


@pytest.mark.parametrize("became", ["a log that went", "a mark", "a changed file", "a file without its note"])
def test_table_files_of_what_changed_are_written_again(study, tmp_path, monkeypatch, became):
    first = exported(study, tmp_path / "first")
    kept = study / FILES / "episodes.parquet"
    match became:
        case "a log that went":
            shutil.rmtree(study / "sub-01")
        case "a mark":
            add_mark(open_log(next(study.rglob("*.mcap"))), Mark("exclude", "2026-01-06T10:00:00Z", episode=1))
        case "a changed file":
            changed = bytearray(kept.read_bytes())
            changed[len(changed) // 2] ^= 1
            kept.write_bytes(changed)
        case "a file without its note":
            kept.with_name("episodes.parquet.json").unlink()
    second = exported(study, tmp_path / "second")
    assert (second == first) == ("file" in became)
    no_writing(monkeypatch)
    assert exported(study, tmp_path / "third") == second
    shutil.rmtree(study / FILES)
    monkeypatch.undo()
    assert exported(study, tmp_path / "anew") == second


def test_another_selection_neither_takes_nor_leaves_table_files(study, tmp_path):
    export("parquet", study, tmp_path / "out", Selection(participant=("sub-01",)))
    assert not (study / FILES).exists()
