from minihuman.experiment.machine.events import Noted, Paused, Resumed, Stepped
from minihuman.experiment.machine.inputs import FocusChanged
from minihuman.experiment.machine.transitions import Phase
from tests.study.sessions import MS, Desk, corridor_plan, key_of

REAL_TIME = 'pace = "real_time"\nstep_period_ms = 100\n'


def test_real_time_steps_once_a_period_with_the_last_key_or_the_noop():
    desk = Desk(corridor_plan(max_steps=9, more=REAL_TIME + 'noop_action = "stay"'))
    desk.press("enter")
    assert desk.session.next_tick_ns is None  # not before the first picture
    desk.show()
    start_ns = desk.now_ns
    assert desk.session.next_tick_ns == start_ns + 100 * MS
    desk.act("back", "forward")
    desk.pass_ms(100)
    desk.pass_ms(100)
    told = [(event.action, event.key) for event in desk.of(Stepped)]
    assert told == [(1, key_of(desk.plan, "forward")), (2, "")]
    assert desk.verdicts() == ["accepted", "queued", "queued"]
    assert desk.session.next_tick_ns == start_ns + 300 * MS


def test_real_time_without_a_noop_waits_for_a_key():
    desk = Desk(corridor_plan(more=REAL_TIME))
    desk.press("enter")
    desk.show()
    desk.pass_ms(100)
    assert desk.of(Stepped) == []
    desk.act("forward")
    desk.pass_ms(100)
    assert len(desk.of(Stepped)) == 1


def test_periods_missed_by_a_stalled_machine_are_not_made_up_for():
    desk = Desk(corridor_plan(more=REAL_TIME + 'noop_action = "stay"'))
    desk.press("enter")
    desk.show()
    start_ns = desk.now_ns
    desk.pass_ms(730)
    assert len(desk.of(Stepped)) == 1
    assert desk.session.next_tick_ns == start_ns + 800 * MS


def test_a_key_after_its_period_ran_out_belongs_to_the_next():
    desk = Desk(corridor_plan(more=REAL_TIME + 'noop_action = "stay"'))
    desk.press("enter")
    desk.show()
    desk.now_ns += 150 * MS
    desk.act("forward")
    assert [event.action for event in desk.of(Stepped)] == [2]


def test_losing_the_focus_pauses_real_time_and_is_recorded():
    desk = Desk(corridor_plan(more=REAL_TIME + 'noop_action = "stay"'))
    desk.press("enter")
    desk.show()
    desk.give(FocusChanged(desk.now_ns, focused=False))
    assert desk.session.phase is Phase.PAUSED
    desk.pass_ms(1000)
    desk.give(FocusChanged(desk.now_ns, focused=True))
    desk.press("enter")
    assert [event.text for event in desk.of(Noted) if event.kind == "focus"] == ["lost", "found"]
    assert [event.reason for event in desk.of(Paused)] == ["focus_lost"]
    assert len(desk.of(Resumed)) == 1
    assert desk.of(Stepped) == []
    assert desk.session.phase is Phase.PLAYING


def test_losing_the_focus_at_ones_own_pace_shows_a_notice_until_it_is_back():
    desk = Desk(corridor_plan())
    desk.press("enter")
    before = desk.session.screen
    desk.give(FocusChanged(desk.now_ns, focused=False))
    assert desk.session.phase is Phase.UNFOCUSED
    assert "keys do not arrive" in desk.session.screen.title
    desk.give(FocusChanged(desk.now_ns, focused=True))
    assert desk.session.phase is Phase.PLAYING
    assert desk.session.screen is before
    assert [event.text for event in desk.of(Noted) if event.kind == "focus"] == ["lost", "found"]


def test_a_focus_that_comes_back_over_the_quit_question_leaves_no_notice_behind():
    desk = Desk(corridor_plan())
    desk.press("enter")
    desk.give(FocusChanged(desk.now_ns, focused=False))
    desk.press("escape")
    desk.give(FocusChanged(desk.now_ns, focused=True))
    desk.press("enter")
    assert desk.session.phase is Phase.PLAYING
