"""Days between sessions are calendar days where the participant is; logs without an offset are dated in UTC."""

import dataclasses
import time
from datetime import UTC, date, datetime

import pytest

from minihuman.admin import next_session
from minihuman.errors import AllocationError
from minihuman.log.model.session_log import SessionLog
from minihuman.runtime.machine import SessionClock
from minihuman.web.eligibility import collect_browser_facts
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
    next_session._check_day(TWO_DAYS, begun(MONDAY_EVENING, utc_offset_min="-480"), 2)
    with pytest.raises(AllocationError, match="which was 1 days ago"):
        next_session._check_day(TWO_DAYS, begun(MONDAY_EVENING), 2)


@pytest.mark.usefixtures("los_angeles")
def test_the_log_holds_the_offset_and_no_zone() -> None:
    facts = SessionClock().facts()
    assert facts["utc_offset_min"] in ("-480", "-420")
    assert "PST" not in str(facts)


@pytest.mark.parametrize("told", [-480, 330, 0])
def test_a_browser_tells_its_offset(told: int) -> None:
    assert collect_browser_facts({"utc_offset_min": told})["utc_offset_min"] == str(told)


@pytest.mark.parametrize("told", [100_000, True, "PST", 1.5])
def test_what_is_no_offset_is_left_out(told: bool | float | str) -> None:
    assert "utc_offset_min" not in collect_browser_facts({"utc_offset_min": told})
