"""Members who quit, come back, or sit before a page and press nothing: which steps each log holds, and who acted."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import minihuman
from minihuman.activities.team.events import JointStepped, SeatTaken, TeamEnded
from minihuman.activities.team.joint_step import JointAction
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_teams
from minihuman.agents.agent import RandomAgent
from minihuman.dataset.selection import Selection
from minihuman.experiment.machine.events import EpisodeEnded, KeyPressed
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.replay import compare_replay
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.seat_agents import SeatAgent
from minihuman.runtime.team_host import TeamTable
from minihuman.worlds.adapters.world import World
from tests.activities.team.machines import Clock, Seat, sit_down
from tests.activities.team.study import PEOPLE, WITH_AGENT, team_study
from tests.activities.team.test_partners import TICKS, key_of, proven


def acted_without_a_key(seat: Seat) -> list[int]:
    """The joint steps in which a seat's log says that its person acted, though no key came before."""
    keys, found = 0, []
    for event in seat.events:
        keys += isinstance(event, KeyPressed) and event.verdict == "queued"
        if isinstance(event, JointStepped) and event.sources[seat.part.formed.seat] == "person":
            keys -= 1
            if keys < 0:
                found.append(event.step)
    return found


def step(*seats: Seat, action: str = "stay") -> None:
    """Make one joint step."""
    for seat in seats:
        seat.press(key_of(seat, action))
    for seat in seats:
        seat.wait(1)


def come_back(seat: Seat, protocol: Any, data: Path, table: TeamTable, **how: int) -> Seat:
    return Seat(protocol, data, table, participant=seat.plan.participant.id, **how)


@pytest.mark.parametrize("team", [PEOPLE, WITH_AGENT])
def test_a_block_that_is_played_again_on_another_day_begins_without_the_first_days_steps(
    tmp_path: Path, team: str
) -> None:
    path = team_study(tmp_path, team=f'{team}\npairing = "same"', episodes=1, max_steps=2, days=2)
    people = 2 if team == PEOPLE else 1
    seats, _, table = sit_down(path, tmp_path, people=people)
    seats[0].to_play(*seats[1:])
    for _ in range(2):
        step(*seats)
    for _ in range(4):
        for seat in seats:
            seat.wait(600)
            seat.press("enter")
    assert all(seat.machine.end_reason == "complete" for seat in seats)
    for seat in seats:
        seat.stop("connection_lost")
        seat.save()
    again = [come_back(seat, read_protocol(path), tmp_path, table, session=2, hour=24) for seat in seats]
    again[0].to_play(*again[1:])
    for seat in again:
        seat.wait(300)
    assert [seat.joint for seat in again] == [[]] * people
    step(*again, action="right")
    assert [len(seat.joint) for seat in again] == [1] * people
    assert [acted_without_a_key(seat) for seat in again] == [[]] * people


def test_who_quit_alone_in_the_middle_of_an_episode_begins_it_anew(tmp_path: Path) -> None:
    path = team_study(tmp_path, team=WITH_AGENT)
    (one,), _, table = sit_down(path, tmp_path, people=1)
    one.to_play()
    for _ in range(2):
        one.press(key_of(one, "stay"))
    assert len(one.joint) == 2
    one.stop_and_save()
    again = come_back(one, read_protocol(path), tmp_path, table, hour=1)
    again.to_play()
    again.wait(300)
    assert again.joint == []
    again.press(key_of(again, "right"))
    assert len(again.joint) == 1
    assert acted_without_a_key(again) == []
    assert [list(compare_replay(seat.events, World)) for seat in (one, again)] == [[], []]


def test_a_team_that_quit_and_comes_back_begins_the_episode_anew_and_goes_on_there_after_a_kill(tmp_path: Path) -> None:
    path = team_study(tmp_path)
    seats, clock, table = sit_down(path, tmp_path)
    seats[0].to_play(seats[1])
    for _ in range(3):
        step(*seats)
    assert [len(seat.joint) for seat in seats] == [3, 3]
    for seat in seats:
        seat.stop_and_save()
    again = [come_back(seat, read_protocol(path), tmp_path, table, hour=1) for seat in seats]
    again[0].to_play(again[1])
    assert [seat.joint for seat in again] == [[], []]
    step(*again, action="right")
    assert [len(seat.joint) for seat in again] == [1, 1]
    for seat in again:
        seat.save_part()
    table = TeamTable(read_protocol(path), tmp_path, clock)
    for seat in again:
        seat.resume(table)
    step(*again)
    assert [len(seat.joint) for seat in again] == [2, 2]
    assert again[0].joint == again[1].joint
    assert [acted_without_a_key(seat) for seat in again] == [[], []]
    assert proven(*seats, *again)


@pytest.mark.parametrize("leaves", ["agent", "end"])
def test_who_is_left_before_the_first_step_goes_back_to_the_lobby_and_plays_with_the_next(
    tmp_path: Path, leaves: str
) -> None:
    block = 'instructions = "Play together."'
    path = team_study(tmp_path, team=f'{PEOPLE}\npartner_leaves = "{leaves}"', episodes=1, max_steps=2, block=block)
    (one, two, three), _, _ = sit_down(path, tmp_path, people=3)
    one.press("enter")
    two.press("enter")
    one.wait(1000)
    first = one.part.formed.team
    assert two.part.formed.team == first
    two.stop_and_save()
    for _ in range(3):
        one.wait(300)
        one.press("enter")
    assert one.machine.phase is Phase.LOBBY
    assert [event.reason for event in one.of(TeamEnded)] == ["declined"]
    one.to_play(three)
    assert one.part.formed.team == three.part.formed.team != first
    for _ in range(2):
        step(one, three)
    for seat in (one, three):
        seat.wait(600)
        seat.press("enter", "enter")
        seat.save()
    assert one.machine.end_reason == three.machine.end_reason == "complete"
    assert [len(seat.joint) for seat in (one, two, three)] == [2, 0, 2]
    assert proven(one, three)
    assert [good for _, good in verify_teams(tmp_path / "duet")] == [True, True]
    log = read_log(next((tmp_path / "duet" / one.plan.participant.id).rglob("*.mcap")).parent)
    assert not log.stranded
    assert not one.machine._context.stranded
    assert log.waited_ns == one.machine._context.waited_ns


def test_who_is_left_in_an_episode_that_has_begun_stays_in_it(tmp_path: Path) -> None:
    (one, two), _, _ = sit_down(team_study(tmp_path), tmp_path)
    one.to_play(two)
    two.stop_and_save()
    one.press(key_of(one, "stay"))
    one.wait(1)
    assert len(one.joint) == 1
    assert one.of(TeamEnded) == []


def test_who_comes_back_while_the_partner_plays_on_catches_up_and_both_logs_agree(tmp_path: Path) -> None:
    path = team_study(tmp_path, episodes=1, max_steps=5)
    (one, two), _, table = sit_down(path, tmp_path)
    one.to_play(two)
    step(one, two, action="right")
    two.stop_and_save()
    for _ in range(2):
        one.press(key_of(one, "stay"))
        one.wait(1)
    assert len(one.joint) == 3
    again = come_back(two, read_protocol(path), tmp_path, table, hour=0)
    again.to_play()
    again.wait(300)
    assert again.joint == one.joint
    for _ in range(2):
        step(one, again)
    assert again.joint == one.joint
    assert one.of(JointStepped)[-1].sources == ("person", "person")
    for seat in (one, again):
        seat.wait(600)
        seat.press("enter")
        seat.stop("connection_lost")
        seat.save()
    assert all(good for _, good in verify_teams(tmp_path / "duet"))
    assert proven(one, two, again)


@pytest.mark.parametrize("rule", ["seat", "watch", "end"])
def test_after_a_kill_nobody_waits_for_a_seat_that_the_stand_in_has(tmp_path: Path, rule: str) -> None:
    path = team_study(tmp_path, team=f'{PEOPLE}\npartner_wait_s = 20\npartner_return = "{rule}"')
    (one, two), clock, _ = sit_down(path, tmp_path)
    one.to_play(two)
    one.press(key_of(one, "stay"))
    clock.s = 20.0
    one.wait(250)
    assert len(one.joint) == 1
    for seat in (one, two):
        seat.save_part()
    table = TeamTable(read_protocol(path), tmp_path, clock)
    one.resume(table)
    one.press(key_of(one, "stay"))
    one.wait(1)
    assert len(one.joint) == 2
    gone = two.part.formed.seat
    assert one.of(JointStepped)[-1].sources[gone] == "agent"
    assert proven(one)


def test_after_a_kill_a_block_that_a_partner_ended_is_over(tmp_path: Path) -> None:
    path = team_study(tmp_path, team=f'{PEOPLE}\npartner_leaves = "end"')
    (one, two), clock, _ = sit_down(path, tmp_path)
    one.to_play(two)
    two.host.close()  # and killed before its log says so
    one.press(key_of(one, "stay"))
    one.wait(1)
    assert [ended.reason for ended in one.of(TeamEnded)] == ["partner_left"]
    one.save_part()
    two.save_part()
    two.resume(TeamTable(read_protocol(path), tmp_path, clock))
    two.press(key_of(two, "stay"))
    two.wait(1)
    assert [ended.reason for ended in two.of(TeamEnded)] == ["partner_left"]


class Counting(RandomAgent):
    """Notes in which states it was asked."""

    def action_probabilities(self, world: World) -> Any:
        self.asked = [*getattr(self, "asked", []), world.state_hash()]
        return super().action_probabilities(world)


def test_an_agent_is_asked_in_every_state_once_also_where_it_takes_a_seat_late(tmp_path: Path) -> None:
    (one,), _, _ = sit_down(team_study(tmp_path, team=WITH_AGENT), tmp_path, people=1)
    one.to_play()
    plan, team = one.machine.play.plan, one.part.formed
    rows = [JointAction(actions, ("person", "agent")) for actions in ((0, 1), (1, 0), (1, 1))]
    asked = []
    for first in (0, 3):
        agent = Counting("")
        holder = SeatAgent(agent, plan, team, 1, 7)
        chosen = [holder.choose(rows[:n]) for n in range(first, 4)][-1]
        asked.append((agent.asked, chosen))
        holder.close()
    assert asked[0] == asked[1]
    assert len(asked[0][0]) == 4


def ticks(clock: Clock, *seats: Seat, number: int) -> None:
    for _ in range(number):
        clock.s += 0.1
        for seat in seats:
            seat.wait(101)
        for seat in seats:
            seat.wait(1)


def test_in_ticks_who_presses_nothing_is_absent_and_comes_back_with_a_key(tmp_path: Path) -> None:
    path = team_study(tmp_path, block=TICKS, team=f"{PEOPLE}\npartner_wait_s = 2", max_steps=40)
    (one, two), clock, _ = sit_down(path, tmp_path)
    one.to_play(two)
    for _ in range(30):
        one.press(key_of(one, "left"))
        ticks(clock, one, two, number=1)
    gone = two.part.formed.seat
    sources = [step.sources[gone] for step in one.of(JointStepped)]
    assert sources[:18] == ["person"] * 18
    assert set(sources[21:]) == {"agent"}
    assert two.machine.screen.controller_text == "A computer program plays for you now"
    two.press(key_of(two, "left"))
    one.press(key_of(one, "left"))
    ticks(clock, one, two, number=2)
    assert [(taken.seat, taken.by) for taken in one.of(SeatTaken)] == [(gone, "agent"), (gone, "person")]
    assert one.joint == two.joint
    assert proven(one, two)


def test_in_ticks_nobody_is_absent_from_who_plays_alone(tmp_path: Path) -> None:
    path = team_study(tmp_path, block=TICKS, team=f"{WITH_AGENT}\npartner_wait_s = 2", max_steps=40)
    (one,), clock, _ = sit_down(path, tmp_path, people=1)
    one.to_play()
    ticks(clock, one, number=45)
    assert len(one.of(EpisodeEnded)) == 1
    assert {step.sources[one.part.formed.seat] for step in one.of(JointStepped)} == {"person"}


def test_a_table_keeps_nothing_of_teams_whose_sessions_are_over(tmp_path: Path) -> None:
    (one, two), _, table = sit_down(team_study(tmp_path), tmp_path)
    one.to_play(two)
    assert len(table._teams) == 1
    one.stop("connection_lost")
    two.stop("connection_lost")
    assert table._teams == {}


@pytest.mark.parametrize("changed", [False, True])
def test_logs_are_compared_by_pairs_where_the_first_seat_has_none(tmp_path: Path, changed: bool) -> None:
    team = PEOPLE.replace('["person", "person"]', '["person", "person", "person", "person"]')
    world, four = "minihuman/Team-CrampedRoom-v0", 'options = { layout = "multiplayer_schelling" }'
    path = team_study(tmp_path, team=team, world=world, block=four, episodes=1, max_steps=3)
    seats, _, _ = sit_down(path, tmp_path, people=4)
    seats[0].to_play(*seats[1:])
    for _ in range(2):
        step(*seats)
    _, second, third, _ = sorted(seats, key=lambda seat: seat.part.formed.seat)
    if changed:
        third.events = [
            replace(event, actions=(0, 0, 0, 0)) if isinstance(event, JointStepped) and event.step == 2 else event
            for event in third.events
        ]
    for seat in (second, third):
        seat.stop_and_save()
    [(text, good)] = list(verify_teams(tmp_path / "duet"))
    assert good == (not changed)
    assert (
        "episode 1 of the block step 2: seat 1 logged [4, 4, 4, 4], seat 2 logged [0, 0, 0, 0]"
        if changed
        else "2 joint steps, the same in each log here (seats 1 and 2)"
    ) in text


def test_the_second_attempt_of_one_is_compared_with_the_first_of_the_other(tmp_path: Path) -> None:
    path = team_study(tmp_path, episodes=1, max_steps=5)
    (one, two), _, table = sit_down(path, tmp_path)
    one.to_play(two)
    step(one, two, action="right")
    two.stop_and_save()
    back = come_back(two, read_protocol(path), tmp_path, table)
    one.press(key_of(one, "stay"))
    back.to_play()
    step(one, back)
    for seat in (one, back):  # both leave, and begin the episode anew
        seat.stop_and_save()
    again = [come_back(seat, read_protocol(path), tmp_path, table, hour=1) for seat in (one, back)]
    again[0].to_play(again[1])
    step(*again, action="left")
    for seat in again:
        seat.stop_and_save()
    assert [good for _, good in verify_teams(tmp_path / "duet")] == [True]


def test_tables_report_exclusions_and_verify_agree_on_who_played_while_a_partner_was_away(tmp_path: Path) -> None:
    excluded = '[[exclusions]]\nlevel = "episode"\nmeasure = "absent_share"\nabove = 0.3\nreason = "partner away"\n'
    team = f"{PEOPLE}\npartner_wait_s = 2"
    path = team_study(tmp_path, block=TICKS, team=team, max_steps=40, episodes=2, more=excluded)
    (one, two), clock, _ = sit_down(path, tmp_path)
    one.to_play(two)
    away = two.part.formed.seat
    for episode in range(2):
        while len(one.of(EpisodeEnded)) == episode:
            one.press(key_of(one, "left"))
            is_away = episode == 0 and len(one.joint) >= 5
            if not is_away:
                two.press(key_of(two, "left"))
            ticks(clock, one, two, number=1)
        if episode == 0:
            one.to_play(two)
    for seat in (one, two):
        seat.wait(600)
        seat.press("enter")
        seat.stop_and_save()
    agent_steps = sum(event.sources[away] == "agent" for event in one.of(JointStepped))
    assert agent_steps > 12
    assert all(good for _, good in verify_teams(tmp_path / "duet"))
    study = minihuman.open_study(tmp_path / "duet", Selection(with_=("rules",)))
    teams = study.table("teams")
    assert set(teams["agent_steps"]) == {agent_steps, 0}
    played_by = json.loads(teams["played_by"].iloc[0])
    assert played_by[away] == {"agent": agent_steps, "person": 40 - agent_steps}
    assert played_by[1 - away] == {"person": 40}
    assert set(teams["absent_share"]) == {agent_steps / 40, 0.0}
    assert set(study.table("absences")["state"]) == {"idle", "here"}
    episodes = minihuman.open_study(tmp_path / "duet").table("episodes", with_excluded=True)
    assert list(episodes.loc[episodes["absent_share"] > 0.3, "exclusion_reason"]) == ["partner away"] * 2
    minihuman.report(tmp_path / "duet", tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert '<h2 id="who-played">Who played</h2>' in page
    assert "partner away" in page
