"""Lobbies, partners who leave and come back, late inputs, and what each log may say of the others."""

from pathlib import Path

import pytest

from minihuman.activities.team.events import InputLate, JointStepped, SeatTaken, TeamEnded, TeamFormed
from minihuman.admin.payments import compute_payments
from minihuman.experiment.machine.events import EpisodeEnded, EpisodesSkipped, KeyPressed
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.dry_run import describe_plan
from minihuman.experiment.replay import compare_replay
from minihuman.worlds.adapters.world import World
from tests.activities.team.machines import Seat, sit_down
from tests.activities.team.study import PEOPLE, team_study

TICKS = 'pace = "real_time"\nstep_period_ms = 100'
KEYS = {"left": 0, "right": 1, "stay": 2}


def key_of(seat: Seat, action: str) -> str:
    return next(key for key, name in seat.machine.play.plan.key_map.keys.items() if name == action)


def proven(*seats: Seat) -> bool:
    return all(list(compare_replay(seat.events, World)) == [] for seat in seats)


def test_in_turns_a_step_waits_for_every_seat_and_a_second_key_changes_nothing(tmp_path: Path) -> None:
    (one, two), _, _ = sit_down(team_study(tmp_path), tmp_path)
    one.to_play(two)
    one.press(key_of(one, "right"), key_of(one, "left"))
    assert one.joint == []
    assert [press.verdict for press in one.of(KeyPressed)[-2:]] == ["queued", "not_playing"]
    assert one.machine.screen.controller_text == "Waiting for the others"
    two.press(key_of(two, "stay"))
    one.wait(1)
    expected = [0, 0]
    expected[one.part.formed.seat], expected[two.part.formed.seat] = KEYS["right"], KEYS["stay"]
    assert one.joint == two.joint == [tuple(expected)]
    assert proven(one, two)


def test_a_log_names_the_others_by_seat_and_never_by_code(tmp_path: Path) -> None:
    (one, two), _, _ = sit_down(team_study(tmp_path), tmp_path)
    one.to_play(two)
    [formed], [other] = one.of(TeamFormed), two.of(TeamFormed)
    assert (formed.team, formed.index) == (other.team, other.index)
    assert {formed.seat, other.seat} == {0, 1}
    assert two.plan.participant.id not in repr(one.events)
    assert one.machine.play.plan.seed == two.machine.play.plan.seed != one.plan.episodes[0].seed


def test_a_partner_who_gives_no_input_loses_the_seat_to_an_agent_and_has_it_back_at_the_next_key(
    tmp_path: Path,
) -> None:
    (one, two), clock, _ = sit_down(team_study(tmp_path, team=f"{PEOPLE}\npartner_wait_s = 20"), tmp_path)
    one.to_play(two)
    one.press(key_of(one, "stay"))
    clock.s = 19.0
    one.wait(250)
    assert one.joint == []
    clock.s = 20.0
    one.wait(250)
    [step] = one.of(JointStepped)
    gone = two.part.formed.seat
    assert step.sources[gone] == "agent"
    assert [(taken.seat, taken.by, taken.step) for taken in one.of(SeatTaken)] == [(gone, "agent", 1)]
    two.wait(250)  # the one who left is there again: first sees what happened, then acts
    assert two.joint == one.joint
    two.press(key_of(two, "right"))
    one.press(key_of(one, "stay"))
    two.wait(1)
    assert one.joint == two.joint
    assert one.of(JointStepped)[-1].sources == ("person", "person")
    assert [taken.by for taken in two.of(SeatTaken)] == ["agent", "person"]
    assert proven(one, two)


def test_a_partner_who_leaves_ends_the_block_where_the_protocol_says_so_and_the_session_goes_on(tmp_path: Path) -> None:
    team = f'{PEOPLE}\npartner_leaves = "end"\npartner_wait_s = 5'
    (one, two), clock, _ = sit_down(team_study(tmp_path, team=team, episodes=3), tmp_path)
    one.to_play(two)
    one.press(key_of(one, "stay"))
    two.host.close()  # the session is over: nobody waits
    one.wait(1)
    assert [ended.reason for ended in one.of(TeamEnded)] == ["partner_left"]
    assert [(ended.outcome, ended.cause) for ended in one.of(EpisodeEnded)] == [("ended", "partner_left")]
    one.wait(10)
    assert [(skip.count, skip.reason) for skip in one.of(EpisodesSkipped)] == [(2, "partner_left")]
    assert one.machine.phase is Phase.CLOSING
    assert clock.s == 0.0
    assert proven(one)


@pytest.mark.parametrize(("leaves", "reason"), [("end", "no_partner"), ("agent", "")])
def test_nobody_waits_in_the_lobby_longer_than_the_protocol_says(tmp_path: Path, leaves: str, reason: str) -> None:
    team = f'{PEOPLE}\npartner_leaves = "{leaves}"\nlobby_s = 30'
    (one,), clock, _ = sit_down(team_study(tmp_path, team=team), tmp_path, people=1)
    one.press("enter")
    assert one.machine.phase is Phase.LOBBY
    clock.s = 29.0
    one.wait(250)
    assert one.machine.phase is Phase.LOBBY
    clock.s = 30.0
    one.wait(250)
    assert [ended.reason for ended in one.of(TeamEnded)] == ([reason] if reason else [])
    if reason:
        assert one.machine.phase is Phase.CLOSING
    else:
        assert sorted(one.part.formed.seats) == ["person", "scripted:random"]
    assert proven(one)


def test_who_comes_back_watches_until_the_next_episode_where_the_protocol_says_so(tmp_path: Path) -> None:
    team = f'{PEOPLE}\npartner_return = "watch"\npartner_wait_s = 20'
    (one, two), clock, _ = sit_down(team_study(tmp_path, team=team, max_steps=3), tmp_path)
    one.to_play(two)
    for number in range(3):
        one.press(key_of(one, "stay"))
        clock.s += 20.0 * (number == 0)
        one.wait(250)
        two.wait(250)
        if number < 2:
            assert two.machine.screen.controller_text == "A computer program plays for you now"
            two.press(key_of(two, "right"))
    gone = two.part.formed.seat
    assert [step.sources[gone] for step in one.of(JointStepped)] == ["agent"] * 3
    assert [late.step for late in two.of(InputLate)] == [2, 3]
    one.to_play(two)
    one.press(key_of(one, "stay"))
    two.press(key_of(two, "stay"))
    one.wait(1)
    assert one.of(JointStepped)[-1].sources == ("person", "person")
    assert proven(one, two)


def test_who_comes_back_goes_on_behind_the_block_where_the_seat_is_lost_for_good(tmp_path: Path) -> None:
    team = f'{PEOPLE}\npartner_return = "end"\npartner_wait_s = 20'
    (one, two), clock, _ = sit_down(team_study(tmp_path, team=team), tmp_path)
    one.to_play(two)
    one.press(key_of(one, "stay"))
    clock.s = 20.0
    one.wait(250)
    two.wait(250)
    two.press(key_of(two, "right"))
    assert [ended.reason for ended in two.of(TeamEnded)] == ["replaced"]
    two.wait(10)
    assert two.machine.phase is Phase.CLOSING
    one.press(key_of(one, "stay"))
    assert len(one.joint) == 2  # the stand-in plays on
    assert proven(one, two)


def test_waiting_is_paid_and_who_found_no_partner_or_was_left_has_the_base_pay(tmp_path: Path) -> None:
    bonus = "[bonus]\nper_point = 0.5\nwaiting_per_min = 0.2\nbase_pay = 4.0\n"
    closing = 'closing = "{bonus}"\n'
    team, block = f'{PEOPLE}\npartner_leaves = "end"\nlobby_s = 90', 'instructions = "Play together."'
    path = team_study(tmp_path, team=team, block=block, more=bonus)
    path.write_text(path.read_text(encoding="utf-8").replace("seed = 7\n", f"seed = 7\n{closing}"), encoding="utf-8")
    said = [line for line in describe_plan(sit_down(path, tmp_path / "check")[0][0].plan) if line.startswith("pay ")]
    assert said[1] == "pay          no partner: at least 4, and 0.2 for each minute in a lobby, at most 1.5 min"
    (one, two, three), clock, _ = sit_down(path, tmp_path, people=3)
    one.press("enter")
    one.wait(30_000)
    two.press("enter")
    one.to_play(two)
    three.press("enter")
    clock.s = 90.0
    three.wait(90_000)
    two.stop("connection_lost")
    one.press(key_of(one, "stay"))
    one.wait(10)
    for seat, paid in ((one, "4.10"), (three, "4.30")):
        assert paid in repr(seat.machine.screen)
        seat.press("enter")
    for seat in (one, two, three):
        seat.save()
    payments = {pay.participant: pay for pay in compute_payments(tmp_path / "duet")}
    assert [payments[code].bonus for code in ("sub-01", "sub-02", "sub-03")] == [4.1, 0.0, 4.3]
    assert payments["sub-03"].waited_min == pytest.approx(1.5, abs=0.01)


def test_who_left_the_lobby_is_paired_with_nobody(tmp_path: Path) -> None:
    path = team_study(tmp_path, block='instructions = "Play together."')
    (one, two, three), clock, _ = sit_down(path, tmp_path, people=3)
    one.press("enter")
    clock.s = 10.0  # its page is closed: it asks no more
    two.press("enter")
    assert two.machine.phase is Phase.LOBBY
    three.press("enter")
    two.wait(250)
    assert two.part.formed.team == three.part.formed.team
    assert one.machine.phase is Phase.LOBBY


def test_a_tick_that_is_late_is_idled_never_reopened_and_the_late_key_is_logged(tmp_path: Path) -> None:
    path = team_study(tmp_path, block=TICKS, team=f"{PEOPLE}\nlate_ms = 150")
    (one, two), clock, _ = sit_down(path, tmp_path)
    one.to_play(two)
    for seat in (one, two):
        seat.wait(1)  # the first picture is seen
    two.is_connected = False
    two.press(key_of(two, "right"))
    two.wait(101)
    one.wait(101)
    assert one.joint == []
    clock.s = 0.16
    one.wait(10)
    assert one.joint == []  # by the server's clock the tick is due after 100 ms
    clock.s = 0.26
    one.wait(10)
    [step] = one.of(JointStepped)
    assert step.sources[two.part.formed.seat] == "late"
    two.is_connected = True
    two.wait(1)
    assert two.joint == one.joint
    assert [(late.step, late.action) for late in two.of(InputLate)] == [(1, KEYS["right"])]
    assert proven(one, two)


def test_a_held_key_acts_at_every_tick_until_it_is_released(tmp_path: Path) -> None:
    path = team_study(tmp_path, block=f'{TICKS}\nhold = "repeat"')
    (one, two), _, _ = sit_down(path, tmp_path)
    one.to_play(two)
    for seat in (one, two):
        seat.wait(1)
    one.press(key_of(one, "right"))  # and never released
    for _ in range(3):
        for seat in (one, two):
            seat.wait(101)
    seat = one.part.formed.seat
    assert [actions[seat] for actions in one.joint[:2]] == [KEYS["right"]] * 2
    assert one.joint[:2] == two.joint[:2]
    assert proven(one, two)


@pytest.mark.parametrize("pairing", ["same", "round_robin", "drawn", "fixed"])
def test_who_plays_with_whom_in_the_next_block(tmp_path: Path, pairing: str) -> None:
    path = team_study(
        tmp_path, team=f'{PEOPLE}\npairing = "{pairing}"', episodes=1, max_steps=1, blocks=("first", "second")
    )
    seats, _, _ = sit_down(path, tmp_path, people=4)
    seats[0].to_play(*seats[1:])
    for seat in seats:
        seat.press(key_of(seat, "stay"))
    for _ in range(3):
        for seat in seats:
            seat.wait(600)
    seats[0].to_play(*seats[1:])
    teams = [[formed.team for formed in seat.of(TeamFormed)] for seat in seats]
    mates = [
        [
            next(n for n, other in enumerate(teams) if n != mine and other[block] == teams[mine][block])
            for block in (0, 1)
        ]
        for mine in range(4)
    ]
    if pairing == "fixed":
        assert mates == [[1, 1], [0, 0], [3, 3], [2, 2]]
    if pairing == "same":
        assert all(first == second for first, second in teams)
    if pairing == "round_robin":
        assert all(first != second for first, second in mates)
    assert proven(*seats)
