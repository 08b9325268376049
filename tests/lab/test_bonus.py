"""What participants are paid."""

from pathlib import Path

import pytest

from minihuman.errors import AllocationError
from minihuman.lab.bonus import as_csv, for_platform, payments
from minihuman.lab.recruits import PlatformId, Recruits
from minihuman.lab.withdraw import withdraw
from minihuman.seats.simulate import simulate
from minihuman.study.protocol import decode

TOML = """
[study]
name = "paid"
version = "1"
seed = 1
[keys]
check = false
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
    protocol = decode((TOML + bonus).encode())
    list(simulate(protocol, data, participants=2, seed=0, player="optimal"))
    return data / "paid"


def test_points_are_paid_to_who_earned_them(tmp_path):
    folder = study(tmp_path, bonus='[bonus]\nper_point = 0.05\nbase = 1\ncurrency = "GBP"')
    Recruits(folder).remember(PlatformId("sub-01", "prolific", "5f2b"))
    first, second = as_csv(payments(folder)).splitlines()[1:]
    assert first == "sub-01,1,prolific,5f2b,complete,30.00,2.50,GBP"
    assert second == "sub-02,1,,,complete,30.00,2.50,GBP"
    assert for_platform(payments(folder), "prolific") == "5f2b,2.50\n"


def test_who_withdrew_is_in_no_payment(tmp_path):
    folder = study(tmp_path, bonus="[bonus]\nper_point = 0.05")
    withdraw(folder, "sub-01", seal=None)
    assert [one.participant for one in payments(folder)] == ["sub-02"]


def test_a_study_without_a_bonus_says_so(tmp_path):
    with pytest.raises(AllocationError, match="has no \\[bonus\\]"):
        list(payments(study(tmp_path, bonus="")))
