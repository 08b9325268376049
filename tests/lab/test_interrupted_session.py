"""A session that a crash cut off is named before the next participant gets a slot."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.next_session import find_interrupted_session, find_unused_slots, plan_next_session
from minihuman.admin.withdrawal import replace_participant
from minihuman.api import run
from minihuman.cli.command_line import make_command_line
from minihuman.errors import AllocationError
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.lab.test_next_session import PROTOCOL, play

TOML = """
[study]
name = "corridor"
version = "1"
seed = 11
[[groups]]
name = "one"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 3
actions = ["back", "forward", "dive"]
max_steps = 9
"""


@pytest.fixture
def protocol(tmp_path: Path) -> Path:
    path = tmp_path / "corridor.toml"
    path.write_text(TOML)
    return path


def test_the_next_run_names_the_session_and_the_command_and_takes_no_slot(tmp_path: Path, protocol: Path) -> None:
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=1, cut=True)
    with pytest.raises(AllocationError) as refused:
        run(protocol, data=tmp_path)
    assert str(refused.value) == (
        f"session 1 of sub-01 was cut off after 1 of 3 episodes; resume it: minihuman run {protocol} --data {tmp_path} "
        "--participant sub-01; or take the next slot with --next-slot"
    )
    typed = CliRunner().invoke(make_command_line(), ["run", str(protocol), "--data", str(tmp_path)])
    assert str(typed.exception) == str(refused.value)
    assert [slot.participant for slot in read_enrolled(tmp_path / "corridor")] == ["sub-01"]


def test_one_that_was_recovered_is_found_too_until_the_participant_is_replaced(tmp_path: Path) -> None:
    study = tmp_path / "corridor"
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=1, cut=True)
    CliRunner().invoke(make_command_line(), ["recover", str(study)])
    found = find_interrupted_session(study)
    assert found is not None
    assert (found.participant, found.session) == ("sub-01", 1)
    replace_participant(study, "sub-01")
    assert find_interrupted_session(study) is None


def test_a_finished_a_closed_and_a_running_session_are_none(tmp_path: Path) -> None:
    assert find_interrupted_session(tmp_path / "corridor") is None
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=3)
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=1)
    plan = plan_next_session(PROTOCOL, tmp_path)
    recorder = McapRecorder(tmp_path, plan, started_ns=1)
    assert find_interrupted_session(tmp_path / "corridor") is None
    recorder.close()


def test_who_has_a_slot_and_no_log_is_named_until_replaced(tmp_path: Path) -> None:
    study = tmp_path / "corridor"
    assert find_unused_slots(study) == ()
    plan_next_session(PROTOCOL, tmp_path)  # and killed before consent
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=1)
    assert find_unused_slots(study) == ("sub-01",)
    replace_participant(study, "sub-01")
    assert find_unused_slots(study) == ()
