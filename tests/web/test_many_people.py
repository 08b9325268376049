"""A thousand people at several servers, each slot played once, every log proven. MINIHUMAN_NIGHTLY=1 takes them all."""

import multiprocessing
from collections import Counter
from pathlib import Path

import pytest

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.manifest import record_log_end
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import GroupCommit
from minihuman.storage.study_journals import URL_FILE_NAME
from minihuman.web.arrivals import Admission, Arrival, Arrivals
from minihuman.web.hosted_session import HostStorage, start_host
from minihuman.web.outbox import PageSettings
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.lab.database import database, fresh
from tests.machine import needs
from tests.web.page_model import PageModel, Press
from tests.web.protocols import study

pytestmark = [pytest.mark.program, pytest.mark.nightly(sample=True)]
SERVERS, PEOPLE = count(2, 8), count(4, 1_000)
MS = 1_000_000
SETTINGS = PageSettings(picture_px=(96, 96))
WEB = "image_size_px = [96, 96]\nopen_access = true"


@pytest.mark.nightly
@pytest.mark.parametrize("register", ["files", pytest.param("database", marks=needs("postgresql"))][count(1, 0) :])
def test_everybody_plays_a_slot_of_their_own_at_one_of_several_servers(tmp_path: Path, register: str) -> None:
    if register == "files":
        served_by([tmp_path] * SERVERS)
        return
    with database() as url:
        machines = [tmp_path / f"machine-{number}" for number in range(SERVERS)]
        for machine in machines:
            machine.mkdir()
        address = fresh(url)
        for machine in machines:
            (machine / URL_FILE_NAME).write_text(address + "\n")
        served_by(machines)


def served_by(folders: list[Path]) -> None:
    """A server a folder; the same one for servers on one machine."""
    for folder in dict.fromkeys(folders):
        path = study(folder, episodes=1, max_steps=4, web=WEB)
        path.write_text(path.read_text().replace("participants = 500", "participants = 1000"))
    spawn = multiprocessing.get_context("spawn")
    each = PEOPLE // SERVERS
    servers = [spawn.Process(target=serve, args=(str(folder), each)) for folder in folders]
    for server in servers:
        server.start()
    for server in servers:
        server.join()
    assert [server.exitcode for server in servers] == [0] * SERVERS
    lines = read_enrolled(folders[0] / "tried")
    assert sorted(line.index for line in lines) == list(range(each * SERVERS))
    logs = [path for folder in dict.fromkeys(folders) for path in folder.rglob("*.mcap")]
    played = Counter(path.name.partition("_")[0] for path in logs)
    assert played == Counter(line.participant for line in lines), "each of them once, at one server"


@needs("postgresql")
def test_everybody_who_joins_at_one_of_three_servers_at_once_has_a_slot_of_their_own(tmp_path: Path) -> None:
    each = count(20, 3_334)
    with database() as url:
        machines = [tmp_path / f"machine-{number}" for number in range(3)]
        address = fresh(url)
        for machine in machines:
            machine.mkdir()
            (machine / URL_FILE_NAME).write_text(address + "\n")
            path = study(machine, web=WEB)
            path.write_text(path.read_text().replace("participants = 500", f"participants = {3 * each}"))
        spawn = multiprocessing.get_context("spawn")
        servers = [spawn.Process(target=join, args=(str(machine), each)) for machine in machines]
        for server in servers:
            server.start()
        for server in servers:
            server.join()
        assert [server.exitcode for server in servers] == [0, 0, 0]
        lines = read_enrolled(machines[0] / "tried")
        assert sorted(line.index for line in lines) == list(range(3 * each))
        assert len({line.participant for line in lines}) == 3 * each


def join(folder: str, people: int) -> None:
    """Let people arrive one after the other, in a process of its own; nobody plays."""
    data = Path(folder)
    arrivals = Arrivals(decode_protocol((data / "tried.toml").read_bytes()), data)
    seated = [arrivals.arrive(Arrival()) for _ in range(people)]
    assert all(isinstance(one, Admission) for one in seated)


def serve(folder: str, people: int) -> None:
    """Seat people one after the other, in a process of its own; each log is proven when it is there."""
    data = Path(folder)
    protocol = decode_protocol((data / "tried.toml").read_bytes())
    arrivals, disk = Arrivals(protocol, data), HostStorage(protocol, data, GroupCommit())
    for _ in range(people):
        seated = arrivals.arrive(Arrival())
        assert isinstance(seated, Admission), seated
        log = plays(seated, arrivals, disk)
        assert list(find_log_differences(log, World)) == []


def plays(seated: Admission, arrivals: Arrivals, disk: HostStorage) -> Path:
    """A whole session through a seat; its log."""
    made = start_host(seated.plan or arrivals.plan(seated), disk, {"window": "web"}, SETTINGS, at_sync=lambda: None)
    PageModel(made.host, presses(), frame_ns=16 * MS).run()
    log = made.recorder.close()
    made.host.close()
    assert log is not None
    record_log_end(log)
    assert read_log(log).end_reason == "complete"
    return log


def presses() -> list[Press]:
    """Enter where there is something to be read, keys that mean something where there is not."""
    keys = ["enter", "1", "2", "3", "1", "enter", "enter", "enter"]
    times = [(1 + number) * 400 * MS for number in range(len(keys))]
    return [press for t, key in zip(times, keys, strict=True) for press in ((t, key, True), (t + 50 * MS, key, False))]
