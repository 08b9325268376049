"""Finished logs on a shelf that several machines share: in a folder, and in a store that speaks S3's protocol."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from minihuman.admin.recruitment import ParticipantArrived, hash_link_token
from minihuman.admin.remote_store import STORE_URL_FILE_NAME, RemoteStoreError, open_remote_store, sync_logs, upload_log
from minihuman.admin.verify.log import find_log_differences
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.dataset.journal import ENROLMENT_FILE_NAME
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate
from minihuman.web.arrivals import Arrival, Arrivals, Rejection
from minihuman.worlds.adapters.world import World
from tests.web.protocols import study


@pytest.fixture(scope="module")
def store() -> Iterator[str]:
    """A bucket's address; the store is moto's, in this process."""
    server = pytest.importorskip("moto.server")
    boto3 = pytest.importorskip("boto3")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=port, verbose=False)
    running.start()
    given = {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
        "AWS_ACCESS_KEY_ID": "tester",
        "AWS_SECRET_ACCESS_KEY": "tester",
        "AWS_DEFAULT_REGION": "us-east-1",
    }
    before = dict(os.environ)
    os.environ.update(given)
    try:
        boto3.client("s3").create_bucket(Bucket="studies")
        yield "s3://studies"
    finally:
        running.stop()
        os.environ.clear()
        os.environ.update(before)


@pytest.fixture(params=["folder", pytest.param("store", marks=pytest.mark.program)])
def machines(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path]:
    """The data folders of two machines with one shelf."""
    shelf = str(tmp_path / "shelf")
    if request.param == "store":
        shelf = f"{request.getfixturevalue('store')}/{tmp_path.name}"
    folders = tmp_path / "one", tmp_path / "other"
    for folder in folders:
        folder.mkdir()
        (folder / STORE_URL_FILE_NAME).write_text(f"{shelf}\n")
    return folders


def played(data: Path, folder: Path) -> Path:
    """A session, simulated on a machine."""
    protocol = decode_protocol(study(folder, max_steps=4).read_bytes())
    [log] = simulate(protocol, data, participants=1, seed=1, player="random")
    return log


def test_a_log_finished_on_one_machine_is_had_on_another(machines: tuple[Path, Path], tmp_path: Path) -> None:
    here, there = machines
    log = played(here, tmp_path)
    assert sync_logs(there, "tried/") == (1, 0)
    [brought] = there.rglob("*.mcap")
    assert brought.relative_to(there) == log.relative_to(here)
    assert brought.read_bytes() == log.read_bytes()
    assert list(find_log_differences(brought, World)) == []
    assert sync_logs(there, "tried/") == (0, 0)
    assert sync_logs(there, "another/") == (0, 0)


def test_what_is_put_there_again_takes_its_place(machines: tuple[Path, Path], tmp_path: Path) -> None:
    here, _ = machines
    log = played(here, tmp_path)
    log.write_bytes(b"longer than it was" * 10)
    upload_log(log)
    shelf = open_remote_store(here)
    assert shelf is not None
    shelf.fetch("tried/sub-01/ses-01/sub-01_ses-01.mcap", tmp_path / "again" / "log")
    assert (tmp_path / "again" / "log").read_bytes() == log.read_bytes()
    assert [path.name for path in (tmp_path / "again").iterdir()] == ["log"]


def test_what_could_not_be_put_there_is_put_there_later(machines: tuple[Path, Path], tmp_path: Path) -> None:
    here, there = machines
    url = (here / STORE_URL_FILE_NAME).read_text()
    (here / STORE_URL_FILE_NAME).unlink()
    log = played(here, tmp_path)
    (here / STORE_URL_FILE_NAME).write_text(url)
    assert sync_logs(here, "tried/") == (0, 1)
    assert sync_logs(there, "tried/") == (1, 0)
    with log.open("ab") as file:
        file.write(b"another segment")
    assert sync_logs(here, "tried/sub-01/") == (0, 1)
    assert sync_logs(there, "tried/sub-01/") == (1, 0)


def test_whoever_withdraws_is_on_no_shelf(machines: tuple[Path, Path], tmp_path: Path) -> None:
    here, there = machines
    played(here, tmp_path)
    withdraw_participant(here / "tried", "sub-01", seal=None)
    assert sync_logs(there, "tried/") == (0, 0)


def test_whoever_withdraws_is_put_on_no_shelf_again(machines: tuple[Path, Path], tmp_path: Path) -> None:
    here, there = machines
    log = played(here, tmp_path)
    assert sync_logs(there, "tried/") == (1, 0)
    [kept] = there.rglob("*.mcap")
    withdraw_participant(here / "tried", "sub-01", seal=None)
    register = (here / "tried" / ENROLMENT_FILE_NAME).read_bytes()
    (there / "tried" / ENROLMENT_FILE_NAME).write_bytes(register)  # as a database would have it everywhere
    assert sync_logs(there, "tried/") == (0, 0)
    upload_log(kept)
    assert sync_logs(here, "tried/") == (0, 0)
    assert not log.exists()
    shelf = open_remote_store(there)
    assert shelf is not None
    shelf.put("tried/sub-01/ses-01/sub-01_ses-01.mcap", kept)  # by a machine that had not heard of it
    assert sync_logs(here, "tried/sub-01/") == (0, 0)
    assert not log.exists()


def test_what_is_not_there_is_said_in_one_line(machines: tuple[Path, Path], tmp_path: Path) -> None:
    shelf = open_remote_store(machines[0])
    assert shelf is not None
    assert shelf.sizes("") == {}
    with pytest.raises(RemoteStoreError, match=r"nothing\.mcap cannot be fetched"):
        shelf.fetch("nothing.mcap", tmp_path / "nothing")
    assert not (tmp_path / "nothing").exists()


def test_without_a_shelf_logs_stay_where_they_are(tmp_path: Path) -> None:
    log = played(tmp_path / "data", tmp_path)
    upload_log(log)
    assert sync_logs(tmp_path / "data", "") == (0, 0)


def test_who_has_taken_part_on_one_machine_has_done_so_on_another(machines: tuple[Path, Path], tmp_path: Path) -> None:
    here, there = machines
    played(here, tmp_path)
    protocol = decode_protocol((tmp_path / "tried.toml").read_bytes())
    recruits = Arrivals(protocol, there).recruits  # as a database would have them everywhere
    (token,) = recruits.issue(1)
    with recruits.exclusive() as arrivals:
        arrivals.write(ParticipantArrived(hash_link_token(token), "sub-01", arrivals.now()))
    assert Arrivals(protocol, there).arrive(Arrival(token)) == Rejection("finished", "complete")
