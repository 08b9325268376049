"""A study is complete: every sealed head has its log, every log its head."""

import re
import shutil
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.verify.study import verify_enrolment
from minihuman.admin.withdrawal import replace_participant, withdraw_participant
from minihuman.cli.command_line import make_command_line
from minihuman.dataset.log_files import list_readable_logs
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from tests.lab.test_next_session import PROTOCOL, play


@pytest.fixture
def study(tmp_path: Path) -> Path:
    for _ in range(2):
        play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=3)
    return tmp_path / "corridor"


def type_command(*words: object) -> tuple[int, str]:
    """The exit status of a command and the last line that it prints, or all lines of `verify`."""
    result = CliRunner().invoke(make_command_line(), [str(word) for word in words])
    return result.exit_code, result.output if words[0] == "verify" else result.output.splitlines()[-1]


def test_a_complete_study_says_nothing(study: Path) -> None:
    assert list(verify_enrolment(study)) == []


def test_a_session_whose_log_is_gone_is_named(study: Path) -> None:
    shutil.rmtree(study / "sub-02")
    assert list(verify_enrolment(study)) == [
        ("sub-02_ses-01.mcap is gone: the enrolment log has the head of its chain", False)
    ]
    for command in ("status", "verify"):
        result = CliRunner().invoke(make_command_line(), [command, str(study)])
        assert result.exit_code == 1, result.output
        assert re.search("sub-02_ses-01.mcap +is gone", result.output)


def test_a_log_whose_head_the_enrolment_log_lacks_is_named(study: Path) -> None:
    register = study / ENROLMENT_FILE_NAME
    lines = register.read_bytes().splitlines(keepends=True)
    assert b"sub-02_ses-01" in lines[-1]
    register.write_bytes(b"".join(lines[:-1]))  # the last line: no later one is there to tell
    missing = (
        "the enrolment log does not say how segment 1 of sub-02_ses-01.mcap ended; add it with `minihuman recover LOG`"
    )
    assert list(verify_enrolment(study)) == [(missing, False)]
    assert type_command("status", study) == (1, missing)
    found = msgspec.json.decode(type_command("status", "--json", study)[1])
    assert found["problems"] == [missing]
    code, line = type_command("recover", study / "sub-02" / "ses-01" / "sub-02_ses-01.mcap")
    assert (code, line.partition(": ")[2]) == (0, "whole; 1 chain heads added to the enrolment log")
    assert register.read_bytes().splitlines()[-2].startswith(b'{"sealed":"sub-02_ses-01.mcap"')
    assert list(verify_enrolment(study)) == []
    assert type_command("status", study)[0] == 0


def test_what_an_earlier_version_did_not_write_is_said_and_is_fine(study: Path) -> None:
    register = study / ENROLMENT_FILE_NAME
    slots = [line for line in map(msgspec.json.decode, register.read_bytes().splitlines()) if "participant" in line]
    register.write_bytes(
        b"".join(
            msgspec.json.encode({name: slot[name] for name in slot if name not in ("at", "previous", "digest")}) + b"\n"
            for slot in slots
        )
    )
    found = list(verify_enrolment(study))
    assert len(found) == 3
    assert all(fine for _, fine in found)
    assert type_command("status", study)[0] == 0


def test_a_session_that_was_cut_off_and_resumed_is_complete(tmp_path: Path) -> None:
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=1, cut=True)
    plan = plan_next_session(PROTOCOL, tmp_path, participant="sub-01")
    assert list(verify_enrolment(tmp_path / "corridor")) == []
    play(plan, tmp_path, episodes=2)
    assert list(verify_enrolment(tmp_path / "corridor")) == []


def test_a_slot_without_a_log_is_named_until_it_is_replaced(study: Path) -> None:
    code = plan_next_session(PROTOCOL, study.parent).participant.id
    assert list(verify_enrolment(study)) == [
        ("sub-03 has a slot and no log; if no session of theirs is running: minihuman replace sub-03", False)
    ]
    replace_participant(study, code)
    assert list(verify_enrolment(study)) == []


def test_a_study_whose_logs_are_all_gone_is_checked_and_a_folder_of_studies_too(study: Path) -> None:
    for participant in ("sub-01", "sub-02"):
        shutil.rmtree(study / participant)
    for folder in (study, study.parent):
        code, printed = type_command("verify", folder)
        assert (code, printed.count("is gone")) == (1, 2)


def test_who_withdrew_is_not_missed(study: Path) -> None:
    withdraw_participant(study, "sub-02", seal=None)
    assert list(verify_enrolment(study)) == []


def test_a_copy_beside_a_log_is_named_and_not_read(study: Path) -> None:
    log = study / "sub-01" / "ses-01" / "sub-01_ses-01.mcap"
    copy = log.with_name("sub-01_ses-01 (Bob conflicted copy).mcap")
    shutil.copy(log, copy)
    logs, skipped = list_readable_logs(study)
    assert log in logs
    assert copy not in logs
    assert [one.path for one in skipped] == [copy]
