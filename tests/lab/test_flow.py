"""How many came, left, got a group, were screened out and finished: counted without a word of who they were."""

from collections import Counter
from pathlib import Path

import pandas as pd

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.status import count_participant_flow, format_status
from minihuman.admin.withdrawal import replace_participant, withdraw_participant
from minihuman.experiment.machine.inputs import PointerPressed, PointerReleased
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.reporting.participant_flow import FlowSection, flow_section
from minihuman.runtime.simulated_session import simulate
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from tests.lab.test_due import TWO_DAYS
from tests.seats import test_consent_first
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
QUIZ = decode_protocol(
    b"""
[study]
name = "asked"
version = "1"
seed = 4
participants = 40
closing = ""
[keys]
keyboard_check = false
[allocation]
stratify_by = "door.door"
[[groups]]
name = "a"
[[groups]]
name = "b"
[[sessions]]
name = "day"
parts = ["quiz", "door", "walk"]
[[questions]]
name = "quiz"
on_failure = "end"
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
success = "terminated and reward > 0"
episodes = 1
actions = ["back", "forward", "dive"]
max_steps = 9
"""
)


def test_who_left_before_anything_was_recorded_is_a_number_and_no_name(tmp_path: Path) -> None:
    refuses = [PointerPressed(9 * MS, 0, 0, "decline"), PointerReleased(12 * MS, 0, 0, "decline")]
    test_consent_first.seated(tmp_path, script=list(refuses))
    test_consent_first.seated(tmp_path, script=list(refuses))
    test_consent_first.seated(tmp_path, script=[])  # closes the window
    test_consent_first.seated(tmp_path, "enter", "enter", "forward", "forward", "forward")
    study = tmp_path / "corridor"
    found = count_participant_flow(study)
    assert (found.came, found.before) == (4, {"did not agree": 2, "left before anything was recorded": 1})
    assert sum(found.allocated.values()) == sum(found.courses[1].complete.values()) == 1
    assert [line for line in format_status(study) if "2 did not agree" in line]


def test_who_is_screened_out_before_the_draw_is_counted_and_the_next_simulated_person_is_another(
    tmp_path: Path,
) -> None:
    logs = list(simulate(QUIZ, tmp_path, participants=16, seed=1, player="random"))
    found = count_participant_flow(tmp_path / "asked")
    out = found.before["screened out before a group was drawn"]
    assert 0 < out < 16
    assert found.came == 16
    assert len(logs) == 16 - out == sum(found.allocated.values()) == len(read_enrolled(tmp_path / "asked"))
    assert not found.without_data


def test_everybody_who_was_given_a_group_is_somewhere(tmp_path: Path) -> None:
    list(simulate(TWO_DAYS, tmp_path, participants=5, seed=1, player="random"))
    study = tmp_path / "days"
    plan_next_session(TWO_DAYS, tmp_path)  # takes a slot and never comes
    replace_participant(study, "sub-06")
    withdraw_participant(study, "sub-02", seal=None)
    found = count_participant_flow(study)
    assert (found.came, found.withdrew, found.replaced) == (6, Counter(all=1), Counter(all=1))
    assert (found.allocated, (found.without_data, found.courses[1].not_returned)) == (
        Counter(all=6),
        (Counter(), Counter(all=1)),
    )
    first, second = found.courses.values()
    assert (first.began, first.complete) == (Counter(all=5), Counter(all=5))  # sub-02's second log is on record
    assert (second.began, second.withdrew, second.complete) == (Counter(all=5), Counter(all=1), Counter(all=4))
    participants = pd.DataFrame(
        {"participant": ["sub-01", "sub-03"], "group": "all", "exclusion_reason": [None, "asleep"]}
    )
    section = flow_section(study, participants)
    assert section is not None
    assert section.table is not None
    rows = {row[0]: row[1:] for row in section.table.rows}
    for stage, count in (
        ("came", 6),
        ("nothing recorded, slot reallocated", 1),
        ("session 1: finished", 5),
        ("session 2: withdrew during or after it", 1),
        ("session 2: finished and did not withdraw", 4),
        ("for the analysis: began a session", 5),
        ("withdrew, data erased or sealed", 1),
        ("not in this report's selection", 2),
        ("excluded: asleep", 1),
    ):
        assert rows[stage][0] == str(count)
    assert rows["included in this report"] == ("1", "1")
    assert "sub-" not in str(section)


def test_registers_of_before_say_only_that_somebody_left(tmp_path: Path) -> None:
    list(simulate(TWO_DAYS, tmp_path, participants=1, seed=1, player="random"))
    study = tmp_path / "days"
    taken = (
        (study / ENROLMENT_FILE_NAME)
        .read_text()
        .splitlines()[0]
        .partition(',"previous"')[0]
        .replace("sub-01", "sub-02")
        .replace('"index":0', '"index":1')
    )
    with (study / ENROLMENT_FILE_NAME).open("a") as register:
        register.write(taken + '}\n{"freed":"sub-02","at":"2026-01-01T00:00:00Z"}\n')
    assert count_participant_flow(study).before == {"left before anything was recorded": 1}


def test_logs_without_their_register_have_no_such_section(tmp_path: Path) -> None:
    list(simulate(TWO_DAYS, tmp_path, participants=1, seed=1, player="random"))
    (tmp_path / "days" / ENROLMENT_FILE_NAME).unlink()
    participants = pd.DataFrame({"participant": ["sub-01"], "group": "all", "exclusion_reason": [None]})
    assert flow_section(tmp_path / "days", participants) is None


def test_a_register_that_cannot_be_read_is_said_so_in_the_report(tmp_path: Path) -> None:
    list(simulate(TWO_DAYS, tmp_path, participants=1, seed=1, player="random"))
    register = tmp_path / "days" / ENROLMENT_FILE_NAME
    register.write_text("sub-01 {}\n" + register.read_text())
    participants = pd.DataFrame({"participant": ["sub-01"], "group": "all", "exclusion_reason": [None]})
    assert flow_section(tmp_path / "days", participants) == FlowSection(None)
