"""How many came, left, got a group, were screened out and finished: counted without a word of who they were."""

from collections import Counter
from pathlib import Path

import pandas as pd

from minihuman.data.journals import REGISTER
from minihuman.lab.flow import flow
from minihuman.lab.next_session import next_session
from minihuman.lab.register_lines import read_register
from minihuman.lab.status import status_lines
from minihuman.lab.withdraw import replace, withdraw
from minihuman.report.flow import flow_section
from minihuman.seats.simulate import simulate
from minihuman.study.inputs import PointerPressed, PointerReleased
from minihuman.study.protocol import decode
from tests.lab.test_due import TWO_DAYS
from tests.seats import test_consent_first as consent
from tests.study.sessions import MS

_SUMS = "".join(
    f"""
[[questions.items]]
name = "sum-{number}"
kind = "choice"
ask = "How much is {number} and {number}?"
options = ["{2 * number}", "22", "33", "44"]
right = 1
"""
    for number in range(1, 6)
)
QUIZ = decode(
    b"""
[study]
name = "asked"
version = "1"
seed = 4
participants = 40
closing = ""
[keys]
check = false
[allocation]
stratify = "door.door"
[[groups]]
name = "a"
[[groups]]
name = "b"
[[sessions]]
name = "day"
parts = ["quiz", "door", "walk"]
[[questions]]
name = "quiz"
failed = "end"
"""
    + _SUMS.encode()
    + b"""
[[questions]]
name = "door"
[[questions.items]]
name = "door"
kind = "choice"
ask = "Which door?"
options = ["Left", "Right"]
codes = ["left", "right"]
[[blocks]]
name = "walk"
world = "tests.worlds.corridor:tests/Corridor-v0"
episodes = 1
actions = ["back", "forward", "dive"]
max_steps = 9
"""
)


def test_who_left_before_anything_was_recorded_is_a_number_and_no_name(tmp_path: Path) -> None:
    refuses = [PointerPressed(9 * MS, 0, 0, "decline"), PointerReleased(12 * MS, 0, 0, "decline")]
    consent.seated(tmp_path, script=list(refuses))
    consent.seated(tmp_path, script=list(refuses))
    consent.seated(tmp_path, script=[])  # closes the window
    consent.seated(tmp_path, "enter", "enter", "forward", "forward", "forward")
    study = tmp_path / "corridor"
    found = flow(study)
    assert (found.came, found.before) == (4, {"did not agree": 2, "left before anything was recorded": 1})
    assert sum(found.given_group.values()) == sum(found.courses[1].complete.values()) == 1
    assert [line for line in status_lines(study) if "2 did not agree" in line]


def test_who_is_screened_out_before_the_draw_is_counted_and_the_next_simulated_person_is_another(
    tmp_path: Path,
) -> None:
    logs = list(simulate(QUIZ, tmp_path, participants=16, seed=1, player="random"))
    found = flow(tmp_path / "asked")
    out = found.before["screened out before a group was drawn"]
    assert 0 < out < 16
    assert found.came == 16
    assert len(logs) == 16 - out == sum(found.given_group.values()) == len(read_register(tmp_path / "asked"))
    assert not found.unrecorded


def test_everybody_who_was_given_a_group_is_somewhere(tmp_path: Path) -> None:
    list(simulate(TWO_DAYS, tmp_path, participants=5, seed=1, player="random"))
    study = tmp_path / "days"
    next_session(TWO_DAYS, tmp_path)  # takes a slot and never comes
    replace(study, "sub-06")
    withdraw(study, "sub-02", seal=None)
    found = flow(study)
    assert (found.came, found.withdrew, found.replaced) == (6, Counter(all=1), Counter(all=1))
    assert (found.given_group, found.unrecorded) == (Counter(all=6), Counter(all=1))
    assert [found.courses[day].complete for day in (1, 2)] == [Counter(all=4)] * 2
    participants = pd.DataFrame({"participant": ["sub-01", "sub-03"], "group": "all", "left_out": [None, "asleep"]})
    page = "".join(flow_section(study, participants))
    for stage, count in (("came", 6), ("withdrew afterwards", 1), ("session 2: finished", 4)):
        assert f'<td class="word">{stage}</td><td>{count}</td>' in page
    assert '<td class="word">count in this report</td><td>1</td><td>1</td>' in page
    assert "sub-" not in page


def test_registers_of_before_say_only_that_somebody_left(tmp_path: Path) -> None:
    list(simulate(TWO_DAYS, tmp_path, participants=1, seed=1, player="random"))
    study = tmp_path / "days"
    taken = (study / REGISTER).read_text().splitlines()[0].replace("sub-01", "sub-02").replace('"index":0', '"index":1')
    with (study / REGISTER).open("a") as register:
        register.write(taken + '\n{"freed":"sub-02","at":"2026-01-01T00:00:00Z"}\n')
    assert flow(study).before == {"left before anything was recorded": 1}


def test_logs_without_their_register_have_no_such_section(tmp_path: Path) -> None:
    list(simulate(TWO_DAYS, tmp_path, participants=1, seed=1, player="random"))
    (tmp_path / "days" / REGISTER).unlink()
    participants = pd.DataFrame({"participant": ["sub-01"], "group": "all", "left_out": [None]})
    assert flow_section(tmp_path / "days", participants) == []


def test_a_register_that_cannot_be_read_is_said_so_in_the_report(tmp_path: Path) -> None:
    list(simulate(TWO_DAYS, tmp_path, participants=1, seed=1, player="random"))
    register = tmp_path / "days" / REGISTER
    register.write_text("sub-01 {}\n" + register.read_text())
    participants = pd.DataFrame({"participant": ["sub-01"], "group": "all", "left_out": [None]})
    title, said = flow_section(tmp_path / "days", participants)
    assert title == "<h2>Who took part</h2>"
    assert "register cannot be read" in said
    assert "sub-" not in said
