"""What is done by hand is written down: when, what, why and by whose code; nothing is rewritten."""

from datetime import UTC, datetime
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner, Result

from minihuman.admin.enrolment_entries import AuditNote, count_interventions, read_enrolment_log
from minihuman.admin.next_session import plan_next_session
from minihuman.cli.command_line import make_command_line
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from tests.lab.test_next_session import PROTOCOL, play
from tests.lab.test_parts_resumed import GOAL, STUDY, sit

STUDY_NAME = "corridor"


def typed(*words: object) -> Result:
    result = CliRunner().invoke(make_command_line(), [str(word) for word in words])
    assert result.exit_code == 0, (result.output, result.exception)
    return result


@pytest.fixture
def study(tmp_path: Path) -> Path:
    for _ in range(3):
        play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=3)
    return tmp_path / STUDY_NAME


def last_entry(study: Path) -> dict[str, object]:
    return msgspec.json.decode((study / ENROLMENT_FILE_NAME).read_bytes().splitlines()[-1], type=dict[str, object])


@pytest.mark.parametrize(
    ("command", "kind"),
    [
        (("withdraw", "sub-02", "--erase"), "withdrawn"),
        (("replace", "sub-02"), "replaced"),
    ],
)
def test_a_departure_has_its_reason_and_the_experimenter(study: Path, command: tuple[str, ...], kind: str) -> None:
    before = (study / ENROLMENT_FILE_NAME).read_bytes()
    typed(*command, "--study", study, "--reason", "moved away", "--experimenter", "AB")
    assert (study / ENROLMENT_FILE_NAME).read_bytes().startswith(before)
    entry = last_entry(study)
    assert (entry[kind], entry["reason"], entry["experimenter"]) == ("sub-02", "moved away", "AB")
    assert datetime.fromisoformat(str(entry["at"])).tzinfo == UTC
    assert f"audit trail: 1 {kind}" in typed("status", study).output
    assert msgspec.json.decode(typed("status", study, "--json").output)["interventions"] == {kind: 1}


def test_what_has_no_reason_is_counted(study: Path) -> None:
    typed("replace", "sub-02", "--study", study)
    assert "audit trail: 1 replaced, 1 without a reason" in typed("status", study).output


def test_an_annotation_has_the_experimenter_and_is_counted(study: Path) -> None:
    log = study / "sub-01" / "ses-01"
    typed("annotate", log, "--tag", "exclude", "--reason", "the phone rang", "--experimenter", "AB")
    line = msgspec.json.decode(next(log.glob("*.marks.jsonl")).read_bytes())
    assert (line["note"], line["experimenter"]) == ("the phone rang", "AB")
    assert "audit trail: 1 annotations" in typed("status", study).output


def test_a_recovery_is_written_down(study: Path) -> None:
    play(plan_next_session(PROTOCOL, study.parent), study.parent, episodes=1, cut=True)
    typed("recover", study, "--reason", "power cut", "--experimenter", "AB")
    entry = last_entry(study)
    assert (entry["recovered"], entry["what"]) == ("sub-04_ses-01.mcap", "ended: cut_off")
    assert (entry["reason"], entry["experimenter"]) == ("power cut", "AB")


def test_a_recovery_at_the_next_start_is_written_down(study: Path) -> None:
    play(plan_next_session(PROTOCOL, study.parent), study.parent, episodes=1, cut=True)
    plan_next_session(PROTOCOL, study.parent, participant="sub-04")
    assert (last_entry(study)["recovered"], last_entry(study)["reason"]) == ("sub-04_ses-01.mcap", "resumed")


def test_a_group_chosen_by_hand_has_its_reason(study: Path) -> None:
    note = AuditNote("a pilot", "AB")
    plan_next_session(PROTOCOL, study.parent, group="two", note=note)
    entry = last_entry(study)
    assert (entry["group"], entry["overridden"], entry["reason"], entry["experimenter"]) == (
        "two",
        True,
        "a pilot",
        "AB",
    )
    assert count_interventions(read_enrolment_log(study)) == {"chosen by hand": 1}


def test_a_session_on_another_day_is_written_down_once_it_needed_the_option(tmp_path: Path) -> None:
    plan, _ = sit(tmp_path, "enter", "1", "enter", *GOAL, *GOAL, "4", "enter", "enter")
    study = tmp_path / plan.study
    note = AuditNote("ill", "AB")
    plan_next_session(STUDY, tmp_path, participant="sub-01", session=2, any_day=True, note=note)
    entry = last_entry(study)
    assert (entry["any_day"], entry["session"], entry["reason"]) == ("sub-01", 2, "ill")
    counts = count_interventions(read_enrolment_log(study))
    assert counts["run on another day"] == 1
