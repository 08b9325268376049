"""Finished logs on a shelf that several machines share: in a folder, and in a store that speaks S3's protocol."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.recruitment import ParticipantArrived, hash_link_token
from minihuman.admin.remote_logs import sync_logs, upload_log
from minihuman.admin.status import list_problems
from minihuman.admin.verify.log import find_log_differences
from minihuman.admin.verify.study import verify_enrolment
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.experiment.machine.inputs import Stop
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.disk import GroupCommit
from minihuman.log.salvage.summary_section import LogSummary, read_summary
from minihuman.runtime.simulated_session import simulate
from minihuman.storage.remote_store import (
    STORE_URL_FILE_NAME,
    RemoteStoreConflictError,
    RemoteStoreError,
    open_remote_store,
)
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from minihuman.storage.system import now_text
from minihuman.web.arrivals import Arrival, Arrivals, Rejection
from minihuman.web.hosted_session import HostStorage, start_host
from minihuman.web.outbox import PageSettings
from minihuman.worlds.adapters.world import World
from tests.lab.object_store import object_store
from tests.web.page_model import PageModel
from tests.web.protocols import study


@pytest.fixture(scope="module")
def store() -> Iterator[str]:
    with object_store() as address:
        yield address


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


def played(data: Path, folder: Path, *, seed: int = 1) -> Path:
    """A session, simulated on a machine."""
    protocol = decode_protocol(study(folder, max_steps=4).read_bytes())
    [log] = simulate(protocol, data, participants=1, seed=seed, player="random")
    return log


def played_in_two(data: Path, folder: Path, *, upload: bool = False, keep_first: Path | None = None) -> Path:
    """A session that was ended early and resumed."""
    protocol = decode_protocol(study(folder, max_steps=4).read_bytes())
    for segment in (1, 2):
        plan = plan_next_session(protocol, data, participant=None if segment == 1 else "sub-01")
        made = start_host(
            plan,
            HostStorage(protocol, data, GroupCommit()),
            {"window": "web"},
            PageSettings((96, 96)),
            at_sync=lambda: None,
        )
        PageModel(made.host, [(400_000_000, "enter", True), (800_000_000, "1", True)], frame_ns=16_000_000).run()
        made.host.stop(Stop(2_000_000_000, "quit", ""))
        log = made.recorder.close()
        made.host.close()
        assert log is not None
        if upload:
            record_log_end(log)
        if segment == 1 and keep_first is not None:
            keep_first.write_bytes(log.read_bytes())
    return log


def summary(log: Path) -> LogSummary:
    found = read_summary(log)
    assert found is not None
    return found


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


def test_a_log_that_has_grown_takes_the_place_of_the_one_that_it_continues(
    machines: tuple[Path, Path], tmp_path: Path
) -> None:
    here, there = machines
    log = played_in_two(here, tmp_path, upload=True)
    assert sync_logs(there, "tried/") == (1, 0)
    [brought] = there.rglob("*.mcap")
    assert brought.read_bytes() == log.read_bytes()
    assert [start["segment"] for start in summary(brought).starts] == ["1", "2"]


def test_what_could_not_be_put_there_is_put_there_later(machines: tuple[Path, Path], tmp_path: Path) -> None:
    here, there = machines
    url = (here / STORE_URL_FILE_NAME).read_text()
    (here / STORE_URL_FILE_NAME).unlink()
    earlier = tmp_path / "earlier.mcap"
    log = played_in_two(here, tmp_path, keep_first=earlier)
    (here / STORE_URL_FILE_NAME).write_text(url)
    whole = log.read_bytes()
    log.write_bytes(earlier.read_bytes())
    assert sync_logs(here, "tried/") == (0, 1)
    assert sync_logs(there, "tried/") == (1, 0)
    log.write_bytes(whole)
    assert sync_logs(here, "tried/sub-01/") == (0, 1)
    assert sync_logs(there, "tried/sub-01/") == (1, 0)
    assert sync_logs(here, "tried/") == sync_logs(there, "tried/") == (0, 0)


def test_another_session_of_the_same_name_overwrites_nothing_and_both_are_named(
    machines: tuple[Path, Path], tmp_path: Path
) -> None:
    here, there = machines
    urls = [(machine / STORE_URL_FILE_NAME).read_text() for machine in machines]
    (there / STORE_URL_FILE_NAME).unlink()
    mine = played(here, tmp_path)
    theirs = played(there, tmp_path, seed=2)  # the same participant, by a server that has not heard of it
    (there / STORE_URL_FILE_NAME).write_text(urls[1])
    first, second = mine.read_bytes(), theirs.read_bytes()
    upload_log(theirs)
    store = open_remote_store(here)
    assert store is not None
    store.fetch("tried/sub-01/ses-01/sub-01_ses-01.mcap", tmp_path / "stored")
    assert (tmp_path / "stored").read_bytes() == first
    assert len(store.versions("tried/")) == 2
    sync_logs(there, "tried/")
    sync_logs(here, "tried/")
    for machine in machines:
        found = {path.name: path.read_bytes() for path in machine.rglob("*.mcap")}
        assert found.pop("sub-01_ses-01.mcap") == first
        assert list(found.values()) == [second]
        assert sync_logs(machine, "tried/") == (0, 0)
        [problem] = [text for text in list_problems(machine / "tried") if "completed session 1 2 times" in text]
        assert [text for text, fine in verify_enrolment(machine / "tried") if not fine and text == problem]


def test_of_two_machines_that_put_a_log_there_at_once_one_is_refused(
    machines: tuple[Path, Path], tmp_path: Path
) -> None:
    log = played(tmp_path / "alone", tmp_path)
    store = open_remote_store(machines[0])
    assert store is not None
    store.put("tried/log.mcap", log)
    with pytest.raises(RemoteStoreConflictError):
        store.put("tried/log.mcap", log)
    later = tmp_path / "later"
    later.write_bytes(b"a later version")
    [version] = store.versions("").values()
    store.put("tried/log.mcap", later, over=version)
    with pytest.raises(RemoteStoreConflictError):
        store.put("tried/log.mcap", log, over=version)


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
    assert shelf.versions("") == {}
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
        arrivals.journal.append(ParticipantArrived(hash_link_token(token), "sub-01", now_text()))
    assert Arrivals(protocol, there).arrive(Arrival(token)) == Rejection("finished", "complete")
