"""A team's barrier and joint steps by themselves: what its seats ask at which time, and what they are told."""

from typing import Any

import pytest

from minihuman.activities.team.joint_play import JointPlay, TeamHistory
from minihuman.activities.team.joint_step import JointAction, OpenStep, StepDue
from minihuman.activities.team.message_events import MessageShown
from minihuman.activities.team.message_exchange import MessageExchange
from minihuman.activities.team.plan import TeamPlan, TeamPlayPlan
from minihuman.activities.team.requests import JointRequest, JointTaken, ReadyRequest, SeatsReady, Team, TeamLost
from minihuman.activities.team.step_clock import StepClock
from minihuman.experiment.plan.session_plan import EpisodePlan, KeyMap

KINDS = ("person", "person", "scripted:random")
LATE_MS, WAIT_S, IDLE = 100, 10.0, 9


def play(**rules: Any) -> JointPlay:
    return JointPlay(KINDS, TeamPlan(seats=KINDS, late_ms=LATE_MS, partner_wait_s=WAIT_S, **rules))


PLAN = EpisodePlan(
    episode=0,
    block=0,
    block_name="kitchen",
    episode_in_block=0,
    episodes_in_block=1,
    world="minihuman/Team-CrampedRoom-v0",
    options={},
    seed=0,
    actions=(),
    key_map=KeyMap(keys={}, spare_keys=(), spare="none", seed=0),
    show_keys=False,
    pace="on_key",
    step_period_ms=0.0,
    noop=None,
    auto_repeat=False,
    max_steps=10,
    view="full",
    palette="standard",
)
BLOCK = TeamPlayPlan(0, 1, 0, 1)


def ready(seat: int) -> ReadyRequest:
    return ReadyRequest(Team("ab", 0, seat, KINDS), PLAN, BLOCK)


def act(seat: int, action: int | None, *, step: int = 1, is_key: bool = True) -> JointRequest:
    team = Team("ab", 0, seat, KINDS)
    return JointRequest(team, PLAN, BLOCK, step, action, is_key)


def close(joint: JointPlay, due: object, seat: int) -> JointTaken:
    assert isinstance(due, StepDue)
    return joint.close(due, seat, dict.fromkeys(due.agents, 7), IDLE)


def test_an_episode_begins_once_all_people_are_ready_and_the_others_are_told():
    joint = play()
    assert joint.answer_ready(ready(0), 0.0) is None
    assert joint.pop_concerned() == set()
    assert joint.answer_ready(ready(1), 1.0) == SeatsReady(0, 0)
    assert joint.pop_concerned() == {0}
    assert joint.answer_ready(ready(0), 1.0) == SeatsReady(0, 0)


def test_an_episode_begins_with_the_stand_in_when_a_partner_is_not_ready_in_time():
    joint = play()
    joint.answer_ready(ready(0), 0.0)
    assert joint.answer_ready(ready(0), WAIT_S) == SeatsReady(0, 0)
    assert joint.presence.absent == {1}


def test_a_block_ends_when_a_partner_is_not_ready_in_time_and_agents_do_not_stand_in():
    joint = play(partner_leaves="end")
    joint.answer_ready(ready(0), 0.0)
    assert joint.answer_ready(ready(0), WAIT_S) == TeamLost(0, "partner_left")
    assert joint.pop_concerned() == {0, 1}
    assert joint.answer_ready(ready(1), WAIT_S) == TeamLost(0, "partner_left")


def test_a_step_closes_when_both_people_acted_with_the_agents_choice_in_its_seat():
    joint = play()
    assert joint.submit(act(0, 3), 0.0, is_real_time=False) is None
    due = joint.submit(act(1, 4), 5.0, is_real_time=False)
    assert isinstance(due, StepDue)
    assert due.agents == (2,)
    taken = close(joint, due, 1)
    assert (taken.actions, taken.sources) == ((3, 4, 7), ("person", "person", "agent"))
    assert joint.pop_concerned() == {0}


def test_a_closed_step_never_reopens_whatever_is_asked_of_it():
    joint = play()
    joint.submit(act(0, 3), 0.0, is_real_time=False)
    taken = close(joint, joint.submit(act(1, 4), 0.0, is_real_time=False), 1)
    assert joint.submit(act(0, 8), 99.0, is_real_time=False) == taken


def test_of_two_inputs_of_a_seat_the_first_counts():
    joint = play()
    joint.submit(act(0, 3), 0.0, is_real_time=False)
    joint.submit(act(0, 5), 0.1, is_real_time=False)
    assert close(joint, joint.submit(act(1, 4), 0.2, is_real_time=False), 1).actions[0] == 3


def test_a_tick_closes_without_a_late_input_and_its_seat_idles():
    joint = play()
    assert joint.submit(act(0, 3), 0.0, is_real_time=True) is None
    assert joint.submit(act(0, 3), 0.099, is_real_time=True) is None
    taken = close(joint, joint.submit(act(0, 3), 0.1, is_real_time=True), 0)
    assert (taken.actions, taken.sources) == ((3, IDLE, 7), ("person", "late", "agent"))


def test_without_real_time_a_step_waits_for_its_partner_until_the_stand_in_acts():
    joint = play()
    joint.submit(act(0, 3), 0.0, is_real_time=False)
    assert joint.submit(act(0, 3), WAIT_S - 0.1, is_real_time=False) is None
    taken = close(joint, joint.submit(act(0, 3), WAIT_S, is_real_time=False), 0)
    assert taken.sources == ("person", "agent", "agent")


def test_a_step_ends_the_block_when_a_partner_does_not_act_and_agents_do_not_stand_in():
    joint = play(partner_leaves="end")
    joint.submit(act(0, 3), 0.0, is_real_time=False)
    assert joint.submit(act(0, 3), WAIT_S, is_real_time=False) == TeamLost(0, "partner_left")


def test_who_presses_no_key_at_any_tick_loses_the_seat_and_a_key_takes_it_back():
    joint = play()
    for step, now_s in ((1, 0.0), (2, WAIT_S)):
        joint.submit(act(0, 3, step=step), now_s, is_real_time=True)
        close(joint, joint.submit(act(1, IDLE, step=step, is_key=False), now_s + 1, is_real_time=True), 1)
    assert joint.presence.absent == {1}
    joint.submit(act(1, 4, step=3), 12.0, is_real_time=True)
    taken = close(joint, joint.submit(act(0, 3, step=3), 12.0, is_real_time=True), 0)
    assert taken.sources == ("person", "person", "agent")


def test_who_is_replaced_for_good_is_told_so():
    joint = play(partner_return="end")
    joint.presence.hand_over({1})
    assert joint.answer_ready(ready(1), 0.0) == TeamLost(0, "replaced")
    assert joint.submit(act(1, 4), 0.0, is_real_time=False) == TeamLost(0, "replaced")


@pytest.mark.parametrize(("pairing", "is_over"), [("drawn", True), ("round_robin", True), ("fixed", False)])
def test_a_team_that_one_leaves_before_the_first_step_goes_back_to_the_lobby_unless_it_is_fixed(pairing, is_over):
    joint = play(pairing=pairing)
    joint.leave(1)
    assert joint.is_over is is_over
    assert joint.pop_concerned() == {0, 1}


def test_a_team_that_has_played_plays_on_when_one_leaves():
    joint = play()
    joint.submit(act(0, 3), 0.0, is_real_time=False)
    close(joint, joint.submit(act(1, 4), 0.0, is_real_time=False), 1)
    joint.leave(1)
    assert not joint.is_over
    assert isinstance(joint.submit(act(0, 3, step=2), 1.0, is_real_time=False), StepDue)


def test_a_team_goes_on_from_its_logs_with_the_agent_where_it_stood_in():
    joint = play()
    joint.restore(TeamHistory({0: [JointAction((1, 2, 3), ("person", "agent", "agent"))]}))
    assert joint.presence.absent == {1}
    assert joint.submit(act(0, None), 0.0, is_real_time=False) == JointTaken(
        0, 0, 1, (1, 2, 3), ("person", "agent", "agent")
    )


def test_a_process_learns_the_steps_that_a_session_has_made_before_it_began():
    joint = play()
    joint.learn_steps(0, [(1, 2, 3), (4, 5, 6)], [("person",) * 3, ("person",) * 3])
    joint.learn_steps(0, [(1, 2, 3)], [("person",) * 3])
    assert [step.actions for step in joint.list_steps(0)] == [(1, 2, 3), (4, 5, 6)]


def test_a_step_clock_says_late_then_overdue_from_the_first_input_on():
    clock = StepClock(LATE_MS, WAIT_S)
    clock.open(50.0)
    assert [clock.find_delay(50.0 + s) for s in (0.0, 0.099, 0.1001, 9.9, 10.0)] == [
        "in_time",
        "in_time",
        "late",
        "late",
        "overdue",
    ]


def test_an_open_step_forgets_the_inputs_of_the_step_before():
    step = OpenStep(2)
    step.open(0, 1)
    step.submit(0, 3)
    step.open(0, 1)
    assert step.seats == {0}
    step.open(0, 2)
    assert not step.has_input
    assert step.find_due(frozenset({1})) == StepDue(0, 2, {}, frozenset({1}), (0,))


def message(digest: str, seat: int, *, text: str = "", cell: tuple[float, ...] = ()) -> MessageShown:
    return MessageShown(0, 0, 0, seat, text, cell, digest)


def test_words_wait_for_a_seat_and_a_mark_does_not():
    exchange = MessageExchange()
    words = message("a", 0, text="left")
    mark = message("b", 0, cell=(1.0, 2.0))
    assert exchange.send([mark, words], 0.0)
    assert not exchange.send([mark], 1.0)
    assert exchange.find_next(1, frozenset(), 1.9) == mark
    assert exchange.find_next(1, frozenset(), 2.0) == words
    assert exchange.find_next(1, frozenset({"a"}), 2.0) is None
    assert exchange.find_next(0, frozenset(), 0.0) is None
