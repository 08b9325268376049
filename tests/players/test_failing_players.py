"""A simulated participant that crashes or has no answer: its session ends so, its slot is free, and every output says
which it was.
"""

from pathlib import Path

import msgspec
import pytest

from minihuman import plugins
from minihuman.admin.enrolment_entries import read_enrolled, read_enrolment_log
from minihuman.admin.status import count_participant_flow, format_status
from minihuman.admin.verify.log import verify_session
from minihuman.errors import PlayerFailedError
from minihuman.experiment.machine.events import SessionEnded
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.reporting.participant_flow import flow_table
from minihuman.runtime import simulated_window
from minihuman.runtime.simulated_session import _free_slot, simulate
from tests.counts import PATIENCE_S
from tests.lab_package import install_lab as install_lab

STUDY = """
[study]
name = "fails"
version = "1"
seed = 4
participants = 3
closing = ""
{consent}
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 4
episodes = 3
"""
PLAYERS = """
import signal
import time
from minihuman.ext import KeyPress, SimulatedParticipant

class Player(SimulatedParticipant):
    def __init__(self, argument, rng):
        self.argument, self.presses = argument, 0

    def begin(self, plan, pool, world):
        self.keys = [key for key, action in plan.key_map.keys.items() if action]
        if self.argument == "begin":
            open("/home/somebody/secret.txt")

    def press(self, world):
        self.presses += 1
        if self.presses > 6:
            match self.argument:
                case "crash":
                    return {}["/home/somebody/secret.txt"]
                case "none":
                    return None
                case "text":
                    return "left"
                case "banana":
                    return KeyPress("banana", 300.0)
                case "nan":
                    return KeyPress("1", float("nan"))
                case "spare":
                    return KeyPress("z", 300.0)
                case "hangs":
                    assert 0 < signal.getitimer(signal.ITIMER_REAL)[0] <= PATIENCE_S
                    signal.setitimer(signal.ITIMER_REAL, 0.01)  # its time is nearly over
                    while True:
                        time.sleep(0.01)
        return KeyPress(self.keys[0], 300.0)
""".replace("PATIENCE_S", str(PATIENCE_S))
FAILURES = {
    "crash": "KeyError",
    "begin": "FileNotFoundError",
    "none": "no answer",
    "text": "answered with a str, not a KeyPress",
    "banana": "an impossible key press",
    "nan": "an impossible key press",
    "spare": "no key that steps",
    "hangs": "TimeoutError",
}


@pytest.mark.parametrize(("how", "reason"), FAILURES.items())
def test_a_player_that_fails_ends_its_session_as_failed_and_its_slot_is_free(
    how: str, reason: str, tmp_path: Path, install_lab, monkeypatch
) -> None:
    monkeypatch.setattr(plugins, "ANSWER_TIMEOUT_S", PATIENCE_S)  # a busy machine is no player that hangs
    monkeypatch.setattr(simulated_window, "MOST_USELESS_PRESSES", 20)
    install_lab("lab", PLAYERS, players=["lab = a_lab:Player"])
    protocol = decode_protocol(STUDY.format(consent="").encode())
    with pytest.raises(PlayerFailedError, match=rf"^lab:{how}: .*sub-01_ses-01\.mcap .* slot is free again$"):
        list(simulate(protocol, tmp_path, participants=2, seed=1, player=f"lab:{how}"))
    study = tmp_path / "fails"
    [path] = study.rglob("*.mcap")
    log = read_log(path)
    [end] = [event for event in read_events(path) if isinstance(event, SessionEnded)]
    assert (end.reason, end.detail) == ("player_failed", reason)
    assert sum(len(episode.actions) for episode in log.episodes) == (0 if how == "begin" else 6)
    assert b"somebody" not in path.read_bytes()
    assert b"somebody" not in (study / "register.jsonl").read_bytes()
    assert [good for _, good in verify_session(path)] == [True]
    lines = list(format_status(study))
    assert "the simulated participant failed" in lines[1]
    flow = flow_table(count_participant_flow(study))
    assert ("simulated participant failed", "1", "1") in flow.rows
    assert not any(row[0] == "not finished" for row in flow.rows)
    [next_one] = simulate(protocol, tmp_path, participants=1, seed=1, player="random")
    assert [(slot.index, slot.participant) for slot in read_enrolled(study)][-1] == (
        0,
        read_log(next_one).plan.participant.id,
    )
    assert any(f"player_failed: {reason}" in repr(line) for line in read_enrolment_log(study))


def test_a_player_that_fails_before_anything_is_recorded_leaves_its_slot_and_its_reason(
    tmp_path: Path, install_lab, monkeypatch
) -> None:
    install_lab("lab", PLAYERS, players=["lab = a_lab:Player"])
    protocol = decode_protocol(STUDY.format(consent='consent = "I agree."').encode())
    monkeypatch.setattr(simulated_window, "LONGEST_NS", 0)
    with pytest.raises(PlayerFailedError, match="nothing was recorded, and the slot is free again"):
        list(simulate(protocol, tmp_path, participants=1, seed=1, player="lab:crash"))
    lines = list(format_status(tmp_path / "fails"))
    failed = "simulated participants that failed before anything was recorded"
    assert lines[1:] == [f"1 {failed}", f"flow: came 1 (then {failed} 1); allocated to a group 0; began 0; finished 0"]


def test_a_later_session_of_which_nothing_was_recorded_frees_no_slot(tmp_path: Path) -> None:
    protocol = decode_protocol(STUDY.format(consent="").encode())
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    failed = PlayerFailedError("lab:crash", "gone")
    said = _free_slot(tmp_path, msgspec.structs.replace(plan, session=2), failed)
    assert said == "nothing was recorded of session 2, and sub-01 can be simulated again"
    assert not (tmp_path / "fails").exists()
