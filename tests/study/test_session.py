import dataclasses

import pytest

from minihuman.errors import AllocationError
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import (
    EpisodeEnded,
    EpisodeStarted,
    FrameShown,
    KeyMapDrawn,
    KeyPressed,
    Noted,
    PartStarted,
    Paused,
    Resumed,
    SessionEnded,
    SessionStarted,
    Stepped,
)
from minihuman.experiment.machine.inputs import KeyDown, Stop
from minihuman.experiment.machine.screen_texts import find_stop_code
from minihuman.experiment.machine.screens import PlayScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.machine.transitions import Phase
from minihuman.worlds.adapters.world import World
from tests.study.sessions import MS, Desk, corridor_plan, key_of


def outcomes(desk: Desk) -> list[str]:
    return [event.outcome for event in desk.of(EpisodeEnded)]


def ended(desk: Desk) -> SessionEnded:
    assert desk.session.over
    assert find_violations(desk.events) == []
    return desk.of(SessionEnded)[-1]


def test_a_session_runs_from_consent_to_closing():
    desk = Desk(
        corridor_plan(
            blocks=2,
            episodes=1,
            consent="May we?",
            instruction="Walk.",
            feedback="{outcome}",
            rest="Rest.",
            closing="Bye.",
            check=True,
        )
    )
    seen = [desk.session.phase]
    desk.press("enter")
    desk.press("1", "2", "3", "4", "5", "6")
    for _ in range(2):
        seen.append(desk.session.phase)
        desk.press("enter", "enter")
        desk.act("forward", "forward", "forward")
        seen.append(desk.session.phase)
        desk.press("enter")
        seen.append(desk.session.phase)
        desk.press("enter")
    assert seen == [
        Phase.CONSENT,
        Phase.INSTRUCTIONS,
        Phase.FEEDBACK,
        Phase.REST,
        Phase.INSTRUCTIONS,
        Phase.FEEDBACK,
        Phase.CLOSING,
    ]
    assert outcomes(desk) == ["goal", "goal"]
    assert (ended(desk).reason, ended(desk).episodes_completed) == ("complete", 2)


def test_a_session_without_texts_goes_straight_to_ready():
    desk = Desk(corridor_plan())
    assert desk.session.phase is Phase.READY
    desk.press("enter")
    assert isinstance(desk.session.screen, PlayScreen)


def test_the_first_event_is_the_plan_and_the_machine():
    first = Desk(corridor_plan()).events[0]
    assert isinstance(first, SessionStarted)
    assert first.facts == {"machine": "desk"}
    assert first.plan == corridor_plan()


def test_consent_is_noted_with_the_hash_of_its_text():
    desk = Desk(corridor_plan(consent="May we?"))
    desk.press("enter")
    [note] = [event for event in desk.of(Noted) if event.kind == "consent"]
    assert desk.plan.consent_sha256 in note.text


def test_a_resumed_session_goes_on_at_its_first_episode_without_asking_for_consent_again():
    desk = Desk(corridor_plan(consent="May we?", first_episode=1, segment=2))
    assert desk.session.phase is Phase.READY
    desk.press("enter")
    desk.act("dive")
    assert [event.episode for event in desk.of(EpisodeEnded)] == [1]
    assert ended(desk).episodes_completed == 1


def test_a_finished_session_cannot_be_resumed():
    with pytest.raises(AllocationError, match="has completed all 2 episodes"):
        SessionMachine(corridor_plan(first_episode=2), World, {})


def test_the_keyboard_check_wants_every_key_of_the_pool_once():
    desk = Desk(corridor_plan(check=True))
    desk.press("1", "1", "x", "2", "3", "4", "5")
    assert dict(desk.session.screen.keys) == {"1": True, "2": True, "3": True, "4": True, "5": True, "6": False}
    assert desk.verdicts() == ["accepted", "accepted", "unmapped", "accepted", "accepted", "accepted", "accepted"]
    desk.press("6")
    assert desk.session.phase is Phase.READY
    assert any(event.kind == "keyboard_check" for event in desk.of(Noted))


@pytest.mark.parametrize(
    ("actions", "outcome"),
    [
        (["forward"] * 3, "goal"),
        (["back"] * 5, "timeout"),
        (["dive"], "failure"),
        (["back", "back", "back", "back", "dive"], "failure"),
    ],
)
def test_an_episode_ends_for_a_reason(actions, outcome):
    desk = Desk(corridor_plan(episodes=1))
    desk.press("enter")
    desk.act(*actions)
    assert outcomes(desk) == [outcome]
    last = desk.of(Stepped)[-1]
    assert last.truncated == (outcome == "timeout")


def test_the_plans_step_limit_holds_in_a_world_without_one():
    desk = Desk(corridor_plan(max_steps=2))
    desk.press("enter")
    desk.act("back", "back")
    assert outcomes(desk) == ["timeout"]


def test_every_press_and_release_is_an_event_with_what_came_of_it():
    plan = corridor_plan()
    desk = Desk(plan)
    [spare, *_] = plan.episodes[0].key_map.spare_keys
    forward = key_of(plan, "forward")
    desk.press(forward, "enter", forward, spare, "q")
    desk.down(forward)
    desk.down(forward, repeat=True)
    desk.up(forward)
    told = [(event.key, event.down, event.verdict, event.action) for event in desk.of(KeyPressed)]
    assert told == [
        (forward, True, "not_playing", None),
        (forward, False, "release", None),
        ("enter", True, "accepted", None),
        ("enter", False, "release", None),
        (forward, True, "accepted", 1),
        (forward, False, "release", None),
        (spare, True, "spare", None),
        (spare, False, "release", None),
        ("q", True, "unmapped", None),
        ("q", False, "release", None),
        (forward, True, "accepted", 1),
        (forward, True, "repeat", 1),
        (forward, False, "release", None),
    ]
    assert [event.step for event in desk.of(Stepped)] == [1, 2]


def test_auto_repeat_steps_only_where_asked_for():
    desk = Desk(corridor_plan(more="auto_repeat = true"))
    desk.press("enter")
    forward = key_of(desk.plan, "forward")
    desk.down(forward)
    desk.down(forward, repeat=True)
    assert [event.step for event in desk.of(Stepped)] == [1, 2]


def test_a_distractor_steps_the_action_it_was_dealt():
    desk = Desk(corridor_plan(spare="distractor", more='distractors = ["stay"]'))
    desk.press("enter")
    desk.press(key_of(desk.plan, "stay"))
    [step] = desk.of(Stepped)
    assert (step.action, step.reward) == (2, 0.0)


def test_a_reaction_time_runs_from_the_flip_of_the_picture_it_answers():
    desk = Desk(corridor_plan())
    desk.press("enter")
    desk.show()
    desk.now_ns += 250 * MS
    desk.act("forward")  # one millisecond later
    desk.act("back")  # two later, before the new picture was shown: it answers the old one
    assert [event.rt_ms for event in desk.of(Stepped)] == [251.0, 253.0]


def test_a_frame_says_which_step_it_shows():
    desk = Desk(corridor_plan())
    desk.show()  # a text is no frame
    desk.press("enter")
    desk.show()
    desk.act("forward")
    desk.show()
    assert [event.step for event in desk.of(FrameShown)] == [0, 1]


def test_events_are_given_before_the_new_screen_has_to_be_shown():
    desk = Desk(corridor_plan())
    desk.press("enter")
    before = desk.session.screen
    events = desk.down(key_of(desk.plan, "forward"))
    assert [type(event) for event in events] == [KeyPressed, Stepped]
    assert desk.session.screen is not before
    assert desk.session.screen.step == 1


def test_a_participant_may_pause():
    desk = Desk(corridor_plan())
    desk.press("enter", "f8")
    desk.act("forward")
    desk.press("f8")
    desk.act("forward")
    assert [event.reason for event in desk.of(Paused)] == ["participant"]
    assert desk.verdicts()[2:] == ["not_playing", "accepted", "accepted"]
    assert len(desk.of(Stepped)) == 1


def test_escape_asks_before_it_ends_anything():
    desk = Desk(corridor_plan())
    desk.press("enter")
    desk.act("forward")
    desk.press("escape")
    assert desk.session.phase is Phase.QUIT_QUESTION
    desk.press("escape")
    assert desk.session.phase is Phase.PLAYING
    desk.act("forward")
    desk.quit()
    assert (ended(desk).reason, ended(desk).episodes_completed) == ("quit", 0)
    assert outcomes(desk) == ["abandoned"]


@pytest.mark.parametrize("keys", [("f9", "f12"), ("f12", "f9")])
def test_the_experimenter_ends_a_session_with_two_keys_and_a_reason(keys):
    desk = Desk(corridor_plan())
    desk.press("enter", *keys)  # one after the other is no chord
    assert desk.session.phase is Phase.PLAYING
    desk.down(keys[0])
    desk.down(keys[1])
    assert desk.session.phase is Phase.ABORT_QUESTION
    desk.press("2")
    assert (ended(desk).reason, ended(desk).detail) == ("aborted", "the participant is unwell")


def test_the_experimenter_may_change_their_mind_even_over_the_quit_question():
    desk = Desk(corridor_plan())
    desk.press("enter", "escape")
    desk.down("f9")
    desk.down("f12")
    desk.up("f9")
    desk.up("f12")
    assert desk.session.phase is Phase.ABORT_QUESTION
    desk.press("escape")
    assert desk.session.phase is Phase.QUIT_QUESTION
    desk.press("escape")
    assert desk.session.phase is Phase.PLAYING
    assert [event.reason for event in desk.of(Paused)] == ["quit_question"]
    assert len(desk.of(Resumed)) == 1


def test_a_question_before_play_comes_back_to_the_same_episode():
    desk = Desk(corridor_plan())
    desk.press("escape", "escape", "enter")
    desk.act("forward")
    assert len(desk.of(EpisodeStarted)) == 1


def test_a_rest_has_a_shortest_length_and_counts_down():
    desk = Desk(corridor_plan(blocks=2, episodes=1, break_s=2.5))
    desk.press("enter")
    desk.act("dive")
    assert desk.session.phase is Phase.REST
    assert "3 s" in desk.session.screen.prompt
    desk.press("enter")
    assert desk.session.phase is Phase.REST
    assert desk.verdicts()[-1] == "not_playing"
    desk.give(KeyDown(desk.session.next_tick_ns, "q"))
    assert "2 s" in desk.session.screen.prompt
    desk.pass_ms(2500)
    assert desk.session.next_tick_ns is None
    desk.press("enter")
    assert desk.session.phase is Phase.READY


def test_a_key_map_is_said_when_it_comes_into_force_and_not_again():
    desk = Desk(corridor_plan(blocks=2, episodes=2))
    while not desk.session.over:
        desk.press("enter")
        desk.act("dive")
    assert [event.episode for event in desk.of(KeyMapDrawn)] == [0, 2]


@pytest.mark.parametrize("reason", ["window_closed", "signal", "disk_full", "internal_error"])
def test_a_stop_in_mid_episode_says_abandoned_and_why(reason):
    desk = Desk(corridor_plan())
    desk.press("enter")
    desk.act("forward")
    desk.give(Stop(desk.now_ns, reason, "said"))
    assert outcomes(desk) == ["abandoned"]
    assert (ended(desk).reason, ended(desk).detail) == (reason, "said")


def test_closing_the_window_over_the_last_words_leaves_a_complete_session():
    desk = Desk(corridor_plan(episodes=1, closing="Bye."))
    desk.press("enter")
    desk.act("dive")
    assert desk.session.phase is Phase.CLOSING
    desk.give(Stop(desk.now_ns, "window_closed"))
    assert ended(desk).reason == "complete"


def test_an_exception_inside_a_world_is_in_the_log_and_the_participant_reads_a_code():
    desk = Desk(corridor_plan())
    desk.press("enter")
    desk.act("forward", "crash")
    assert outcomes(desk) == ["abandoned"]
    assert ended(desk).reason == "world_error"
    assert ended(desk).detail == "RuntimeError: the corridor has collapsed"
    kept, code = desk.session.screen.body.split("\n\n")
    assert kept == "Everything up to here is kept. Please call the experimenter."
    assert code == find_stop_code("world_error", "RuntimeError: the corridor has collapsed")
    assert isinstance(desk.session.failure, RuntimeError)


def test_a_world_that_cannot_be_made_ends_the_session_before_the_episode():
    def make(world_id, options):
        raise OSError("no such corridor")

    session = SessionMachine(corridor_plan(), make, {})
    events = session.receive(KeyDown(0, "enter"))
    assert [type(event) for event in events] == [SessionStarted, PartStarted, Noted, SessionEnded]
    assert events[-1].reason == "world_error"


def test_nothing_follows_the_end():
    desk = Desk(corridor_plan())
    desk.quit()
    assert desk.down("enter") == []


def test_an_input_stamped_before_the_last_one_does_not_turn_time_back():
    desk = Desk(corridor_plan())
    desk.pass_ms(10)
    [event] = desk.session.receive(KeyDown(3, "q"))
    assert event.t_ns == 10 * MS


def test_the_legend_is_on_the_screen_only_where_keys_are_shown():
    hidden, shown = Desk(corridor_plan()), Desk(corridor_plan(more='key_map = "shown"'))
    hidden.press("enter")
    shown.press("enter")
    assert hidden.session.screen.legend == ()
    assert dict(shown.session.screen.legend) == shown.plan.episodes[0].key_map.keys


def test_nobody_looking_means_no_pictures():
    session = SessionMachine(corridor_plan(), World, {}, picture_px=None)
    session.receive(KeyDown(0, "enter"))
    assert session.screen.picture.shape == (0, 0, 3)


def test_events_are_values():
    desk = Desk(corridor_plan())
    with pytest.raises(dataclasses.FrozenInstanceError):
        desk.events[0].t_ns = 1
