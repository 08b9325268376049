"""A study's tables as Parquet partitioned by study and participant, in a folder and in a store that speaks S3's
protocol, stored a session at a time."""

import os
import shutil
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import duckdb
import pandas as pd
import pyarrow as pa
import pyarrow.dataset
import pyarrow.parquet
import pytest
from click.testing import CliRunner, Result

import minihuman
from minihuman.admin.erasure_ledger import STORE_FOLDER
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.remote_logs import sync_logs
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.dataset import table_database
from minihuman.dataset.annotations import Annotation, add_annotation, read_annotations
from minihuman.dataset.caches import list_caches
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.remote_tables import fetch_tables, store_tables
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import TABLES, TablePartition
from minihuman.errors import LogError
from minihuman.exporters.exporter import export_study
from minihuman.log.read.session_reader import read_log
from minihuman.storage.remote_store import (
    STORE_URL_FILE_NAME,
    TABLES_URL_FILE_NAME,
    FolderStore,
    RemoteStore,
    RemoteStoreError,
    S3Store,
)
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from tests.builders import session, write_log
from tests.lab.object_store import object_store
from tests.lab.test_next_session import PROTOCOL, play

pytestmark = pytest.mark.program

STUDY = "corridor"


@pytest.fixture(scope="module")
def object_url() -> Iterator[str]:
    with object_store() as address:
        yield address


@pytest.fixture(params=["folder", "object store"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The address of an empty store of tables."""
    if request.param == "object store":
        return f"{request.getfixturevalue('object_url')}/{tmp_path.name}"
    return str(new_folder(tmp_path / "tables"))


@pytest.fixture(scope="module")
def two_people(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("data")
    for _ in range(2):
        play_next(data, episodes=3)
    return data / STUDY


@pytest.fixture
def study(two_people: Path, tmp_path: Path, url: str) -> Path:
    """The folder of a study of two people, whose tables go to the store."""
    return copied(two_people, tmp_path / "data", url)


def new_folder(folder: Path) -> Path:
    folder.mkdir(parents=True)
    return folder


def play_next(data: Path, *, episodes: int, participant: str | None = None, session: int = 1) -> None:
    play(plan_next_session(PROTOCOL, data, participant=participant, session=session), data, episodes=episodes)


def copied(study: Path, to: Path, url: str | Path) -> Path:
    """The same study on another machine, where nothing was read yet."""
    copy = shutil.copytree(study, new_folder(to) / STUDY)
    (to / TABLES_URL_FILE_NAME).write_text(f"{url}\n")
    for cache in list_caches(copy):
        cache.unlink()
    return copy


def open_store(url: str) -> RemoteStore:
    return S3Store(url.removeprefix("s3://")) if url.startswith("s3://") else FolderStore(Path(url))


def stored(url: str) -> set[str]:
    return set(open_store(url).names(""))


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FolderStore(folder).names("")}


def partitions(names: set[str]) -> set[TablePartition]:
    found = [TablePartition.parse(name) for name in names]
    assert None not in found
    return {one for one in found if one is not None}


def sessions_of(names: set[str]) -> set[tuple[str, int]]:
    return {(one.participant, one.session) for one in partitions(names)}


def typed(*words: object) -> Result:
    from minihuman.cli.command_line import make_command_line

    return CliRunner().invoke(make_command_line(), [str(word) for word in words])


def check_rows(url: str, study: Path, tmp_path: Path) -> None:
    """What the store has are the rows of the study's tables, each once, but for columns that take the worlds."""
    folder = tmp_path / "checked"
    shutil.rmtree(folder, ignore_errors=True)
    fetch_tables(url, folder)
    with StudyStore(StudySessions(study), with_shortest=False) as store:
        tables = {name: store.tables.table(name) for name in TABLES if store.tables.count(name)}
    assert {path.name for path in folder.iterdir() if path.is_dir()} == set(tables)
    for name, table in tables.items():
        expected = table.drop_columns([column for column in table.column_names if column in COLUMNS_NEEDING_WORLD])
        files = sorted((folder / name).rglob("*.parquet"))
        assert pa.concat_tables(pa.parquet.read_table(file, partitioning=None) for file in files).equals(expected)


@pytest.mark.nightly(by_day=["folder"])
def test_a_session_more_adds_its_files_and_writes_no_other(study: Path, url: str, tmp_path: Path) -> None:
    first = store_tables(study)
    before = stored(url)
    assert first == (len(before), 0)
    assert sessions_of(before) == {("sub-01", 1), ("sub-02", 1)}
    versions = open_store(url).versions("")
    play_next(study.parent, episodes=3)
    assert store_tables(study) == (len(stored(url)) - len(before), 0)
    assert sessions_of(stored(url) - before) == {("sub-03", 1)}
    assert open_store(url).versions("").items() > versions.items()
    assert store_tables(study) == (0, 0)
    check_rows(url, study, tmp_path)


def test_no_file_that_is_stored_is_written_again(two_people: Path, tmp_path: Path) -> None:
    tables = new_folder(tmp_path / "tables")
    study = copied(two_people, tmp_path / "data", tables)
    store_tables(study)
    written = {name: (tables / name).stat().st_mtime_ns for name in stored(str(tables))}
    play_next(study.parent, episodes=3)
    store_tables(study)
    assert {name: (tables / name).stat().st_mtime_ns for name in written} == written


def test_equal_rows_make_equal_files_on_every_machine_in_whatever_order_they_came(
    two_people: Path, tmp_path: Path
) -> None:
    one, other = new_folder(tmp_path / "one"), new_folder(tmp_path / "other")
    store_tables(copied(two_people, tmp_path / "data", one))
    copy = copied(two_people, tmp_path / "elsewhere", other)
    (copy / "sub-01").rename(tmp_path / "sub-01")
    store_tables(copy)
    assert sessions_of(stored(str(other))) == {("sub-02", 1)}
    (tmp_path / "sub-01").rename(copy / "sub-01")
    store_tables(copy)
    assert contents(one) == contents(other) != {}


@pytest.mark.nightly(by_day=["object store"])
def test_two_machines_store_their_own_sessions_in_one_place(tmp_path: Path, url: str, study: Path) -> None:
    both = copied(study, tmp_path / "both", url)
    other = copied(study, tmp_path / "other", url)
    shutil.rmtree(study / "sub-02")
    shutil.rmtree(other / "sub-01")
    assert (store_tables(study) or (0,))[0] > 0
    assert (store_tables(other) or (0,))[0] > 0
    assert store_tables(study) == store_tables(other) == store_tables(both) == (0, 0)
    check_rows(url, both, tmp_path)


def test_columns_that_a_report_fills_in_change_no_file(tmp_path: Path) -> None:
    log = write_log(session(blocks=("grid",), episodes=2), tmp_path / "data")
    study = log.parents[2]
    (study.parent / TABLES_URL_FILE_NAME).write_text(str(new_folder(tmp_path / "tables")))
    store_tables(study)
    with StudyStore(StudySessions(study), with_shortest=True) as store:
        assert store.tables.table("episodes", ["shortest_steps"])["shortest_steps"].null_count == 0
    assert store_tables(study) == (0, 0)


@pytest.mark.nightly(by_day=["object store"])
def test_a_session_that_goes_on_replaces_its_files_and_a_second_day_adds_its_own(
    study: Path, url: str, tmp_path: Path
) -> None:
    data = study.parent
    play_next(data, episodes=1)
    store_tables(study)
    before = stored(url)
    play_next(data, participant="sub-03", episodes=2)
    store_tables(study)
    resumed = stored(url)
    assert sessions_of(before ^ resumed) == {("sub-03", 1)}
    assert {one.table for one in partitions(before - resumed)} >= {"steps", "episodes", "segments"}
    check_rows(url, study, tmp_path)
    play_next(data, participant="sub-01", session=2, episodes=3)
    store_tables(study)
    assert resumed < stored(url)
    assert sessions_of(stored(url) - resumed) == {("sub-01", 2)}
    check_rows(url, study, tmp_path)


@pytest.mark.nightly(by_day=["folder"])
def test_an_annotation_replaces_the_tables_it_changes_and_reaches_the_other_machine(
    study: Path, url: str, tmp_path: Path
) -> None:
    other = copied(study, tmp_path / "other", url)
    for data in (study.parent, other.parent):
        (data / STORE_URL_FILE_NAME).write_text(str(tmp_path / "logs"))
    store_tables(study)
    before = stored(url)
    log = next((study / "sub-02").rglob("*.mcap"))
    add_annotation(read_log(log), Annotation("exclude", "2026-01-06T10:00:00Z", episode=1))
    assert typed("gather", study).exit_code == 0
    after = stored(url)
    assert sessions_of(before ^ after) == {("sub-02", 1)}
    assert {one.table for one in partitions(after - before)} >= {"episodes", "marks"}
    assert {one.table for one in partitions(before - after)}.isdisjoint({"steps", "presses"})
    check_rows(url, study, tmp_path)
    told = typed("gather", other)
    assert told.stdout.splitlines() == ["0 logs fetched, 0 stored", "0 files of tables stored, 0 removed"]
    assert stored(url) == after
    remote_logs = tmp_path / "logs" / STUDY
    assert len(list((remote_logs / "sub-02").rglob("*.*"))) == 2
    withdraw_participant(study, "sub-02", seal=None)
    assert sorted(path.name for path in remote_logs.iterdir()) == ["sub-01", STORE_FOLDER]


def test_annotations_made_on_two_machines_are_put_one_behind_the_other(study: Path, tmp_path: Path) -> None:
    other = copied(study, tmp_path / "other", tmp_path)
    logs = [next((one / "sub-01").rglob("*.mcap")) for one in (study, other)]
    for one in (study, other):
        (one.parent / STORE_URL_FILE_NAME).write_text(str(tmp_path / "logs"))
        sync_logs(one.parent, f"{STUDY}/")
    tags = iter(("first", "second", "third"))

    def annotate(log: Path) -> None:
        add_annotation(read_log(log), Annotation(next(tags), "2026-01-06T10:00:00Z", episode=1))

    def gather(*studies: Path) -> list[list[str]]:
        for one in studies:
            sync_logs(one.parent, f"{STUDY}/")
        return [[mark.tag for mark in read_annotations(log)] for log in logs]

    annotate(logs[0])
    assert gather(study, other) == [["first"], ["first"]]
    annotate(logs[0])
    annotate(logs[1])
    assert gather(study, other, study) == [["first", "second", "third"]] * 2
    assert gather(study, other) == [["first", "second", "third"]] * 2


def test_whoever_withdraws_is_in_no_table_of_the_store_and_in_no_folder_gathered_after(
    study: Path, url: str, tmp_path: Path
) -> None:
    store_tables(study)
    before, folder = stored(url), tmp_path / "analyst"
    fetch_tables(str(study), folder)
    (folder / "notes.txt").write_text("mine")
    theirs = {name for name in before if "participant=sub-02" in name}
    told = typed("withdraw", "sub-02", "--study", study, "--erase")
    assert told.exit_code == 0, told.exception
    assert f"; {len(theirs)} files of tables removed from the remote store" in told.stdout
    assert "gather --tables" in told.stdout
    assert stored(url) == before - theirs != before
    told = typed("gather", study, "--tables", folder)
    assert told.stdout == f"0 files of tables fetched, {len(theirs)} removed in {folder}\n"
    assert not [path for path in tmp_path.rglob("*") if "participant=sub-02" in str(path)]
    assert (folder / "notes.txt").read_text() == "mine"


@pytest.mark.nightly(by_day=["object store"])
def test_a_machine_that_had_not_heard_of_the_withdrawal_is_put_right(study: Path, url: str, tmp_path: Path) -> None:
    late = copied(study, tmp_path / "late", url)
    withdraw_participant(study, "sub-02", seal=None)
    store_tables(study)
    clean = stored(url)
    store_tables(late)
    assert sessions_of(stored(url) - clean) == {("sub-02", 1)}
    assert (store_tables(study) or (0, 0))[1] > 0
    assert stored(url) == clean
    (late / ENROLMENT_FILE_NAME).write_bytes((study / ENROLMENT_FILE_NAME).read_bytes())
    assert store_tables(late) == (0, 0)
    assert stored(url) == clean


def test_a_withdrawal_without_the_store_says_so_and_is_completed_later(
    study: Path, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store_tables(study)
    with monkeypatch.context() as away:
        if url.startswith("s3://"):
            away.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
            away.setenv("AWS_MAX_ATTEMPTS", "1")
        else:
            Path(url).rename(tmp_path / "unmounted")
        with pytest.raises(RemoteStoreError, match=r"sub-02 has withdrawn, and .* are gone .* run the command again"):
            withdraw_participant(study, "sub-02", seal=None)
    assert not (study / "sub-02").exists()
    if not url.startswith("s3://"):
        (tmp_path / "unmounted").rename(url)
    assert sessions_of(stored(url)) == {("sub-01", 1), ("sub-02", 1)}
    register = (study / ENROLMENT_FILE_NAME).read_bytes()
    assert (withdraw_participant(study, "sub-02", seal=None).partitions or 0) > 0
    assert sessions_of(stored(url)) == {("sub-01", 1)}
    assert (study / ENROLMENT_FILE_NAME).read_bytes() == register


def test_an_interrupted_run_leaves_whole_files_and_the_next_does_the_rest(two_people: Path, tmp_path: Path) -> None:
    tables, expected = new_folder(tmp_path / "tables"), new_folder(tmp_path / "expected")
    study = copied(two_people, tmp_path / "data", tables)
    store_tables(copied(study, tmp_path / "elsewhere", expected))
    killed = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from minihuman.dataset.remote_tables import store_tables\n"
        "left = [5]\n"
        "def hook(event, arguments):\n"
        "    if event == 'os.rename' and str(arguments[1]).endswith('.parquet'):\n"
        "        left[0] -= 1\n"
        "        if not left[0]: os._exit(9)\n"
        "sys.addaudithook(hook)\n"
        "store_tables(Path(sys.argv[1]))\n"
    )
    assert subprocess.run([sys.executable, "-c", killed, study], env=os.environ).returncode == 9
    whole = contents(tables)
    assert len(whole) == 4
    assert whole.items() < contents(expected).items()
    assert (tables / ".unfinished").is_file()
    assert store_tables(study) == (len(contents(expected)) - 4, 0)
    assert contents(tables) == contents(expected)
    assert {path.name for path in tables.rglob(".*")} == {".lock"}


@pytest.mark.nightly(by_day=["folder"])
def test_tables_of_another_selection_another_version_and_another_study_are_told_apart(
    study: Path, url: str, tmp_path: Path
) -> None:
    store, others = open_store(url), tmp_path / "others"
    export_study("hugging-face", study, others, Selection(with_=("unfinished",)))
    other_selection = {name for name in contents(others) if name.endswith(".parquet")}
    former = f"corridors/study={STUDY}/participant=sub-01/ses-01-{'0' * 16}.parquet"
    unknown = f"steps/study={STUDY}/participant=sub-77/ses-01-{'0' * 16}.parquet"
    elsewhere = f"steps/study=another/participant=sub-01/ses-01-{'0' * 16}.parquet"
    for name in other_selection:
        store.put(name, others / name)
    for name in (former, unknown, elsewhere, "README.md"):
        store.put(name, others / "README.md")
    counts = store_tables(study)
    assert counts == (len(other_selection), len(other_selection) + 1)
    left = stored(url)
    assert {unknown, elsewhere, "README.md"} < left
    assert left.isdisjoint({former, *other_selection})
    for name in (unknown, elsewhere, "README.md"):
        store.remove(name)
    check_rows(url, study, tmp_path)


@pytest.mark.nightly(by_day=["object store"])
def test_an_exported_hugging_face_data_set_has_the_same_files(study: Path, url: str, tmp_path: Path) -> None:
    store_tables(study)
    fetch_tables(url, tmp_path / "fetched")
    export_study("hugging-face", study, tmp_path / "exported", Selection())
    exported = {name: data for name, data in contents(tmp_path / "exported").items() if name.endswith(".parquet")}
    assert exported == contents(tmp_path / "fetched")


def test_each_file_states_its_digest_selection_and_version(study: Path, url: str, tmp_path: Path) -> None:
    chosen = Selection(participant=("sub-02",), with_=("unfinished",))
    for name, selection in (("all", Selection()), ("chosen", chosen)):
        export_study("hugging-face", study, tmp_path / name, selection)
    facts = {}
    for name in ("all", "chosen"):
        for path in (tmp_path / name / "episodes").rglob("*.parquet"):
            found = pa.parquet.read_schema(path).metadata
            assert found[b"partition_digest"].decode() in path.name
            assert found[b"minihuman_version"].decode() == minihuman.__version__
            facts[name] = found[b"selection"].decode(), found[b"selection_digest"].decode()
    assert facts["all"][0] == ""
    assert facts["chosen"][0] == "--participant sub-02 --with unfinished"
    assert facts["all"][1] != facts["chosen"][1]


def test_a_study_without_a_session_has_no_files(tmp_path: Path, url: str) -> None:
    data = new_folder(tmp_path / "data")
    (data / TABLES_URL_FILE_NAME).write_text(url)
    study = new_folder(data / STUDY)
    assert store_tables(study) == (0, 0)
    assert stored(url) == set()
    with pytest.raises(RemoteStoreError, match="has no tables; give another address"):
        fetch_tables(str(study), tmp_path / "analyst")


def test_a_log_that_cannot_be_read_is_named_and_its_tables_stay(study: Path, url: str) -> None:
    store_tables(study)
    before = stored(url)
    log = next((study / "sub-02").rglob("*.mcap"))
    log.write_bytes(b"not a log any more")
    told = typed("gather", study)
    assert told.stdout.splitlines()[-1] == "0 files of tables stored, 0 removed"
    assert f"skipped sub-02/ses-01/{log.name}" in told.stderr
    assert stored(url) == before


def test_without_a_store_no_tables_are_stored(tmp_path: Path) -> None:
    assert store_tables(new_folder(tmp_path / STUDY)) is None


def test_a_folder_that_is_not_there_and_a_study_of_another_name_are_errors(study: Path, tmp_path: Path) -> None:
    renamed = study.rename(study.with_name("renamed"))
    with pytest.raises(LogError, match="holds sessions of the study 'corridor'; name the folder like the study"):
        store_tables(renamed)
    (study.parent / TABLES_URL_FILE_NAME).write_text(str(tmp_path / "nowhere"))
    with pytest.raises(RemoteStoreError, match="it is not a folder; mount or create it"):
        store_tables(renamed)
    assert not (tmp_path / "nowhere").exists()


def test_long_sessions_are_handed_out_in_pieces_that_depend_on_them_alone(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_database, "_ROWS", 5)
    with StudyStore(StudySessions(study), with_shortest=False) as store:
        whole = store.tables.table("presses")
        found = {number: list(its) for number, its in store.tables.session_batches("presses", [1, 2])}
        assert list(store.tables.session_batches("presses", [])) == []
        assert {number: list(its) for number, its in store.tables.session_batches("presses", [2])} == {2: found[2]}
    assert pa.Table.from_batches([*found[1], *found[2]]).equals(whole)
    for batches in found.values():
        assert [len(batch) for batch in batches[:-1]] == [5] * (len(batches) - 1)
        assert len(batches) > 1


def test_duckdb_polars_arrow_and_pandas_answer_as_query_does(two_people: Path, tmp_path: Path) -> None:
    import polars as pl

    tables = new_folder(tmp_path / "tables")
    study = copied(two_people, tmp_path / "data", tables)
    store_tables(study)
    sql = (
        "SELECT participant, count(*) AS n, median(t_s) AS middle FROM steps GROUP BY participant ORDER BY participant"
    )
    with StudyStore(StudySessions(study), with_shortest=False) as store:
        expected = [tuple(row.values()) for row in store.tables.query(sql).to_pylist()]
        counts = {name: store.tables.count(name) for name in TABLES}
    assert [row[0] for row in expected] == ["sub-01", "sub-02"]
    with duckdb.connect() as connection:
        for name, count in counts.items():
            if count:
                connection.execute(f"CREATE VIEW {name} AS FROM read_parquet('{tables}/{name}/*/*/*.parquet')")
                assert connection.execute(f"SELECT count(*) FROM {name}").fetchall() == [(count,)]
        assert connection.execute(sql).fetchall() == expected
    frame = pl.scan_parquet(tables / "steps", hive_partitioning=True).group_by("participant")
    frame = frame.agg(pl.len().alias("n"), pl.col("t_s").median().alias("middle")).sort("participant").collect()
    assert frame.rows() == expected
    rows = pyarrow.dataset.dataset(tables / "steps", partitioning="hive").to_table().to_pylist()
    times = {code: [row["t_s"] for row in rows if row["participant"] == code] for code, *_ in expected}
    assert [(code, len(its), statistics.median(its)) for code, its in times.items()] == expected
    assert {row["study"] for row in rows} == {STUDY}
    as_documented = pd.read_parquet(tables / "steps", partitioning=None)
    medians = as_documented.groupby("participant")["t_s"].agg(["size", "median"])
    assert [tuple(row) for row in medians.itertuples()] == expected
