"""Somebody withdraws on one machine: after each other machine was started once, their words are nowhere any more."""

import random
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import duckdb
import psycopg
import pyarrow.parquet
import pytest

from minihuman import api
from minihuman.admin.enrolment_entries import SlotTaken, open_enrolment_log
from minihuman.admin.erasure_ledger import ErasureLedger, find_pending_machines
from minihuman.admin.local_copies import obey_withdrawals
from minihuman.admin.manifest import record_log_end, write_manifest
from minihuman.admin.recorded_outputs import NOTICE_FILE_NAME
from minihuman.admin.remote_logs import sync_logs
from minihuman.admin.status import list_problems
from minihuman.admin.verify.study import verify_manifest
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.cli.keep import gather
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.experiment.machine.events import Noted
from minihuman.log.record.mcap_recorder import McapRecorder, RecorderSettings
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner
from minihuman.storage.machine_identity import IDENTITY_FILE_NAME, read_machine_id
from minihuman.storage.remote_store import STORE_URL_FILE_NAME, TABLES_URL_FILE_NAME
from minihuman.storage.study_journals import URL_FILE_NAME
from tests.builders import STARTED_NS, events_of, session
from tests.counts import count
from tests.lab.database import database, fresh
from tests.lab.object_store import object_store
from tests.machine import needs

WORDS = "what sub-01 confided to the page"
KEPT = "what sub-02 wrote, who stays"


def record_session(data: Path, code: str, index: int, words: str) -> Path:
    """Record a session in which somebody writes something."""
    log = session(participant=code, index=index, blocks=("grid",), episodes=1)
    events = events_of(log)
    events.insert(-1, Noted(events[-1].t_ns, "remark", words))
    recorder = McapRecorder(data, log.plan, started_ns=STARTED_NS, settings=RecorderSettings(sync=lambda fd: None))
    recorder.write(events)
    path = recorder.close()
    assert path is not None
    return path


def find_words(folder: Path) -> list[str]:
    """The files below a folder that hold the words: as they are, or in compressed chunks, columns and pages."""
    return [
        str(path.relative_to(folder))
        for path in sorted(folder.rglob("*"))
        if path.is_file() and WORDS in read_all_text(path)
    ]


def read_all_text(path: Path) -> str:
    """Return a file's bytes as text, and behind them what is in it compressed."""
    text = path.read_bytes().decode("latin-1")
    if ".mcap" in path.name:
        with suppress(Exception):
            messages = [record for record in LogScanner(path) if isinstance(record, LogMessage)]
            text += b"".join(message.data for message in messages).decode("latin-1")
    elif path.suffix == ".parquet":
        text += str(pyarrow.parquet.read_table(path, partitioning=None).to_pylist())
    elif path.suffix == ".duckdb":
        with duckdb.connect(str(path), read_only=True) as connection:
            for schema, table in connection.execute("SELECT schema_name, table_name FROM duckdb_tables()").fetchall():
                text += str(connection.execute(f'FROM "{schema}"."{table}"').fetchall())
    return text


class Study:
    """Three machines of one study, with two participants, whose data each machine has."""

    def __init__(self, folder: Path, urls: dict[str, str]) -> None:
        self.folder = folder
        self.machines = [folder / name for name in ("a", "b", "c")]
        for data in self.machines:
            data.mkdir(parents=True)
            for name, url in urls.items():
                (data / name).write_text(f"{url}\n")
        logs = [record_session(self.machines[0], f"sub-0{n + 1}", n, (WORDS, KEPT)[n]) for n in range(2)]
        self.name = logs[0].parents[2].name
        slots = (SlotTaken("0" * 64, 2, n, f"sub-0{n + 1}", "grid_first", False, at="2026") for n in range(2))
        with open_enrolment_log(self.machines[0] / self.name).hold() as register:
            register.append(*slots)
        for log in logs:
            record_log_end(log)
        for data in self.machines:
            gather(str(data / self.name))
            with StudyStore(StudySessions(data / self.name), with_shortest=False):
                pass
        api.export("csv", self.machines[2] / self.name, folder / "export")

    def run(self, data: Path, command: str) -> None:
        """Start a command on a machine that has heard of no withdrawal yet."""
        study = data / self.name
        match command:
            case "gather":
                gather(str(study))
            case "status":
                obey_withdrawals(study)
                list_problems(study)
            case "verify":
                assert list(api.verify(study))
            case "export":
                api.export("csv", study, data / "export")
            case "serve":
                obey_withdrawals(study, ask_store=True)


@pytest.fixture(autouse=True)
def closed_connections(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Close the connections of an order: its machines' processes would end, and a database server admits a hundred."""
    connections = []
    connect = psycopg.connect

    def connect_and_keep(*arguments, **settings):
        connections.append(connect(*arguments, **settings))
        return connections[-1]

    monkeypatch.setattr(psycopg, "connect", connect_and_keep)
    yield
    for connection in connections:
        connection.close()


@pytest.fixture(scope="module")
def servers() -> Iterator[tuple[str, str]]:
    """A database's address and a bucket's."""
    with database() as url, object_store() as bucket:
        yield url, bucket


@pytest.mark.program
@pytest.mark.nightly(sample=True)
@needs("postgresql")
@pytest.mark.parametrize("seed", range(count(1, 100)))
def test_words_are_nowhere_once_each_machine_was_started_and_status_names_it_until_then(
    servers: tuple[str, str], tmp_path: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(seed)
    database_url = fresh(servers[0])
    bucket = f"{servers[1]}/{tmp_path.name}"
    urls = {URL_FILE_NAME: database_url, STORE_URL_FILE_NAME: bucket, TABLES_URL_FILE_NAME: f"{bucket}-tables"}
    study = Study(tmp_path / "machines", urls)
    assert len(find_words(tmp_path / "machines")) > 3
    known = {entry.machine for entry in ErasureLedger(study.machines[0] / study.name, ask_store=False).read()}
    assert known == {read_machine_id(data) for data in study.machines}  # each since it was first gathered on
    first, *others = rng.sample(study.machines, 3)
    withdrawal = withdraw_participant(first / study.name, "sub-01", seal=None)
    for position, data in enumerate(others):
        numbers = [read_machine_id(machine)[:8] for machine in others[position:]]
        pending = "\n".join(find_pending_machines(first / study.name))
        assert [number in pending for number in numbers] == [True] * len(numbers)
        assert position or all(number in "\n".join(withdrawal.left) for number in numbers)
        study.run(data, rng.choice(("gather", "status", "verify", "export", "serve")))
    assert find_pending_machines(first / study.name) == ()
    left = find_words(tmp_path / "machines")
    assert [path for path in left if not path.startswith("export/")] == []  # which is named, and cannot be undone
    assert "sub-01" in (tmp_path / "machines" / "export" / NOTICE_FILE_NAME).read_text()
    import boto3

    client = boto3.client("s3")
    objects = client.list_objects_v2(Bucket="studies", Prefix=tmp_path.name).get("Contents", [])
    for number, stored in enumerate(objects):
        copy = tmp_path / "objects" / f"{number}{Path(stored['Key']).suffix}"
        copy.parent.mkdir(exist_ok=True)
        client.download_file("studies", stored["Key"], str(copy))
    assert find_words(tmp_path / "objects") == []
    with psycopg.connect(database_url) as connection:
        for table in ("minihuman_lines", "minihuman_leases", "minihuman_log_copies"):
            exists = connection.execute("SELECT to_regclass(%s)", [table]).fetchone()
            if exists and exists[0]:
                assert WORDS.encode().hex() not in str(
                    connection.execute(f"SELECT {table}::text FROM {table}").fetchall()
                )
    assert all(list((data / study.name).glob("sub-02/*/*.mcap")) for data in study.machines)


@pytest.mark.parametrize("kind", ["store", "store and no enrolment log"])
def test_machines_that_share_only_a_store_hear_of_a_withdrawal_when_they_gather(tmp_path: Path, kind: str) -> None:
    shelf = tmp_path / "shelf"
    shelf.mkdir()
    here, there = (tmp_path / name for name in ("here", "there"))
    for data in (here, there):
        data.mkdir()
        (data / STORE_URL_FILE_NAME).write_text(f"{shelf}\n")
    log = record_session(here, "sub-01", 0, WORDS)
    study = log.parents[2].name
    for data in (here, there) if kind == "store" else (here,):
        with open_enrolment_log(data / study).hold() as register:
            register.append(SlotTaken("0" * 64, 2, 0, "sub-01", "grid_first", False))
    sync_logs(here, f"{study}/")
    sync_logs(there, f"{study}/")
    obey_withdrawals(there / study, ask_store=True)
    assert find_words(there)
    withdrawal = withdraw_participant(here / study, "sub-01", seal=None)
    assert read_machine_id(there)[:8] in "\n".join(withdrawal.left)
    lines: list[str] = []
    obey_withdrawals(there / study, ask_store=True, say=lines.append)
    assert lines == ["sub-01 has withdrawn: their data were erased on this machine"]
    assert find_words(tmp_path) == []
    obey_withdrawals(here / study, ask_store=True)
    assert find_pending_machines(here / study) == ()
    sync_logs(there, f"{study}/")
    assert find_words(tmp_path) == []


def test_a_copy_that_comes_back_from_a_backup_is_erased_again(tmp_path: Path) -> None:
    log = record_session(tmp_path / "data", "sub-01", 0, WORDS)
    content = log.read_bytes()
    study = log.parents[2]
    with open_enrolment_log(study).hold() as register:
        register.append(SlotTaken("0" * 64, 2, 0, "sub-01", "grid_first", False))
    write_manifest(study)
    withdraw_participant(study, "sub-01", seal=None)
    assert ("1 files of sub-01 are gone: sub-01 withdrew after the manifest was made", True) in list(
        verify_manifest(study, str(study / "seal.json"))
    )
    log.parent.mkdir(parents=True)
    log.write_bytes(content)
    assert list(api.verify(study))
    assert find_words(tmp_path) == []


def test_a_database_that_withdraws_a_path_erases_nothing(tmp_path: Path) -> None:
    log = record_session(tmp_path / "data", "sub-01", 0, KEPT)
    study = log.parents[2]
    (study / "register.jsonl").write_text(
        '{"withdrawn":"../study","at":"","kept":"erased"}\n{"withdrawn":"sub-01/../..","at":"","kept":"erased"}\n'
    )
    with pytest.raises(ValueError, match="is not a participant code"):
        obey_withdrawals(study)
    assert log.exists()


def test_a_copied_data_folder_is_another_machine(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for data in (one, other):
        data.mkdir()
    number = read_machine_id(one)
    (other / IDENTITY_FILE_NAME).write_bytes((one / IDENTITY_FILE_NAME).read_bytes())
    assert read_machine_id(one) == number != read_machine_id(other)
    one.rename(tmp_path / "moved")
    assert read_machine_id(tmp_path / "moved") == number
