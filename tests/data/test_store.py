"""The store: kept rows are the rows, whatever became of logs, marks and the file itself."""

import os
import shutil
import subprocess
import sys
import tempfile

import duckdb
import pytest
from click.testing import CliRunner

from minihuman.cli import main
from minihuman.cli.command_line import make_command_line
from minihuman.dataset import row_writer
from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_files import write_tables
from minihuman.dataset.table_queries import needs_shortest_paths
from minihuman.errors import QueryError
from minihuman.log.read.session_reader import read_log
from tests.builders import session, write_log
from tests.disks import fill, read_only, small_disk

pytestmark = pytest.mark.program  # whole studies are simulated


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
    with StudyStore(StudySessions(study, processes=1, **how), with_shortest=False) as store:
        return {name: store.tables.table(name).to_pylist() for name in TABLES}


def by_hand(study, **how) -> dict[str, list[dict]]:
    found: dict[str, list[dict]] = {name: [] for name in TABLES}
    for one in StudySessions(study, processes=1, **how).rows(with_shortest=False):
        for name in TABLES:
            found[name] += one.rows[name].to_pylist()
    return found


def no_reading(monkeypatch):
    def refuse(paths, work, processes=None):
        assert not paths
        return iter(())

    monkeypatch.setattr(row_writer, "map_logs", refuse)


def test_kept_rows_are_those_of_the_logs_and_are_made_once(study, monkeypatch):
    first = rows(study)
    assert first == by_hand(study)
    no_reading(monkeypatch)
    assert rows(study) == first


def test_a_study_that_was_moved_with_what_it_keeps_names_its_logs_where_they_are(study, tmp_path):
    rows(study)
    moved = shutil.move(study, tmp_path / "elsewhere")
    with StudyStore(StudySessions(moved, processes=1), with_shortest=False) as store:
        assert [one.path for one in store.cached_sessions] == [str(path) for path in sorted(moved.rglob("*.mcap"))]


def test_a_log_that_came_changed_or_went_and_a_mark_are_noticed_and_the_order_is_the_paths(study, tmp_path):
    shutil.move(study / "sub-02", tmp_path / "sub-02")
    rows(study)
    shutil.move(tmp_path / "sub-02", study / "sub-02")
    assert rows(study) == by_hand(study)
    assert [row["participant"] for row in rows(study)["participants"]] == ["sub-01", "sub-02", "sub-03"]
    log = next((study / "sub-03").rglob("*.mcap"))
    add_annotation(read_log(log), Annotation("exclude", "2026-01-06T10:00:00Z", episode=1))
    assert [row["exclusion_reason"] for row in rows(study)["episodes"]].count("tagged exclude") == 1
    shutil.rmtree(study / "sub-01")
    assert rows(study) == by_hand(study)


@pytest.mark.parametrize("become", ["gone", "rubbish", "of another version", "cut off"])
def test_whatever_became_of_the_file_the_rows_are_right(study, become):
    expected = rows(study)
    file = study / TABLE_CACHE
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
    kept = (study / TABLE_CACHE).read_bytes()
    asked = {"selection": Selection(participant=("sub-02",))}
    assert rows(study, **asked) == by_hand(study, **asked)
    assert (study / TABLE_CACHE).read_bytes() == kept


def test_the_account_is_the_same_from_the_store_as_from_the_logs(study):
    accounts = []
    for _ in range(2):
        sessions = StudySessions(study)
        with StudyStore(sessions, with_shortest=False):
            accounts.append(list(sessions.account.lines()))
    assert accounts[0] == accounts[1]
    sessions = StudySessions(study)
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
    assert not (study / TABLE_CACHE).exists()


@pytest.mark.nightly(by_day=["0", "65536"])
@pytest.mark.parametrize("free", [0, 8 * 1024, 64 * 1024, 256 * 1024, 512 * 1024])
def test_a_study_on_a_full_disk_is_read_all_the_same_and_takes_the_rest_of_it_for_nothing(played, tmp_path, free):
    with small_disk(tmp_path, 4 * 2**20):
        study = shutil.copytree(played, tmp_path / "transfer")
        expected = by_hand(study)
        fill(tmp_path, but=free)
        assert rows(study) == expected
        assert rows(study) == expected
        with StudyStore(StudySessions(study, processes=1), with_shortest=False) as store:
            write_tables(store.tables, tmp_path.parent / f"{tmp_path.name}-out")


def test_where_no_disk_has_room_for_the_tables_one_sentence_says_so(played, tmp_path, monkeypatch):
    with small_disk(tmp_path, 4 * 2**20):
        study = shutil.copytree(played, tmp_path / "transfer")
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        fill(tmp_path, but=0)
        with pytest.raises((QueryError, OSError), match=r"transfer: its tables cannot be made|No space left on device"):
            rows(study)


@pytest.mark.parametrize("name", ["[lab] a study", "[/red] it's 100% #1? &<b>", "two\nlines \x1b[2J"])
def test_a_folder_of_any_name_is_exported(played, tmp_path, name):
    study = shutil.copytree(played, tmp_path / name)
    app = make_command_line()
    for kind in ("csv", "bids"):
        result = CliRunner().invoke(app, ["export", kind, str(study), str(tmp_path / name / f"out {kind}")])
        assert result.exit_code == 0, result.exception
        assert "6 episodes" in result.stdout


def test_a_table_that_a_disk_has_no_room_for_is_named(study, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    app = make_command_line()
    with small_disk(disk, 2**20):
        fill(disk, but=20 * 1024)
        for kind in ("csv", "parquet"):
            result = CliRunner().invoke(app, ["export", kind, str(study), str(disk / "out")])
            assert isinstance(result.exception, OSError), result.output
            assert (result.exception.filename, result.exception.strerror) == (
                str(disk / "out"),
                "No space left on device",
            )
            assert [path.name for path in disk.iterdir()] == ["ballast"]


def test_a_query_is_answered_in_lines_or_as_csv_and_changes_nothing(study):
    app = make_command_line()
    sql = "select participant, count(*) as n from episodes where exclusion_reason is null group by all order by all"
    told = CliRunner().invoke(app, ["query", str(study), sql])
    assert told.stdout.splitlines()[:2] == ["participant  n", "sub-01       2"]
    told = CliRunner().invoke(app, ["query", str(study), sql, "--csv"])
    assert told.stdout.splitlines() == ['"participant","n"', '"sub-01",2', '"sub-02",2', '"sub-03",2']
    before = rows(study)
    for wrong in ("select nothing from episodes", "drop table kept.steps", "nonsense"):
        with (
            StudyStore(StudySessions(study), with_shortest=False) as store,
            pytest.raises(QueryError, match=r"the tables are|use SELECT to read the study.s tables"),
        ):
            store.tables.query(wrong)
    assert rows(study) == before


def test_a_query_by_a_columns_earlier_name_is_answered_and_its_texts_stay(study):
    with StudyStore(StudySessions(study), with_shortest=False) as store:
        found = store.tables.query(
            "select 'it''s in_vain' as text, $$left_out$$ as quoted, sum(In_Vain) as n -- in_vain\n"
            'from episodes where "left_out" is null /* left_out */'
        )
        present = store.tables.query("select sum(ineffective_steps) as n from episodes where exclusion_reason is null")
    assert found.to_pylist() == [{"text": "it's in_vain", "quoted": "left_out", **present.to_pylist()[0]}]


@pytest.mark.parametrize(
    "sql",
    [
        *("copy (select 1) to 'x.csv'", "export database 'x.csv'", "attach 'x.csv'", "select * from 'secret.csv'"),
        *("drop table steps", "delete from steps", "insert into steps select * from steps", "set threads = 9"),
        "update kept.steps set reward = 1; select 1",
    ],
)
def test_a_query_neither_writes_nor_reads_other_files(study, tmp_path, sql, monkeypatch, capsys):
    (tmp_path / "secret.csv").write_text("a,b\n1,2\n")
    before = sorted(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["minihuman", "query", str(study), sql])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code == 2
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
    assert "read the study's tables" in printed.err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.program
def test_tables_are_made_and_written_without_pandas(study, tmp_path):
    code = (
        "import sys; from pathlib import Path; from minihuman.dataset.selection import Selection; "
        "from minihuman.exporters.exporter import export_study; study, out = map(Path, sys.argv[1:]); "
        "export_study('parquet', study, out, Selection()); assert 'pandas' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code, study, tmp_path / "out"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("sql", "needed"),
    [
        ("select count(*) from steps", False),
        ("select count(*) from episodes", False),
        ("select participant, median(2 * reward) from episodes group by all", False),
        ("select * from steps", False),
        ("select * from episodes", True),
        ("from episodes", True),
        ("table episodes", True),
        ("select e from episodes e", True),
        ("select to_json(episodes) from episodes", True),
        ("select avg(e.excess_steps) from episodes e", True),
        ("select columns('s.*') from blocks", True),
        ("select participant from (select * from episodes)", True),
        ("summarize episodes", True),
        ("pivot episodes on block using avg(reward)", True),
        ("select * from query('select spl from ' || 'episodes')", True),
        ("no SQL at all", True),
    ],
)
def test_a_query_asks_the_worlds_only_for_what_it_reads(sql, needed):
    assert needs_shortest_paths(sql) is needed


def test_counting_after_an_export_reads_no_log_again(study, monkeypatch):
    with StudyStore(StudySessions(study, processes=1), with_shortest=False):
        pass
    monkeypatch.setattr("minihuman.log.read.session_reader.read_log", None)
    sql = "select count(*) from episodes"
    with StudyStore(StudySessions(study, processes=1), with_shortest=needs_shortest_paths(sql)) as store:
        assert store.tables.count("episodes") > 0


def test_a_report_after_an_export_asks_the_worlds_and_reads_no_log_again(study, monkeypatch):
    log = next((study / "sub-01").rglob("*.mcap"))
    add_annotation(read_log(log), Annotation("exclude", "2026-01-06T10:00:00Z", episode=1))
    expected = {name: [] for name in TABLES}
    for one in StudySessions(study, processes=1).rows(with_shortest=True):
        for name in TABLES:
            expected[name] += one.rows[name].to_pylist()
    assert any(row["spl"] is not None for row in expected["episodes"])
    rows(study)
    no_reading(monkeypatch)
    for _ in ("filled in", "kept"):
        sessions = StudySessions(study, processes=1)
        with StudyStore(sessions, with_shortest=True) as store:
            assert {name: store.tables.table(name).to_pylist() for name in TABLES} == expected
        assert not sessions.account.notes
