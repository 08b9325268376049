import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from minihuman.admin.due import list_due_sessions
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.withdrawal import replace_participant, withdraw_participant
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate

TWO_DAYS = decode_protocol(b"""
[study]
name = "days"
version = "1"
seed = 3
participants = 9
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "all"
[[blocks]]
name = "walk"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 1
actions = ["back", "forward", "dive"]
max_steps = 9
[[sessions]]
name = "one"
parts = ["walk"]
[[sessions]]
name = "two"
parts = ["walk"]
days_after_previous = [2, 4]
""")


@pytest.fixture
def study(tmp_path: Path) -> Path:
    for log in simulate(TWO_DAYS, tmp_path, participants=3, seed=1, player="random"):
        if "ses-02" in log.name:  # simulated people come on both days at once; these have not come back yet
            shutil.rmtree(log.parent)
    plan_next_session(TWO_DAYS, tmp_path)  # takes a slot and never comes
    return tmp_path / "days"


def test_the_second_day_comes_is_there_and_passes(study: Path) -> None:
    now = datetime.now(UTC)
    first = list_due_sessions(study, now)[0].earliest
    assert first is not None
    for days, state in ((-1, "later"), (0, "due"), (2, "due"), (3, "overdue")):
        told = {one.participant: one for one in list_due_sessions(study, now + timedelta(days=2 + days))}
        assert [told[f"sub-0{number}"].state for number in (1, 2, 3)] == [state] * 3
        assert told["sub-01"].session == 2
    assert (
        f"due from {first} until {first + timedelta(days=2)}"
        in list_due_sessions(study, now + timedelta(days=1))[0].line()
    )


@pytest.mark.parametrize("damage", ["the time it began at", "its first bytes"])
def test_whose_log_cannot_be_read_is_not_said_to_have_never_come(study: Path, damage: str) -> None:
    (log,) = (study / "sub-02").rglob("*.mcap")
    content = log.read_bytes()
    at = content.index(b"started_at") + 15 if damage == "the time it began at" else 3
    log.write_bytes(content[:at] + b"?" + content[at + 1 :])
    told = {one.participant: one for one in list_due_sessions(study)}
    assert (told["sub-02"].state, told["sub-02"].session) == ("unreadable", 1)
    assert "cannot be read" in told["sub-02"].line()
    assert told["sub-01"].state == "later"


def test_who_never_came_and_whoever_left_is_told_apart(study: Path) -> None:
    assert [one.state for one in list_due_sessions(study)][-1] == "never came"
    replace_participant(study, "sub-04")
    withdraw_participant(study, "sub-02", seal=None)
    assert [one.participant for one in list_due_sessions(study)] == ["sub-01", "sub-03"]
