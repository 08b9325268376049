"""Leases: one server has a session, another gets it where the first one left it, and a late one can write nothing."""

import asyncio
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from minihuman.admin.enrolment_entries import ChainHeadRecorded, read_chain_heads, read_enrolment_log
from minihuman.admin.manifest import find_unrecorded_logs
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.recruitment import ParticipantArrived, Recruitment, hash_link_token
from minihuman.experiment.machine.inputs import Stop
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.paths import session_folder
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import GroupCommit
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.session_leases import Lease, SessionLeases, name_session
from minihuman.storage.lease import (
    RENEWAL_INTERVAL_S,
    TTL_S,
    LeaseHeldError,
    LeaseLostError,
    LeaseRenewal,
    LeaseTable,
    LogPiece,
)
from minihuman.storage.remote_store import STORE_URL_FILE_NAME
from minihuman.storage.system import now_text
from minihuman.web.arrivals import Arrivals
from minihuman.web.connection import Connection
from minihuman.web.connection_factory import ConnectionFactory
from minihuman.web.hosted_session import HostStorage, start_host
from minihuman.web.messages import MESSAGE_VERSION, Hello, Refusal
from minihuman.web.outbox import PageSettings
from tests.lab.database import database, fresh
from tests.lab.lease_table import Clock, MemoryLeaseTable
from tests.machine import needs
from tests.web.page_model import PageModel
from tests.web.protocols import study

SESSION = "study/sub-01/ses-01"
PART = "sub-01_ses-01.mcap.part"


class Server:
    """A server as the database sees it: leases, a folder, and a live log with the writes that are durable."""

    def __init__(self, table: LeaseTable, folder: Path, clock: Clock) -> None:
        self.leases = SessionLeases(table, clock=clock)
        self.part = folder / PART
        folder.mkdir()
        self.writes = 0
        self._clock = clock

    def host(self) -> None:
        """Take the session, with its files."""
        self.lease = self.leases.acquire(SESSION)
        self.leases.restore(self.lease, self.part.parent)
        self.writes = 0
        self.lease.follow(lambda: self.part, lambda: self.writes)

    def record(self, data: bytes) -> None:
        """One write to the live log."""
        with self.part.open("ab") as file:
            file.write(data)
        self.writes += 1

    def renew(self) -> None:
        self.leases.renew([self.lease])

    @property
    def acknowledges(self) -> int:
        return self.lease.count_acknowledgeable(self._clock())


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def table(clock: Clock) -> MemoryLeaseTable:
    return MemoryLeaseTable(clock)


@pytest.fixture
def servers(table: MemoryLeaseTable, clock: Clock, tmp_path: Path) -> tuple[Server, Server]:
    return Server(table, tmp_path / "one", clock), Server(table, tmp_path / "other", clock)


def test_nothing_is_acknowledged_that_is_not_copied(servers: tuple[Server, Server]) -> None:
    one, _ = servers
    one.host()
    one.record(b"a")
    assert one.acknowledges == -1
    one.renew()
    one.record(b"b")
    assert one.acknowledges == 1
    one.renew()
    assert one.acknowledges == 2


def test_a_server_that_cannot_renew_acknowledges_nothing_two_seconds_before_its_lease_runs_out(
    servers: tuple[Server, Server], table: MemoryLeaseTable, clock: Clock
) -> None:
    one, other = servers
    one.host()
    one.record(b"a")
    one.renew()
    table.is_away = True
    clock.now_s += TTL_S - 2.01
    with pytest.raises(OSError, match="away"):
        one.renew()
    assert one.acknowledges == 1
    clock.now_s += 0.02
    assert one.acknowledges == -1
    table.is_away = False
    with pytest.raises(LeaseHeldError):
        other.host()
    one.renew()
    assert one.acknowledges == 1, "no other server has had the session"


def test_the_time_that_a_renewal_took_counts_for_the_holder(
    servers: tuple[Server, Server], table: MemoryLeaseTable, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, _ = servers
    one.host()
    answer = table.renew
    monkeypatch.setattr(table, "renew", lambda renewals: (answer(renewals), clock.__setattr__("now_s", 109.0))[0])
    one.renew()
    assert one.acknowledges == -1, "the database counts from when it was asked"


def test_the_next_server_waits_until_the_lease_has_run_out_and_has_all_that_was_acknowledged(
    servers: tuple[Server, Server], clock: Clock
) -> None:
    one, other = servers
    one.host()
    one.record(b"acknowledged,")
    one.renew()
    one.record(b"not acknowledged")  # and killed
    clock.now_s += TTL_S - 0.01
    with pytest.raises(LeaseHeldError):
        other.host()
    clock.now_s += 0.02
    other.host()
    assert other.part.read_bytes() == b"acknowledged,"
    other.record(b"gone on")
    other.renew()
    one.renew()
    assert (one.lease.lost, one.acknowledges) == (True, -1)
    one.record(b"too late")
    with pytest.raises(LeaseLostError):
        one.leases.end(one.lease, "complete")
    assert other.leases._table.read_files(SESSION) == {PART: b"acknowledged,gone on"}


def test_a_server_that_renews_hands_over_when_another_asks(servers: tuple[Server, Server], clock: Clock) -> None:
    one, other = servers
    one.host()
    for _ in range(10):
        clock.now_s += RENEWAL_INTERVAL_S
        one.renew()
    assert not one.lease.is_requested
    with pytest.raises(LeaseHeldError):
        other.host()
    one.record(b"the last")
    one.renew()
    assert one.lease.is_requested
    one.record(b" word")
    one.leases.release(one.lease)
    other.host()
    assert other.part.read_bytes() == b"the last word"


def test_a_killed_server_that_comes_back_first_keeps_what_it_wrote(
    servers: tuple[Server, Server], clock: Clock
) -> None:
    one, _ = servers
    one.host()
    one.record(b"copied,")
    one.renew()
    one.record(b"not copied")
    clock.now_s += TTL_S + 1
    one.host()
    assert one.part.read_bytes() == b"copied,not copied"
    assert one.acknowledges == -1
    one.renew()
    assert one.acknowledges == 0, "what was there before is copied now"


def test_what_a_late_server_has_is_put_aside_not_resumed(servers: tuple[Server, Server], clock: Clock) -> None:
    one, other = servers
    one.host()
    one.record(b"copied,")
    one.renew()
    one.record(b"mine")
    clock.now_s += TTL_S + 1
    other.host()
    other.record(b"theirs")
    other.leases.release(other.lease)
    one.host()
    assert one.part.read_bytes() == b"copied,theirs"
    [aside] = one.part.parent.glob("*superseded*")
    assert aside.read_bytes() == b"copied,mine"


def test_a_log_that_was_finished_and_not_stored_is_put_aside_for_the_copy(
    servers: tuple[Server, Server], clock: Clock
) -> None:
    one, _ = servers
    one.host()
    one.record(b"acknowledged")
    one.renew()
    log = one.part.with_name("sub-01_ses-01.mcap")
    log.write_bytes(b"finished")
    one.part.unlink()
    clock.now_s += TTL_S + 1
    one.host()
    assert one.part.read_bytes() == b"acknowledged"
    assert not log.exists(), "the live file goes on, and would be thrown away at its end"
    assert log.with_name(f"{log.name}.superseded-1").read_bytes() == b"finished"


def test_a_torn_end_that_was_taken_off_is_replaced_in_the_copy(servers: tuple[Server, Server], clock: Clock) -> None:
    one, other = servers
    one.host()
    one.record(b"whole,to")
    one.renew()
    clock.now_s += TTL_S + 1
    one.lease = one.leases.acquire(SESSION)
    one.leases.restore(one.lease, one.part.parent)
    one.part.write_bytes(b"whole,")  # as it is resumed
    one.record(b"new")
    one.lease.follow(lambda: one.part, lambda: one.writes)
    one.leases.release(one.lease)
    other.host()
    assert other.part.read_bytes() == b"whole,new"


def test_a_session_that_has_ended_for_good_is_leased_to_nobody(servers: tuple[Server, Server], clock: Clock) -> None:
    one, other = servers
    one.host()
    one.record(b"all of it")
    one.leases.end(one.lease, "complete")
    one.renew()
    assert not one.lease.lost
    assert other.leases.acquire(SESSION).grant.ended == "complete"
    one.leases.store(one.lease, None)
    clock.now_s += 10 * TTL_S
    assert other.leases.acquire(SESSION).grant.ended == "complete"


def test_a_finished_segment_is_kept_for_the_next_server_where_there_is_no_other_store(
    servers: tuple[Server, Server],
) -> None:
    one, other = servers
    one.host()
    one.record(b"live")
    one.leases.end(one.lease, "")
    log = one.part.with_name("sub-01_ses-01.mcap")
    log.write_bytes(b"finished")
    one.part.unlink()
    one.leases.store(one.lease, log)
    one.leases.release(one.lease)
    other.host()
    assert (other.part.parent / log.name).read_bytes() == b"finished"
    assert not other.part.exists()


def test_who_is_forgotten_is_taken_from_the_server_that_has_them(
    servers: tuple[Server, Server], table: MemoryLeaseTable
) -> None:
    one, other = servers
    one.host()
    one.record(b"theirs")
    one.renew()
    table.forget("study/sub-01/")
    one.renew()
    assert one.lease.lost
    other.host()
    assert not other.part.exists()


def leave_ended_session(
    table: MemoryLeaseTable, clock: Clock, machines: list[Path]
) -> tuple[Arrivals, Arrivals, Path, Lease]:
    """Two servers, of which the first ended a session for good and was killed before its log was finished."""
    protocol = decode_protocol(study(machines[0].parent, episodes=1, max_steps=4).read_bytes())
    one, other = (Arrivals(protocol, data, SessionLeases(table, clock=clock)) for data in machines)
    plan = plan_next_session(protocol, machines[0])
    made = start_host(
        plan,
        HostStorage(protocol, machines[0], GroupCommit()),
        {"window": "web"},
        PageSettings((96, 96)),
        at_sync=lambda: None,
    )
    lease = one.leases.acquire(name_session("tried", "sub-01", 1))
    lease.follow(lambda: made.files[0].segment_path.part, lambda: made.recorder.durable_writes)
    keys = [(1 + number) * 400_000_000 for number in range(8)]
    presses = [(t, key, True) for t, key in zip(keys, ["enter", *"1231", *["enter"] * 3], strict=True)]
    PageModel(made.host, presses[:3], frame_ns=16_000_000).run()
    made.files[0].drain()
    [part] = machines[0].rglob("*.part")
    stale = machines[1] / part.relative_to(machines[0])  # of when the other server had the session
    stale.parent.mkdir(parents=True)
    stale.write_bytes(part.read_bytes())
    made.host.stop(Stop(9_000_000_000, "complete", ""))
    made.files[0].leave()
    one.leases.end(lease, "complete")  # and killed
    made.host.close()
    return one, other, part, lease


def test_only_the_server_that_ended_a_session_finishes_its_log_after_a_kill(
    table: MemoryLeaseTable, clock: Clock, tmp_path: Path
) -> None:
    machines = [tmp_path / "one", tmp_path / "other"]
    one, other, part, lease = leave_ended_session(table, clock, machines)
    stale = machines[1] / part.relative_to(machines[0])
    other.finish_ended()
    assert [path.name for path in stale.parent.iterdir()] == [f"{part.name}.superseded-1"]
    one.finish_ended()
    assert [path.name for path in part.parent.iterdir()] == ["sub-01_ses-01.mcap"]
    assert table.read_files(lease.session) == {}
    assert find_unrecorded_logs(machines[0] / "tried") == []


def test_the_head_of_a_log_is_recorded_by_a_server_that_was_killed_before_it_wrote_that(
    table: MemoryLeaseTable, clock: Clock, tmp_path: Path
) -> None:
    one, _, part, _ = leave_ended_session(table, clock, [tmp_path / "one", tmp_path / "other"])
    log = recover_log(part).path  # named, and killed
    assert find_unrecorded_logs(tmp_path / "one/tried") == [log]
    assert read_chain_heads(tmp_path / "one/tried") == {}
    one.finish_ended()
    assert find_unrecorded_logs(tmp_path / "one/tried") == []
    assert [*read_chain_heads(tmp_path / "one/tried")[log.name]] == ["1"]


def test_a_page_whose_session_turns_out_to_be_complete_comes_again_and_is_told_so(
    table: MemoryLeaseTable, clock: Clock, tmp_path: Path
) -> None:
    """Its last server was killed between the session's end and the word of it: the log is complete, the lease open."""
    protocol = decode_protocol(study(tmp_path, episodes=1, max_steps=4).read_bytes())
    data = tmp_path / "one"
    plan = plan_next_session(protocol, data)
    recruits = Recruitment(data / "tried")
    (token,) = recruits.issue(1)
    with recruits.exclusive() as file:
        file.journal.append(ParticipantArrived(hash_link_token(token), "sub-01", now_text()))
    disk = HostStorage(protocol, data, GroupCommit())
    made = start_host(plan, disk, {}, PageSettings((96, 96)), at_sync=lambda: None)
    made.host.stop(Stop(9_000_000_000, "complete", ""))
    made.files[0].leave()
    made.host.close()

    async def comes() -> list[Refusal | Connection]:
        factory = ConnectionFactory(Arrivals(protocol, data, SessionLeases(table, clock=clock)), data, {})
        hello = Hello(MESSAGE_VERSION, token, facts={"browser": "Chromium", "window_px": "1600 x 900"})
        return [await factory.connect(hello), await factory.connect(hello)]

    first, second = asyncio.run(comes())
    assert isinstance(first, Refusal)
    assert isinstance(second, Refusal)
    assert (first.reason, second.reason) == ("wait", "complete")
    grant = table.acquire(name_session("tried", "sub-01", 1))
    assert grant is not None
    assert grant.ended == "complete", "no other server resumes it"


class _Failing(MemoryLeaseTable):
    """A database that is cut off when something is to be stored."""

    stores = True

    def store(self, session: str, fence: int, files: Mapping[str, bytes]) -> bool:
        if not self.stores:
            raise OSError("the database is cut off")
        return super().store(session, fence, files)


class _Host:
    """A server with a participant who came by a link, and whose session is recorded."""

    def __init__(self, table: LeaseTable, clock: Clock, folder: Path) -> None:
        protocol = decode_protocol(study(folder, episodes=1, max_steps=4).read_bytes())
        self.data = folder / "one"
        self.study_dir = self.data / "tried"
        self.arrivals = Arrivals(protocol, self.data, SessionLeases(table, clock=clock))
        plan_next_session(protocol, self.data)
        recruits = Recruitment(self.study_dir)
        (token,) = recruits.issue(1)
        with recruits.exclusive() as file:
            file.journal.append(ParticipantArrived(hash_link_token(token), "sub-01", now_text()))
        self.hello = Hello(MESSAGE_VERSION, token, facts={"browser": "Chromium", "window_px": "1600 x 900"})

    async def host(self) -> Connection:
        """Let the page come, and the participant play a little."""
        factory = ConnectionFactory(self.arrivals, self.data, {})
        factory.facts = {"player": "human"}
        connection = await factory.connect(self.hello)
        assert isinstance(connection, Connection)
        presses = [((1 + number) * 400_000_000, key, True) for number, key in enumerate(["enter", *"12"])]
        PageModel(connection.host, presses, frame_ns=16_000_000).run()
        return connection

    @property
    def files(self) -> list[str]:
        """What is in the session's folder."""
        return sorted(path.name for path in session_folder(self.data, "tried", "sub-01", 1).iterdir())

    @property
    def heads(self) -> int:
        """How many segments' ends the enrolment log has."""
        return sum(isinstance(line, ChainHeadRecorded) for line in read_enrolment_log(self.study_dir))


LOG = PART.removesuffix(".part")


def test_a_segment_that_could_not_be_stored_has_no_name_and_no_head_until_it_is(clock: Clock, tmp_path: Path) -> None:
    table = _Failing(clock)
    server = _Host(table, clock, tmp_path)

    async def play() -> None:
        connection = await server.host()
        connection.stop("connection_lost", "the page did not come back")
        table.stores = False
        for _ in range(2):
            with pytest.raises(OSError, match="cut off"):
                connection.finish()
            assert (server.files, server.heads) == ([PART], 0), "another server may go on with the copy"
        table.stores = True
        connection.finish()
        connection.host.close()

    asyncio.run(play())
    assert (server.files, server.heads) == ([LOG], 1)
    [log] = server.data.rglob(LOG)
    assert table.read_files("tried/sub-01/ses-01") == {LOG: log.read_bytes()}
    assert read_log(log).clean


def test_a_segment_that_could_not_be_stored_and_is_anothers_now_is_put_aside(clock: Clock, tmp_path: Path) -> None:
    table = _Failing(clock)
    server = _Host(table, clock, tmp_path)

    async def play() -> None:
        connection = await server.host()
        connection.stop("connection_lost", "the page did not come back")
        table.stores = False
        with pytest.raises(OSError, match="cut off"):
            connection.finish()
        table.stores = True
        clock.now_s += TTL_S + 1
        assert table.acquire("tried/sub-01/ses-01") is not None
        with pytest.raises(LeaseLostError):
            connection.finish()
        connection.dismiss(4100)
        connection.leave()
        connection.host.close()

    asyncio.run(play())
    assert (server.files, server.heads) == ([f"{PART}.superseded-1"], 0)


@pytest.mark.parametrize("copied", [True, False])
def test_what_a_killed_server_left_is_finished_only_where_it_could_be_stored(
    clock: Clock, tmp_path: Path, copied: bool
) -> None:
    table = _Failing(clock)
    server = _Host(table, clock, tmp_path)

    async def play() -> None:
        connection = await server.host()
        for file in connection.hosted.files:
            file.leave()
        if copied:
            assert connection.lease is not None
            server.arrivals.leases and server.arrivals.leases.renew([connection.lease])
        connection.host.close()

    async def comes() -> Connection | Refusal:
        factory = ConnectionFactory(server.arrivals, server.data, {})
        factory.facts = {"player": "human", "rules": "of another release, so that it is not resumed"}
        return await factory.connect(server.hello)

    asyncio.run(play())
    clock.now_s += TTL_S + 1
    table.stores = False
    refused = asyncio.run(comes())
    assert isinstance(refused, Refusal)
    assert refused.reason == "wait"
    assert (server.files, server.heads) == ([PART], 0)
    table.stores = True
    clock.now_s += TTL_S + 1
    connection = asyncio.run(comes())
    assert isinstance(connection, Connection)
    connection.host.close()
    assert (LOG in server.files, PART in server.files, server.heads) == (True, False, 1)
    assert [*table.read_files("tried/sub-01/ses-01")] == [LOG]


def test_a_complete_log_that_could_be_put_nowhere_is_stored_when_its_end_is_tried_again(
    clock: Clock, tmp_path: Path
) -> None:
    table = _Failing(clock)
    server = _Host(table, clock, tmp_path)
    (server.data / STORE_URL_FILE_NAME).write_text(str(tmp_path / "no folder"))
    (tmp_path / "no folder").write_text("in the place of the store")

    async def play() -> None:
        connection = await server.host()
        connection.stop("complete", "")
        table.stores = False
        with pytest.raises(OSError, match="cut off"):
            connection.finish()
        table.stores = True
        connection.finish()
        connection.host.close()

    asyncio.run(play())
    assert (server.files, server.heads) == ([LOG], 1)
    assert [*table.read_files("tried/sub-01/ses-01")] == [LOG]


def test_a_segment_that_is_in_a_store_that_is_away_is_not_played_again(clock: Clock, tmp_path: Path) -> None:
    """A folder of another machine that is not mounted looks empty."""
    table = MemoryLeaseTable(clock)
    server = _Host(table, clock, tmp_path)
    store, away = tmp_path / "store", tmp_path / "away"
    (server.data / STORE_URL_FILE_NAME).write_text(str(store))

    async def play() -> None:
        connection = await server.host()
        connection.stop("connection_lost", "the page did not come back")
        connection.finish()
        connection.host.close()

    async def comes() -> Connection | Refusal:
        connection = await ConnectionFactory(server.arrivals, server.data, {}).connect(server.hello)
        if isinstance(connection, Connection):
            connection.leave()
            connection.host.close()
        return connection

    asyncio.run(play())
    assert table.read_files("tried/sub-01/ses-01") == {}, "every server has it from the store"
    shutil.rmtree(server.study_dir / "sub-01")  # as on a server that has not had the session
    store.rename(away)
    refused = asyncio.run(comes())
    assert isinstance(refused, Refusal)
    assert refused.reason == "wait"
    away.rename(store)
    assert isinstance(asyncio.run(comes()), Connection)
    assert server.files == [LOG, "sub-01_ses-01_seg-02.mcap.part"]


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with database() as address:
        yield address


@pytest.fixture(params=["memory", pytest.param("database", marks=[pytest.mark.program, needs("postgresql")])])
def any_table(
    request: pytest.FixtureRequest, clock: Clock
) -> Iterator[tuple[LeaseTable, LeaseTable, Callable[[float], None]]]:
    """A table as two servers have it, and what lets time pass."""
    if request.param == "memory":
        made = MemoryLeaseTable(clock)
        yield made, made, lambda s: clock.__setattr__("now_s", clock.now_s + s)
        return
    from minihuman.storage.lease import PostgresLeaseTable

    address = fresh(request.getfixturevalue("url"))
    one, other = PostgresLeaseTable(address), PostgresLeaseTable(address)

    def let_pass(s: float) -> None:
        with one._database.transaction() as cursor:
            earlier = "update minihuman_leases set until = until - make_interval(secs => %s)"
            cursor.execute(earlier, [s])

    yield one, other, let_pass
    for table in (one, other):
        table._database.close()
        table._renewals.close()


def test_every_table_of_leases_keeps_the_contract(
    any_table: tuple[LeaseTable, LeaseTable, Callable[[float], None]],
) -> None:
    one, other, let_pass = any_table
    first = one.acquire(SESSION)
    assert first is not None
    assert (first.ended, first.copied) == ("", False)
    assert other.acquire(SESSION) is None
    assert other.acquire("study/sub-02/ses-01") is not None
    renewal = LeaseRenewal(SESSION, first.fence, LogPiece(PART, 0, b"abcdef"))
    assert one.renew([renewal]) == {SESSION: True}
    assert one.renew([renewal]) == {SESSION: True}, "said twice it is done once"
    assert one.renew([LeaseRenewal(SESSION, first.fence, LogPiece(PART, 4, b"EF"))]) == {SESSION: True}
    assert one.renew([LeaseRenewal(SESSION, first.fence, LogPiece("second", 0, b"x"))]) == {SESSION: True}
    assert other.read_files(SESSION) == {PART: b"abcdEF", "second": b"x"}
    let_pass(TTL_S + 1)
    second = other.acquire(SESSION)
    assert second is not None
    assert (second.fence > first.fence, second.name, second.copied) == (True, first.name, True)
    late = LeaseRenewal(SESSION, first.fence, LogPiece(PART, 0, b"late"))
    mine = LeaseRenewal("study/sub-02/ses-01", 1)
    assert one.renew([late, mine]) == {"study/sub-02/ses-01": False}
    assert not one.store(SESSION, first.fence, {})
    assert not one.release(SESSION, first.fence, ended="complete")
    assert other.read_files(SESSION) == {PART: b"abcdEF", "second": b"x"}
    assert other.release(SESSION, second.fence, ended="complete")
    assert other.release(SESSION, second.fence, ended="complete"), "said twice"
    assert other.renew([LeaseRenewal(SESSION, second.fence)]) == {}
    assert other.store(SESSION, second.fence, {"log": b"whole"})
    over = one.acquire(SESSION)
    assert over is not None
    assert over.ended == "complete"
    assert one.read_files(SESSION) == {"log": b"whole"}
    one.forget("study/sub-01/")
    assert one.read_files(SESSION) == {}
    again = one.acquire(SESSION)
    assert again is not None
    assert (again.ended, again.copied, again.fence > second.fence) == ("", False, True)
