"""Caches that another program changed: no number of theirs is believed, a line says so, and verify names the cells."""

import logging
import os
import random
import shutil
from collections.abc import Iterator
from pathlib import Path

import duckdb
import msgspec
import pytest
from click.testing import CliRunner

from minihuman.admin import session_index
from minihuman.admin.manifest import MANIFEST_FILE_NAME, find_changed_files, write_manifest
from minihuman.admin.session_index import SessionRow, read_session_index
from minihuman.api import export, report, simulate, verify
from minihuman.cli.command_line import make_command_line
from minihuman.dataset import caches, row_writer
from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_database import LOG_COLUMNS, TableDatabase
from minihuman.dataset.table_queries import find_queried_tables
from tests.builders import session, write_log
from tests.counts import count
from tests.study.studies import two_days

pytestmark = pytest.mark.program  # whole studies are simulated

Rows = dict[str, list[dict[str, object]]]
CHANGED = "was changed by another program"


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("data")
    for index in range(3):
        one = session(participant=f"sub-0{index + 1}", index=index, seed=index, blocks=("grid",), episodes=2)
        write_log(one, data)
    tables(data / "transfer")
    list(read_session_index(data / "transfer"))
    return data / "transfer"


@pytest.fixture
def study(played: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(played, tmp_path / "transfer"))


def tables(study: Path, names: tuple[str, ...] = tuple(TABLES)) -> tuple[Rows, list[str]]:
    """The rows, and what was said while they were read."""
    sessions = StudySessions(study, processes=1)
    with StudyStore(sessions, with_shortest=False, tables=names) as opened:
        return {name: opened.tables.table(name).to_pylist() for name in names}, sessions.account.notes


def index(study: Path) -> list[tuple[Path, object, str]]:
    return [(row.path.relative_to(study), row.summary, row.problem) for row in _rows(study)]


def _rows(study: Path) -> Iterator[SessionRow]:
    return read_session_index(study)


def edit(study: Path, sql: str) -> None:
    with duckdb.connect(str(study / TABLE_CACHE)) as cache:
        cache.execute(sql)


def some_edit(rng: random.Random, cache: duckdb.DuckDBPyConnection) -> str:
    """One statement that changes, adds or takes away something of a table's rows, or of how a table is read."""
    filled = [name for name in TABLES if cache.execute(f"SELECT count(*) FROM kept.{name}").fetchall() != [(0,)]]
    table = f"kept.{rng.choice([*filled, 'logs'])}"
    columns = cache.execute(
        "SELECT column_name, data_type FROM duckdb_columns() WHERE schema_name || '.' || table_name = ?", (table,)
    ).fetchall()
    ((rows,),) = cache.execute(f"SELECT count(*) FROM {table}").fetchall()
    at = f"rowid = (SELECT rowid FROM {table} LIMIT 1 OFFSET {rng.randrange(rows)})"
    column, kind = rng.choice(columns)
    changed = {
        "VARCHAR": f"coalesce(\"{column}\", '') || 'x'",
        "BOOLEAN": f'NOT coalesce("{column}", false)',
        "BLOB": f"\"{column}\" || 'x'::BLOB",
        "UBIGINT[]": f'list_append("{column}", 1)',
    }.get(kind, f'coalesce("{column}", 0) + 1')
    if column == "digest":
        changed = f"xor({column}, 1)"
    view = rng.choice(filled)
    return rng.choice(
        [
            f'UPDATE {table} SET "{column}" = {changed} WHERE {at}',
            f'UPDATE {table} SET "{column}" = {changed} WHERE {at}',
            f'UPDATE {table} SET "{column}" = {changed}',
            f"DELETE FROM {table} WHERE {at}",
            f"DELETE FROM {table}",
            f"INSERT INTO {table} SELECT * FROM {table} WHERE {at}",
            f"INSERT INTO {table} SELECT * REPLACE (log + 10 AS log) FROM {table} WHERE {at}",
            f"UPDATE {table} SET log = (SELECT min(log) + max(log) FROM {table}) - log",
            f"CREATE OR REPLACE VIEW {view} AS SELECT * FROM kept.{view} LIMIT 1",
            "CREATE MACRO coalesce(a, b) AS b" if rng.random() < 0.5 else "CREATE MACRO count(x) AS 7",
            "UPDATE kept.made_by SET version = 'x'",
        ]
    )


def test_no_edit_of_the_table_cache_is_believed(study: Path) -> None:
    rng = random.Random(26)
    expected, notes = tables(study)
    assert notes == []
    for number in range(count(10, 500)):
        with duckdb.connect(str(study / TABLE_CACHE)) as cache:
            sql = some_edit(rng, cache)
            cache.execute(sql)
        found, notes = tables(study)
        assert found == expected, (number, sql)
        assert len(notes) == ("made_by" not in sql), (number, sql, notes)
        assert tables(study) == (expected, []), (number, sql)


def test_a_session_that_is_in_the_cache_twice_is_made_anew_once(study: Path) -> None:
    expected, _ = tables(study)
    edit(study, "INSERT INTO kept.logs SELECT * FROM kept.logs WHERE log = 2")
    found, notes = tables(study)
    assert (found, len(notes)) == (expected, 1)
    assert tables(study) == (expected, [])


def test_no_edit_of_the_session_index_is_believed(study: Path, caplog: pytest.LogCaptureFixture) -> None:
    rng = random.Random(26)
    expected = index(study)
    for number in range(count(20, 500)):
        with duckdb.connect(str(study / TABLE_CACHE)) as cache:
            described = cache.execute("DESCRIBE session_index.sessions").fetchall()
            column, kind = rng.choice([(name, kind) for name, kind, *_ in described])
            longer = f'("{column}" || 1)::{kind}'
            changes = {"VARCHAR": [longer, "'x'", "''"], "BOOLEAN": [f'NOT "{column}"']}.get(kind, [longer, "7", "1e9"])
            change = rng.choice([*changes, "NULL"])
            at = f"rowid = {rng.choice(cache.execute('SELECT rowid FROM session_index.sessions').fetchall())[0]}"
            before = cache.execute(f'SELECT "{column}" FROM session_index.sessions WHERE {at}').fetchall()
            cache.execute(f'UPDATE session_index.sessions SET "{column}" = {change} WHERE {at}')
            is_other = cache.execute(f'SELECT "{column}" FROM session_index.sessions WHERE {at}').fetchall() != before
        caplog.clear()
        with caplog.at_level(logging.WARNING, "minihuman"):
            assert index(study) == expected, (number, column, change)
        assert [CHANGED in line for line in caplog.messages] == [True] * is_other
    for sql in (
        "DELETE FROM session_index.sessions WHERE participant = 'sub-02'",
        "INSERT INTO session_index.sessions FROM session_index.sessions WHERE participant = 'sub-02'",
        "ALTER TABLE session_index.sessions DROP steps",
        "ALTER TABLE session_index.sessions ALTER steps TYPE TEXT",
        "DROP TABLE session_index.sessions",
        "DROP TABLE session_index.sessions; CREATE VIEW session_index.sessions AS SELECT 1 AS log",
    ):
        edit(study, sql)
        assert index(study) == expected, sql
        caplog.clear()
        assert index(study) == expected
        assert caplog.messages == []


def test_the_digests_of_the_tables_that_are_read_are_compared_and_of_no_others(study: Path) -> None:
    expected, _ = tables(study)
    edit(study, "UPDATE kept.steps SET reward = 5 WHERE log = 2")
    found, notes = tables(study, ("episodes",))
    assert (found["episodes"], notes) == (expected["episodes"], [])
    found, notes = tables(study, ("steps",))
    assert found["steps"] == expected["steps"]
    assert [CHANGED in note and "1 session" in note for note in notes] == [True]
    sessions = StudySessions(study, processes=1)
    with StudyStore(sessions, with_shortest=False, tables=("blocks",)) as opened:
        for read in (lambda: opened.tables.table("steps"), lambda: opened.tables.query("select reward from steps")):
            with pytest.raises(AssertionError, match="not opened for steps"):
                read()


@pytest.mark.parametrize(
    ("sql", "names"),
    [
        ("select * from steps", {"steps"}),
        ("FROM Episodes", {"episodes"}),
        ("with a as (select * from keys) select * from a join blocks on a.block = blocks.block", {"keys", "blocks"}),
        ("select max(reward) from kept.steps", {"steps"}),
        ("summarize presses", {"presses"}),
        ("select * from query_table('st' || 'eps')", set(TABLES)),
        ("select * from query('from ' || 'steps')", set(TABLES)),
        ("pivot steps on action using count(*)", set(TABLES)),
        ("nonsense", set(TABLES)),
        ("select * from nowhere, plan", {"plan"}),
        ("select * from steps join plan using (episode)", set(TABLES)),  # which DuckDB does not tell of this
        ("export database 'x'", set(TABLES)),
    ],
)
def test_the_tables_that_a_query_reads_are_found(sql: str, names: set[str]) -> None:
    assert find_queried_tables(sql) == names


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(make_command_line(), [str(word) for word in words])
    return done.exit_code, done.output


def test_verify_finds_forged_digests_in_both_caches(study: Path) -> None:
    assert run("verify", "--tables", study)[0] == 0
    with TableDatabase(study / TABLE_CACHE) as cache:
        cache.connection.execute("UPDATE kept.steps SET reward = 5 WHERE log = 2 AND row = 3")
        place = list(TABLES).index("steps") + 1
        digest = cache.digest_rows("steps")[2]
        cache.connection.execute(
            f"UPDATE kept.logs SET row_digests = row_digests[:{place - 1}] || [{digest}::UBIGINT] "
            f"|| row_digests[{place + 1}:] WHERE log = 2"
        )
        cache.connection.execute(f"UPDATE kept.logs SET digest = hash({LOG_COLUMNS})")
    assert 5 in {row["reward"] for row in tables(study)[0]["steps"]}, "the digests are not those that are compared"
    code, said = run("verify", "--tables", study)
    assert code == 1
    assert "table steps, sub-02/ses-01/sub-02_ses-01.mcap, row 3, reward is 5.0; the logs say 0.0" in said
    assert len(said.splitlines()) == 1


def test_verify_finds_a_row_of_the_session_index_that_was_changed(study: Path) -> None:
    edit(study, "UPDATE session_index.sessions SET steps = 7 WHERE participant = 'sub-02'")
    code, said = run("verify", "--tables", study)
    assert code == 1
    assert '"steps" is 7; the logs say' in said


def test_a_log_changed_in_its_middle_with_its_size_and_time_kept_is_found_by_verify(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(caches, "_END_BYTES", 64)  # the log is short
    (study / TABLE_CACHE).unlink()
    expected = tables(study)
    log = next(study.glob("sub-02/*/*.mcap"))
    facts, content = log.stat(), bytearray(log.read_bytes())
    content[len(content) // 2] ^= 1
    log.write_bytes(content)
    os.utime(log, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert tables(study) == expected, "the change is not in the middle"
    code, said = run("verify", "--tables", study)
    assert code == 1
    assert f"{log} cannot be read" in said
    assert f"{log.relative_to(study)}: the log says otherwise than the account and episode facts" in said


@pytest.mark.parametrize("at", [10, -10])
def test_a_log_changed_at_its_head_or_end_with_its_size_and_time_kept_is_not_read_from_the_cache(
    study: Path, at: int
) -> None:
    log = next(study.glob("sub-02/*/*.mcap"))
    facts, content = log.stat(), bytearray(log.read_bytes())
    content[at] ^= 1
    log.write_bytes(content)
    os.utime(log, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert {row["participant"] for row in tables(study)[0]["participants"]} == {"sub-01", "sub-03"}


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    protocol = folder / "days.toml"
    protocol.write_text(two_days("minihuman/MiniGrid-Empty-5x5-v0", ["left", "right", "forward"]))
    list(simulate(protocol, participants=3, data=folder / "sessions", player="random"))
    return folder / "sessions" / "days"


def test_verify_recomputes_a_report_and_exports_and_names_a_cell_that_differs(simulated: Path, tmp_path: Path) -> None:
    study = Path(shutil.copytree(simulated, tmp_path / "days"))
    outputs = [tmp_path / name for name in ("report", "csv", "parquet")]
    report(study, outputs[0])
    for folder in outputs[1:]:
        export(folder.name, study, folder)
    (line,) = verify(study, tables=True, outputs=outputs)
    assert line.ok, line.text
    edits = (
        (outputs[0] / "report.html", "6 sessions", "7 sessions"),
        (outputs[0] / "tables" / "episodes.csv", '"timeout"', '"goal"'),
        (outputs[1] / "steps.csv", "forward", "left"),
    )
    for page, old, new in edits[: count(1, 3)]:
        whole = page.read_text()
        assert old in whole
        page.write_text(whole.replace(old, new, 1))
        lines = list(verify(study, tables=True, outputs=outputs))
        assert [line.ok for line in lines] == [False]
        assert str(page) in lines[0].text
        page.write_text(whole)
    (outputs[2] / "keys.parquet").unlink()
    (line,) = verify(study, tables=True, outputs=outputs[count(2, 0) :])
    assert (line.ok, line.text) == (False, f"{outputs[2] / 'keys.parquet'} is missing")


@pytest.mark.nightly
def test_nothing_written_names_a_folder_outside_the_study(simulated: Path, tmp_path: Path) -> None:
    """A login name stands in most paths; in a private folder, of a name that nothing else is written with."""
    home = tmp_path / "home-of-jane-doe"
    study = Path(shutil.copytree(simulated, home / "days"))
    (study / "sub-09").mkdir()
    (study / "sub-09" / "damaged.mcap").write_bytes(b"not a log")
    (study / "sub-09" / "cut.mcap").write_bytes(next(study.rglob("*ses-01.mcap")).read_bytes()[:3000])
    out = home / "out"
    app = [
        ("query", study, "select count(*) from steps"),
        ("status", study),
        ("report", study, "--out", out / "report"),
        ("plot", study, "--out", out / "plot"),
        *(("export", kind, study, out / kind) for kind in ("csv", "parquet", "bids", "imitation")),
        ("withdraw", "sub-02", "--study", study, "--erase"),
        ("manifest", study),
    ]
    for words in app:
        code, said = run(*words)
        assert code == 0, (words, said)
    written = [path for path in home.rglob("*") if path.is_file()]
    assert len(written) > 30
    named = [path for path in written if any(word in _text(path) for word in (b"jane-doe", str(tmp_path).encode()))]
    assert named == []


def _text(path: Path) -> bytes:
    """A file's bytes, and in a database the cells, which it may compress."""
    content = path.read_bytes()
    if path.name == TABLE_CACHE:
        with duckdb.connect(str(path), read_only=True) as cache:
            names = cache.execute("SELECT schema_name || '.' || table_name FROM duckdb_tables()").fetchall()
            content += b"".join(repr(cache.execute(f"FROM {name}").fetchall()).encode() for (name,) in names)
    if path.suffix == ".parquet":
        content += duckdb.sql(f"FROM '{path}'").fetchall().__repr__().encode()
    return content


def flipped(whole: bytes, chance: random.Random) -> bytes:
    place = chance.randrange(len(whole))
    return whole[:place] + bytes([whole[place] ^ 1 << chance.randrange(8)]) + whole[place + 1 :]


@pytest.mark.nightly(by_day=["index-1200"])
@pytest.mark.parametrize(("what", "full"), [("tables", 300), ("index", 1_200)])
def test_a_flipped_bit_of_a_cache_changes_no_number(study: Path, what: str, full: int) -> None:
    read = (lambda: tables(study)[0]) if what == "tables" else (lambda: index(study))
    cache = study / TABLE_CACHE
    if what == "index":
        cache.unlink()
    expected, chance = read(), random.Random(4)
    whole = cache.read_bytes()
    for _ in range(count(full // 30, full)):
        cache.write_bytes(flipped(whole, chance))
        assert read() == expected


@pytest.mark.nightly(sample=True)
def test_a_flipped_bit_of_a_manifest_is_named_or_without_effect(study: Path) -> None:
    write_manifest(study)
    path, chance = study / MANIFEST_FILE_NAME, random.Random(5)
    whole, named = path.read_bytes(), 0
    flips = count(100, 1_500)
    for _ in range(flips):
        path.write_bytes(flipped(whole, chance))
        said = list(find_changed_files(study, str(path)))
        named += bool(said)
        assert (
            said or path.read_bytes() == whole or msgspec.json.decode(path.read_bytes()) == msgspec.json.decode(whole)
        )
    print(f"\n{named} of {flips} flips named")


def test_rows_are_compared_with_their_digests_once(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Until the file changes, or other tables are read."""
    compared: list[str] = []
    really = TableDatabase.find_changed

    def counting(self: TableDatabase, name: str) -> set[int]:
        compared.append(name)
        return really(self, name)

    def read(*names: str) -> set[str]:
        compared.clear()
        tables(study, names)
        return set(compared)

    monkeypatch.setattr(TableDatabase, "find_changed", counting)
    assert {"episodes", "participants"} == read("episodes")
    assert read("episodes") == set()
    assert read("episodes", "steps") == {"steps"}
    assert read("steps") == set()
    write_log(session(participant="sub-04", index=3, seed=3, blocks=("grid",), episodes=2), study.parent)
    list(read_session_index(study))  # it is stored in the same file
    assert read("steps") == set(), "a session more, or the index's own rows, made everything be compared again"
    assert read("steps") == set()
    edit(study, "UPDATE kept.steps SET reward = 5 WHERE log = 2")
    assert read("steps") >= {"steps", "episodes"}
    assert 5 not in {row["reward"] for row in tables(study, ("steps",))[0]["steps"]}
    facts = (study / TABLE_CACHE).stat()
    edit(study, "UPDATE kept.steps SET reward = 5 WHERE log = 2")
    os.utime(study / TABLE_CACHE, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert 5 not in {row["reward"] for row in tables(study, ("steps",))[0]["steps"]}


def test_a_study_that_was_copied_with_its_caches_is_not_read_again(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = tables(study)
    copy = Path(shutil.copytree(study, tmp_path / "copy" / "transfer"))
    monkeypatch.setattr(row_writer, "read_session_rows", None)
    monkeypatch.setattr(session_index, "summarize_session", None)
    assert tables(copy) == expected
    assert index(copy) == index(study)
