"""check, simulate, status and run, as typed."""

import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner, Result

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.cli.command_line import make_command_line
from minihuman.errors import AllocationError, LogError, ProtocolError, ReportError
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import decode_protocol
from tests.counts import PATIENCE_S
from tests.study.test_protocol import without_place

pytestmark = pytest.mark.program

PROTOCOLS = Path(__file__).parents[2] / "protocols"
TRANSFER = PROTOCOLS / "fourrooms-transfer.toml"
CORRIDOR = """
[study]
name = "corridor"
version = "1"
seed = 3
participants = 9
[[groups]]
name = "all"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 1
actions = ["back", "forward", "dive"]
max_steps = 9
"""


def typed(*words: object) -> Result:
    return CliRunner().invoke(make_command_line(), [str(word) for word in words])


def edited(tmp_path: Path, old: str, new: str) -> Path:
    text = TRANSFER.read_text()
    assert old in text
    path = tmp_path / "edited.toml"
    path.write_text(text.replace(old, new))
    return path


@pytest.fixture
def grid_only(tmp_path: Path) -> Path:
    path = edited(tmp_path, 'blocks = ["grid", "first-person"]', 'blocks = ["grid"]')
    path.write_text(path.read_text().replace('blocks = ["first-person"]', 'blocks = ["grid"]'))
    return path


def test_check_prints_everything_a_participant_will_play():
    told = typed("check", TRANSFER, "--participant", "sub-02")
    assert told.exit_code == 0
    plan = expand_protocol(
        decode_protocol(TRANSFER.read_bytes()), enrol_participant(decode_protocol(TRANSFER.read_bytes()), 1)
    )
    for episode in plan.episodes:
        assert str(episode.seed) in told.stdout
    for key, action in plan.episodes[0].key_map.keys.items():
        assert f"{key} {action}" in told.stdout
    assert plan.consent_sha256 in told.stdout
    assert "at most 100 steps" in told.stdout


def test_check_prints_the_plan_itself_as_json():
    told = typed("check", TRANSFER, "--participant", "sub-03", "--json")
    study = decode_protocol(TRANSFER.read_bytes())
    assert told.stdout.strip().encode() == msgspec.json.encode(expand_protocol(study, enrol_participant(study, 2)))
    assert msgspec.json.decode(told.stdout, type=SessionPlan).participant.id == "sub-03"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            '"forward"]',
            '"fly"]',
            "$.blocks[0].actions names 'fly', which minihuman/MiniGrid-FourRooms-v0 does not have",
        ),
        (
            "max_steps = 100\n",
            'max_steps = 100\npace = "real_time"\nstep_period_ms = 200\nnoop_action = "doze"\n',
            "$.blocks[0].noop_action names 'doze', which minihuman/MiniGrid-FourRooms-v0 does not have",
        ),
        ("MiniGrid-FourRooms-v0", "MiniGrid-FiveRooms-v0", "$.blocks[0].world"),
        (
            "max_steps = 100\n",
            "max_steps = 101\n",
            "$.blocks[0].max_steps is 101, but minihuman/MiniGrid-FourRooms-v0 ends an episode after 100 steps",
        ),
        ("max_steps = 100\n", 'max_steps = 100\noptions = { colour = "red" }\n', "does not take {'colour': 'red'}"),
    ],
)
def test_check_finds_a_block_that_its_world_cannot_play(tmp_path, old, new, said):
    failed = typed("check", edited(tmp_path, old, new)).exception
    assert isinstance(failed, ProtocolError)
    assert said in without_place(str(failed))
    assert "\n" not in str(failed)


def test_check_finds_an_exclusion_by_a_measure_there_is_not(tmp_path):
    path = edited(tmp_path, 'measure = "completed_share"', 'measure = "complete_share"')
    failed = typed("check", path).exception
    assert isinstance(failed, ReportError)
    said = f"{path}: $.exclusions[0].measure: 'complete_share' is not a measure of a participant; use one of "
    assert str(failed).startswith(said)
    assert "completed_share" in str(failed)
    assert "\n" not in str(failed)


def test_a_protocol_that_is_not_there_is_said_so(tmp_path):
    failed = typed("check", tmp_path / "none.toml").exception
    assert isinstance(failed, ProtocolError)
    assert "No such file" in str(failed)


def test_simulate_prints_each_log_and_status_lists_them(tmp_path, grid_only):
    told = typed("simulate", grid_only, "--participants", 2, "--data", tmp_path, "--player", "optimal")
    assert told.exit_code == 0
    paths = [Path(line) for line in told.stdout.splitlines()]
    assert [path.name for path in paths] == ["sub-01_ses-01.mcap", "sub-02_ses-01.mcap"]
    assert all(path.exists() for path in paths)
    listed = typed("status", tmp_path / "fourrooms-transfer").stdout.splitlines()
    assert [line.split()[0] for line in listed[1:]] == ["sub-01", "sub-02", "flow:"]
    assert all("10/10" in line and "complete, optimal" in line for line in listed[1:3])


def test_the_status_of_no_study_is_an_error(tmp_path):
    assert isinstance(typed("status", tmp_path / "none").exception, LogError)


def test_more_participants_than_slots_are_refused_before_anybody_plays(tmp_path, grid_only):
    grid_only.write_text(grid_only.read_text().replace("participants = 60", "participants = 2"))
    options = ("--data", tmp_path / "data", "--player", "optimal")
    failed = typed("simulate", grid_only, "--participants", 3, *options)
    assert isinstance(failed.exception, AllocationError)
    assert "study 'fourrooms-transfer' has too few free slots (2) for 3 participants" in str(failed.exception)
    assert "which is 2" in str(failed.exception)
    assert (failed.stdout, (tmp_path / "data").exists()) == ("", False)
    assert typed("simulate", grid_only, "--participants", 1, *options).exit_code == 0
    failed = typed("simulate", grid_only, "--participants", 2, *options)
    assert "has too few free slots (1) for 2 participants" in str(failed.exception)
    assert len(list((tmp_path / "data").rglob("*.mcap"))) == 1


def test_what_nobody_could_read_is_refused_before_anybody_has_a_slot(tmp_path):
    path = tmp_path / "long.toml"
    path.write_text(CORRIDOR + 'feedback = { goal = "' + "That was well done. " * 300 + '" }')
    failed = typed("run", path, "--data", tmp_path / "data").exception
    assert isinstance(failed, ProtocolError)
    assert "walk, feedback for goal: does not fit a screen in type of 1/40 of its height" in str(failed)
    assert "shorten it" in str(failed)
    assert not (tmp_path / "data").exists()


def test_a_station_without_a_display_says_so_in_one_line_and_uses_up_no_slot(tmp_path, grid_only):
    nothing = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "minihuman", "run", str(grid_only), "--data", str(tmp_path / "data")]
    done = subprocess.run(command, env=nothing, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 2
    [line] = [line for line in done.stderr.splitlines() if line.startswith("minihuman:")]
    assert "window" in line
    assert read_enrolled(tmp_path / "data" / "fourrooms-transfer") == ()
