"""A block's design: criteria, time limits, points, fixation, a last picture that is held, feedback by outcome."""

import pytest

from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import (
    EpisodeEnded,
    EpisodesSkipped,
    FrameShown,
    Scored,
    SessionEnded,
    Stepped,
)
from minihuman.experiment.machine.inputs import KeyDown, ScreenShown
from minihuman.experiment.machine.screens import BlankScreen
from minihuman.experiment.machine.transitions import Phase
from tests.study.sessions import MS, Desk, corridor_plan

GOAL = ("forward", "forward", "forward")


def desk_with(more: str, **fields) -> Desk:
    desk = Desk(corridor_plan(more=more, **fields))
    desk.press("enter")
    return desk


def play(desk: Desk, *outcomes: str) -> None:
    for outcome in outcomes:
        desk.act(*(GOAL if outcome == "goal" else ("dive",)))
        desk.press("enter")


def test_practice_is_over_as_soon_as_its_criterion_is_met():
    desk = desk_with("stop_criterion = { successes = 2, of = 3 }", episodes=6)
    play(desk, "goal", "fail", "goal")
    assert len(desk.of(EpisodeEnded)) == 3
    [skipped] = desk.of(EpisodesSkipped)
    assert (skipped.first, skipped.count, skipped.reason) == (3, 3, "criterion")
    assert desk.of(SessionEnded)[0].reason == "complete"
    assert find_violations(desk.events) == []


def test_only_the_last_so_many_count():
    desk = desk_with("stop_criterion = { successes = 2, of = 2 }", episodes=6)
    play(desk, "goal", "fail", "goal", "fail", "goal")
    assert desk.of(EpisodesSkipped) == []
    play(desk, "goal")
    assert desk.of(EpisodesSkipped) == []  # the last was the sixth: none was left


def test_who_never_meets_the_criterion_goes_on_or_is_screened_out():
    desk = desk_with('stop_criterion = { successes = 2, of = 2, otherwise = "end" }', episodes=2)
    play(desk, "fail", "fail")
    assert desk.of(SessionEnded)[0].reason == "screened_out"


def test_an_episode_has_a_time_limit_without_the_pauses():
    desk = desk_with("max_episode_s = 2.0", episodes=1)
    desk.act("forward")
    desk.pass_ms(1000)
    desk.press("f8")
    desk.pass_ms(60_000)
    desk.press("f8")
    assert desk.of(EpisodeEnded) == []
    assert desk.session.next_tick_ns is not None
    desk.give(KeyDown(desk.session.next_tick_ns, "q"))
    [ended] = desk.of(EpisodeEnded)
    assert (ended.outcome, ended.cause, ended.steps) == ("timeout", "max_s", 1)
    assert find_violations(desk.events) == []


def test_a_block_has_a_time_limit_and_the_rest_is_skipped():
    desk = desk_with("max_block_s = 3.0", episodes=4)
    desk.pass_ms(2000)
    desk.act("dive")
    desk.press("enter")
    desk.pass_ms(1500)
    assert [event.cause for event in desk.of(EpisodeEnded)] == ["", "block_max_s"]
    [skipped] = desk.of(EpisodesSkipped)
    assert (skipped.first, skipped.count, skipped.reason) == (2, 2, "time")


def test_points_add_up_and_are_on_the_screen():
    desk = desk_with(
        "points = { goal = 10, failure = -2, per_step = -0.5 }\nshow_points = true",
        episodes=3,
        feedback="{points} {total}",
    )
    assert desk.session.screen.progress.endswith("Points: 0")
    desk.act(*GOAL)
    assert desk.session.screen.body == "8.5 8.5"
    desk.press("enter")
    desk.act("dive")
    assert desk.session.screen.body == "-2.5 6"
    assert [(event.points, event.total) for event in desk.of(Scored)] == [(8.5, 8.5), (-2.5, 6.0)]


def test_feedback_has_a_text_for_each_outcome():
    desk = Desk(corridor_plan(feedback={"goal": "Well done", "timeout": "Too slow"}, episodes=3))
    desk.press("enter")
    desk.act(*GOAL)
    assert desk.session.screen.body == "Well done"
    desk.press("enter")
    desk.act("dive")  # nothing is said about a failure
    assert desk.session.phase is Phase.READY
    desk.press("enter")
    desk.act(*["back"] * 5)
    assert desk.session.screen.body == "Too slow"


def test_the_last_picture_is_shown_and_held_with_a_mark_and_a_sum():
    desk = desk_with("show_outcome = true\npoints = { goal = 10 }", hold_ms=600, episodes=1)
    desk.show()
    for _ in range(3):
        desk.act("forward")
        desk.show()
    held = desk.session.screen
    assert desk.session.phase is Phase.HOLD
    assert (held.step, held.mark, held.score_text) == (3, "good", "+10 points")
    assert len(desk.of(FrameShown)) == len(desk.of(Stepped)) + 1
    desk.press("enter", "3")  # keys are for nothing now
    assert desk.session.phase is Phase.HOLD
    desk.pass_ms(600)
    assert desk.session.over
    assert find_violations(desk.events) == []


def test_the_hold_begins_when_the_picture_is_on_the_display():
    desk = desk_with("", hold_ms=500, episodes=1)
    desk.act("dive")
    flip_ns = desk.now_ns + 90 * MS
    desk.give(ScreenShown(flip_ns, desk.now_ns, flip_ns))
    assert desk.session.next_tick_ns == flip_ns + 500 * MS


def test_a_question_over_the_held_picture_holds_it_anew():
    desk = desk_with("", hold_ms=500, episodes=1)
    desk.act("dive")
    desk.pass_ms(300)
    desk.press("escape")
    desk.pass_ms(10_000)
    desk.press("enter")
    assert desk.session.phase is Phase.HOLD
    desk.pass_ms(500)
    assert desk.session.over


def test_an_interval_and_a_cross_come_before_each_episode():
    desk = desk_with("inter_trial_interval_ms = 300\nfixation_ms = 500", episodes=2)
    assert desk.session.screen == BlankScreen()
    desk.pass_ms(300)
    assert desk.session.screen == BlankScreen(cross=True)
    desk.act("forward")
    assert desk.of(Stepped) == []
    desk.pass_ms(500)
    assert desk.session.phase is Phase.PLAYING
    desk.act("dive")
    desk.press("enter")
    assert desk.session.phase is Phase.INTERVAL


def test_a_second_enter_meant_for_the_screen_before_does_not_skip_ready():
    desk = Desk(corridor_plan(instruction="Walk."))
    early_ns = desk.now_ns + 5 * MS
    desk.press("enter")
    flip_ns = early_ns + 20 * MS
    desk.give(ScreenShown(flip_ns, desk.now_ns, flip_ns))  # the screen that says that something takes a moment
    desk.pass_ms(21)
    assert desk.session.phase is Phase.READY
    ready_ns = desk.now_ns + 10 * MS
    desk.give(ScreenShown(ready_ns, desk.now_ns, ready_ns))
    desk.give(KeyDown(early_ns, "enter"))
    assert desk.session.phase is Phase.READY
    assert desk.verdicts()[-1] == "not_playing"
    desk.now_ns = ready_ns
    desk.press("enter")
    assert desk.session.phase is Phase.PLAYING


def test_a_screen_is_there_before_a_world_is_made():
    desk = Desk(corridor_plan(instruction="Walk."))
    desk.press("enter")
    assert desk.session.phase is Phase.READY or "moment" in desk.session.screen.body
    assert desk.session.next_tick_ns is None or desk.session.next_tick_ns <= desk.now_ns


@pytest.mark.parametrize("ms", [100, 1900])
def test_letting_go_of_escape_in_time_ends_nothing(ms):
    desk = desk_with("")
    desk.press("escape")
    desk.hold("escape", ms)
    assert desk.session.phase is Phase.PLAYING
