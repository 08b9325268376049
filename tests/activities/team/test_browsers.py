"""Two people in two browsers play in one world, in turns and in ticks, whatever is cut or killed."""

from pathlib import Path

import pytest

from minihuman.activities.team.events import InputLate, JointStepped, PictureCorrected
from minihuman.experiment.machine.events import Stepped
from minihuman.log.read.session_reader import read_log
from tests.activities.team.browsers import play_together
from tests.activities.team.study import team_study
from tests.counts import count
from tests.machine import needs

pytestmark = needs("chromium")


@pytest.mark.nightly(by_day=["turns"])
@pytest.mark.program
@pytest.mark.parametrize("pace", ["turns", "ticks"])
def test_two_people_in_browsers_play_to_the_end_and_each_log_proves_all_bodies(tmp_path: Path, pace: str) -> None:
    ticks = 'pace = "real_time"\nstep_period_ms = 100' if pace == "ticks" else ""
    protocol = team_study(tmp_path, episodes=count(1, 20), max_steps=10, block=ticks)
    played, _ = play_together(protocol, tmp_path, rtt_ms=60)
    assert played.complaints == [[], []]
    assert played.joint[0] == played.joint[1] != []
    assert played.count(Stepped) == played.count(JointStepped)
    assert played.lost == [[], []]
    assert played.notes == []
    assert [good for _, good in played.teams] == [True]
    assert (sum(played.count(PictureCorrected)) > 0) == (pace == "turns")


@pytest.mark.program
def test_a_server_killed_and_connections_cut_lose_no_press_and_both_go_on(tmp_path: Path) -> None:
    times = count({"kill": 1, "cut": 1}, {"kill": 100, "cut": 100, "reload": 50})
    protocol = team_study(tmp_path, episodes=1 + sum(times.values()) // 2)
    played, happened = play_together(protocol, tmp_path, interruptions=times, seed=3)
    assert happened == times
    assert played.complaints == [[], []]
    assert played.joint[0] == played.joint[1] != []
    assert played.lost == [[], []]
    assert played.count(InputLate) == [0, 0]
    assert [good for _, good in played.teams] == [True]


@pytest.mark.nightly
@pytest.mark.program
def test_two_people_whose_networks_block_sockets_play_in_ticks_over_http(tmp_path: Path) -> None:
    ticks = 'pace = "real_time"\nstep_period_ms = 400'
    protocol = team_study(tmp_path, episodes=1, max_steps=20, block=ticks)
    played, _ = play_together(protocol, tmp_path, upgrades="closed")
    assert [read_log(log).facts["transport"] for log in sorted((tmp_path / "duet").rglob("*.mcap"))] == ["http"] * 2
    assert played.complaints == [[], []]
    assert played.joint[0] == played.joint[1] != []
    assert played.lost == [[], []]
    assert [good for _, good in played.teams] == [True]
