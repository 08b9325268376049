"""What one page may cost: bytes, file handles, and the room on a disk that others need."""

import asyncio
import json
from pathlib import Path

import msgspec
import pytest

from minihuman.experiment.machine.events import SessionEnded
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.replay import compare_replay
from minihuman.log.read.session_reader import read_events
from minihuman.web import connection_factory
from minihuman.web.arrivals import Arrivals
from minihuman.web.connection import Connection
from minihuman.web.connection_factory import ConnectionFactory
from minihuman.web.messages import MESSAGE_VERSION, Hello, Refusal
from minihuman.web.page_protocol import PageProtocol
from minihuman.web.server import process
from minihuman.web.server.app import WebServer
from minihuman.web.server.process import ServeError
from minihuman.web.session_budget import SessionBudget, estimate_plan_bytes
from minihuman.web.traffic_limits import MESSAGES_PER_S
from minihuman.worlds.adapters.world import World
from tests.study.sessions import corridor_plan
from tests.web.test_admission import FACTS, agree, corridor

S = 1_000_000_000
KEY_MESSAGE_BYTES = 60


def invited(arrivals: Arrivals) -> Hello:
    (token,) = arrivals.recruits.issue(1)
    return Hello(MESSAGE_VERSION, token, stream="x", facts=FACTS)


def test_a_page_that_types_without_end_is_ended_and_told_that_the_study_stopped(tmp_path: Path) -> None:
    async def flood() -> tuple[Connection, int]:
        arrivals = Arrivals(corridor(""), tmp_path)
        server = WebServer(arrivals, tmp_path)
        connection = await server._factory.connect(invited(arrivals), "192.0.2.1")
        assert isinstance(connection, Connection)
        agree(connection)
        welcome, _, after = connection.greet(Hello(MESSAGE_VERSION, stream="x"))
        protocol = PageProtocol(connection, welcome, after, 0.0)
        sent_bytes = 0
        at_ns = connection.now_ns() + 10_000
        for number in range(3, 100_000):
            text = {"t": "n", "n": number, "at": at_ns + number, "what": {"t": "typed", "text": "x" * 2000}}
            protocol.receive(json.dumps(text), more=False)
            sent_bytes += 2000
            if connection.host.over:
                break
        await server._finish_if_over(connection)
        return connection, sent_bytes

    connection, sent_bytes = asyncio.run(flood())
    assert connection.is_over_budget
    assert sent_bytes < 3_000_000
    assert connection.over is not None
    assert connection.over.end == "broken"
    log = connection.recording.log
    assert log is not None
    assert log.stat().st_size < 5_000_000
    [ended] = [event for event in read_events(log) if isinstance(event, SessionEnded)]
    assert ended.reason == "aborted"
    assert "the page sent more than" in ended.detail
    assert list(compare_replay(list(read_events(log)), World)) == []


def test_a_page_on_a_bad_line_may_repeat_what_it_sent_as_often_as_it_reconnects(tmp_path: Path) -> None:
    async def repeat() -> Connection:
        arrivals = Arrivals(corridor(""), tmp_path)
        server = WebServer(arrivals, tmp_path)
        connection = await server._factory.connect(invited(arrivals), "192.0.2.1")
        assert isinstance(connection, Connection)
        agree(connection)
        at_ns = connection.now_ns() + 10_000
        for _ in range(1_000):
            welcome, _, after = connection.greet(Hello(MESSAGE_VERSION, stream="x"))
            protocol = PageProtocol(connection, welcome, after, 0.0)
            for number in (3, 4):
                text = {"t": "n", "n": number, "at": at_ns + number, "what": {"t": "typed", "text": "x" * 2000}}
                protocol.receive(json.dumps(text), more=False)
        await server._finish_if_over(connection)
        return connection

    connection = asyncio.run(repeat())
    assert not connection.is_over_budget
    assert not connection.host.over


def spend_at(budget: SessionBudget, n_bytes: int, session_ns: int, *, is_text: bool = False) -> bool:
    return budget.spend(n_bytes, lambda: session_ns, is_text=is_text)


def test_a_person_who_plays_all_of_a_plan_and_types_long_answers_stays_within_the_budget() -> None:
    plan = corridor_plan(consent="May we?")
    budget = SessionBudget(plan)
    steps = sum(episode.max_steps for episode in plan.episodes)
    assert all(spend_at(budget, KEY_MESSAGE_BYTES, number * S // 8) for number in range(4 * steps))
    assert all(spend_at(budget, KEY_MESSAGE_BYTES, 3_600 * S + number * S // 6) for number in range(6 * 3_600))


def test_a_page_at_the_full_rate_is_within_the_budget_for_a_few_minutes_at_most() -> None:
    plan = corridor_plan(consent="May we?")
    budget = SessionBudget(plan)
    per_s = int(MESSAGES_PER_S)
    assert not all(spend_at(budget, KEY_MESSAGE_BYTES, number * S // per_s) for number in range(600 * per_s))
    assert budget.find_limit_bytes(600 * S) < 5_000_000


def test_a_long_plan_does_not_let_a_page_write_all_of_it_at_once() -> None:
    episode = corridor_plan(consent="May we?").episodes[0]
    plan = msgspec.structs.replace(
        corridor_plan(consent="May we?"), episodes=(msgspec.structs.replace(episode, max_steps=20_000),) * 10
    )
    budget = SessionBudget(plan)
    assert not all(
        spend_at(budget, 2_000, number * S // int(MESSAGES_PER_S)) for number in range(10 * int(MESSAGES_PER_S))
    )
    assert budget.spent_bytes < 2_000_000
    budget = SessionBudget(plan)  # at a server so busy that it takes ten messages a second
    assert not all(spend_at(budget, 2_000, number * S // 10, is_text=True) for number in range(6_000))
    assert budget.spent_bytes < 3_000_000
    in_real_time = (msgspec.structs.replace(episode, max_steps=20_000, pace="real_time", step_period_ms=1_000 / 60),)
    budget = SessionBudget(msgspec.structs.replace(plan, episodes=in_real_time * 10))
    per_s = 150  # steps, their pictures, and the keys
    assert all(spend_at(budget, KEY_MESSAGE_BYTES, number * S // per_s) for number in range(1_200 * per_s))
    budget = SessionBudget(plan)
    per_s = 3 * 15  # a key of a quick participant goes down, is seen, and comes up
    assert all(spend_at(budget, KEY_MESSAGE_BYTES, number * S // per_s) for number in range(3_600 * per_s))


def test_a_plan_that_asks_for_more_has_a_larger_budget(tmp_path: Path) -> None:
    short: SessionPlan = corridor_plan(consent="May we?")
    assert estimate_plan_bytes(short) > sum(episode.max_steps for episode in short.episodes) * 1_000


def test_nobody_new_is_admitted_to_a_disk_that_others_need_to_finish_their_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_factory, "RESERVE_BYTES", 1 << 62)

    async def come() -> Connection | Refusal:
        arrivals = Arrivals(corridor(""), tmp_path)
        return await ConnectionFactory(arrivals, tmp_path, {}).connect(invited(arrivals))

    answer = asyncio.run(come())
    assert isinstance(answer, Refusal)
    assert answer.reason == "busy"


def test_a_study_for_which_the_system_allows_too_few_files_is_refused_with_the_way_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    process._require_handles(1)
    monkeypatch.setattr(process, "raise_file_limit", lambda needed: 1_024)
    with pytest.raises(ServeError, match="max_concurrent_sessions is 10000, for which a server needs 30528 open files"):
        process._require_handles(10_000)
