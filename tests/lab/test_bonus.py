"""What participants are paid."""

import shutil
from pathlib import Path

import pytest

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.payments import compute_payments, format_payments_csv, format_platform_payments
from minihuman.admin.recruitment import PlatformId, Recruitment
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.errors import AllocationError, LogError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate
from tests.lab.test_next_session import PROTOCOL, play

TOML = """
[study]
name = "paid"
version = "1"
seed = 1
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["rooms"]
[[blocks]]
name = "rooms"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 3
max_steps = 30
actions = ["left", "right", "forward"]
points = { goal = 10 }
"""


def study(data: Path, *, bonus: str) -> Path:
    protocol = decode_protocol((TOML + bonus).encode())
    list(simulate(protocol, data, participants=2, seed=0, player="optimal"))
    return data / "paid"


def test_points_are_paid_to_who_earned_them(tmp_path):
    folder = study(tmp_path, bonus='[bonus]\nper_point = 0.05\nbase = 1\ncurrency = "GBP"')
    Recruitment(folder).remember(PlatformId("sub-01", "prolific", "5f2b"))
    first, second = format_payments_csv(compute_payments(folder)).splitlines()[1:]
    assert first == "sub-01,1,prolific,5f2b,complete,30.00,2.50,GBP,0.00"
    assert second == "sub-02,1,,,complete,30.00,2.50,GBP,0.00"
    assert format_platform_payments(compute_payments(folder), "prolific") == "5f2b,2.50\n"


def test_who_withdrew_is_in_no_payment(tmp_path):
    folder = study(tmp_path, bonus="[bonus]\nper_point = 0.05")
    withdraw_participant(folder, "sub-01", seal=None)
    assert [one.participant for one in compute_payments(folder)] == ["sub-02"]


def test_a_study_without_a_bonus_says_so(tmp_path):
    with pytest.raises(AllocationError, match="has no \\[bonus\\]"):
        list(compute_payments(study(tmp_path, bonus="")))


def test_nobody_whose_log_cannot_be_read_is_left_out_without_a_word(tmp_path):
    folder = study(tmp_path, bonus="[bonus]\nper_point = 0.05")
    log = folder / "sub-01" / "ses-01" / "sub-01_ses-01.mcap"
    log.write_bytes(log.read_bytes()[:2000])
    with pytest.raises(LogError, match=r"sub-01_ses-01\.mcap cannot be read"):
        list(compute_payments(folder))
    withdraw_participant(folder, "sub-01", seal=None)
    assert [one.participant for one in compute_payments(folder)] == ["sub-02"]


def test_a_session_that_was_copied_within_its_study_is_not_paid_twice(tmp_path):
    folder = study(tmp_path, bonus="[bonus]\nper_point = 0.05")
    shutil.copytree(folder / "sub-01", folder / "backup" / "sub-01")
    with pytest.raises(LogError, match="record the same session; move one of them"):
        list(compute_payments(folder))


def test_what_was_earned_before_a_cut_is_paid_before_the_log_is_finished(tmp_path):
    points = b"points = { failure = 10 }\n[bonus]\nper_point = 0.05"
    protocol = decode_protocol(PROTOCOL.toml + points)
    play(plan_next_session(protocol, tmp_path), tmp_path, episodes=1)
    play(plan_next_session(protocol, tmp_path, participant="sub-01"), tmp_path, episodes=1, cut=True)
    [one] = compute_payments(tmp_path / "corridor")
    assert (one.points, one.bonus, one.end) == (20.0, 1.0, "cut_off")
