"""Days between sessions are calendar days where the participant is; logs without an offset are dated in UTC."""

import dataclasses
import shutil
import time
from contextlib import nullcontext
from datetime import UTC, date, datetime
from pathlib import Path

import msgspec
import pytest

from minihuman.admin import due, next_session
from minihuman.errors import AllocationError
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.machine import SessionClock
from minihuman.runtime.simulated_session import simulate
from minihuman.web.eligibility import collect_browser_facts
from minihuman.web.messages import Hello
from tests.builders import session
from tests.lab.test_due import TWO_DAYS

MONDAY_EVENING = "2026-11-24T04:00:00Z"  # 20:00 on Monday in Los Angeles


@pytest.fixture
def los_angeles(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TZ", "PST8PDT")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def begun(started_at: str, **facts: str) -> SessionLog:
    log = session(participant="sub-01")
    segments = tuple(dataclasses.replace(one, facts=facts) for one in log.segments)
    return dataclasses.replace(log, started_at=started_at, segments=segments)


@pytest.mark.parametrize(
    ("facts", "day"), [({"utc_offset_min": "-480"}, 23), ({"utc_offset_min": "330"}, 24), ({}, 24)]
)
def test_a_session_began_on_the_day_it_was_where_the_participant_was(facts: dict[str, str], day: int) -> None:
    assert next_session.find_start_date(begun(MONDAY_EVENING, **facts)) == date(2026, 11, day)


def test_monday_evening_to_wednesday_morning_is_two_days_wherever_the_server_stands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(next_session, "wall_time", lambda: datetime(2026, 11, 25, 17, tzinfo=UTC))  # 09:00 there
    next_session._require_due_today(TWO_DAYS, begun(MONDAY_EVENING, utc_offset_min="-480"), 2)
    with pytest.raises(AllocationError, match="which was 1 days ago"):
        next_session._require_due_today(TWO_DAYS, begun(MONDAY_EVENING), 2)


@pytest.mark.parametrize("offset_min", [-480, 330])
def test_the_day_is_that_of_the_new_sessions_own_offset_where_it_is_known(
    monkeypatch: pytest.MonkeyPatch, offset_min: int
) -> None:
    """Begun on Monday in Los Angeles; 03:00 UTC on Wednesday is still Tuesday there, and Wednesday in India."""
    monkeypatch.setattr(next_session, "wall_time", lambda: datetime(2026, 11, 25, 3, tzinfo=UTC))
    log = begun(MONDAY_EVENING, utc_offset_min="-480")
    with nullcontext() if offset_min == 330 else pytest.raises(AllocationError, match="which was 1 days ago"):
        next_session._require_due_today(TWO_DAYS, log, 2, offset_min)


def test_who_is_due_is_told_by_the_participants_calendar_and_not_by_the_servers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A server in UTC: at 07:00 there it is 23:00 of the day before in Los Angeles."""
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    for log in simulate(TWO_DAYS, tmp_path, participants=1, seed=1, player="random"):
        if "ses-02" in log.name:
            shutil.rmtree(log.parent)
    there = begun(MONDAY_EVENING, utc_offset_min="-480")
    dated = {"started_at": there.started_at, "segments": there.segments}
    monkeypatch.setattr(due, "read_log", lambda path: dataclasses.replace(read_log(path), **dated))
    times = [datetime(2026, 11, day, hour, tzinfo=UTC) for day, hour in ((25, 7), (25, 9), (28, 7), (28, 8))]
    states = [due.list_due_sessions(tmp_path / "days", now)[0].state for now in times]
    assert states == ["later", "due", "due", "overdue"]


@pytest.mark.usefixtures("los_angeles")
def test_the_log_holds_the_offset_and_no_zone() -> None:
    facts = SessionClock().facts()
    assert facts["utc_offset_min"] in ("-480", "-420")
    assert "PST" not in str(facts)


@pytest.mark.parametrize("told", [-480, 330, 0])
def test_a_browser_tells_its_offset(told: int) -> None:
    """As it arrives: a number of the page's JSON is read as a float."""
    sent = msgspec.json.encode({"t": "hello", "version": 1, "facts": {"utc_offset_min": told}})
    hello = msgspec.json.decode(sent, type=Hello)
    assert collect_browser_facts(hello.facts)["utc_offset_min"] == str(told)


@pytest.mark.parametrize("told", [100_000, True, "PST", 1.5])
def test_what_is_no_offset_is_left_out(told: bool | float | str) -> None:
    assert "utc_offset_min" not in collect_browser_facts({"utc_offset_min": told})
