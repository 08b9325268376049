"""A session played again from what was recorded says the same, also of keys that came before a screen was seen."""

from dataclasses import replace

import pytest
from msgspec.structs import replace as replace_field

from minihuman.experiment.machine.events import EpisodeStarted, KeyPressed, Noted, SessionEnded
from minihuman.experiment.machine.inputs import (
    AxisChanged,
    ExperimenterCommand,
    FocusChanged,
    KeyDown,
    KeyUp,
    ScreenShown,
    Tick,
)
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.replay import compare_replay
from minihuman.worlds.adapters.world import World
from tests.study.sessions import MS, Desk, corridor_plan


def late(desk: Desk, ms: float) -> None:
    """The present screen reaches the display so much later."""
    desk.now_ns += round(ms * MS)
    desk.give(ScreenShown(desk.now_ns, desk.now_ns, desk.now_ns))


def early(desk: Desk, key: str, ms: float) -> None:
    """A key was pressed so much before now."""
    desk.give(KeyDown(desk.now_ns - round(ms * MS), key, key))


def test_enter_before_ready_was_seen_is_proven_to_have_done_nothing():
    desk = Desk(corridor_plan())
    desk.give(Tick(desk.now_ns))
    late(desk, 60)
    for ms in (50, 30, 10):
        early(desk, "enter", ms)
    assert desk.session.phase is Phase.READY
    assert desk.verdicts() == ["not_playing"] * 3
    desk.press("enter")
    desk.act("forward", "forward")
    assert desk.session.phase is Phase.PLAYING
    assert list(compare_replay(desk.events, World)) == []


@pytest.mark.parametrize("ms", [250, 301, 320, 337])
def test_a_key_while_a_slow_screen_still_stands_is_proven(ms):
    desk = Desk(corridor_plan(more="inter_trial_interval_ms = 300\nfixation_ms = 300"))
    desk.press("enter")
    assert desk.session.phase is Phase.INTERVAL
    late(desk, 40)  # it stands for 300 ms from here
    desk.now_ns += (ms - 40) * MS
    desk.press("1")
    assert desk.of(KeyPressed)[-1].phase == Phase.INTERVAL
    desk.pass_ms(100)
    assert desk.session.phase is Phase.FIXATION
    late(desk, 20)
    desk.pass_ms(400)
    assert desk.of(EpisodeStarted)
    desk.act("forward")
    assert list(compare_replay(desk.events, World)) == []


@pytest.mark.parametrize("verdict", ["accepted", "not_playing"])
def test_what_an_enter_did_at_ready_cannot_be_changed(verdict):
    desk = Desk(corridor_plan())
    late(desk, 60)
    early(desk, "enter", 10)
    desk.press("enter")
    desk.act("forward")
    changed = [
        replace(event, verdict=verdict)
        if isinstance(event, KeyPressed) and event.key == "enter" and event.down
        else event
        for event in desk.events
    ]
    assert list(compare_replay(changed, World)) != []


@pytest.mark.parametrize("what", ["key", "release", "focus", "experimenter"])
@pytest.mark.parametrize("late_ms", [0, 20])
def test_an_input_that_ends_the_last_picture_and_finds_the_next_world_being_made_is_proven(what, late_ms):
    plan = corridor_plan(blocks=2, episodes=1, max_steps=2, hold_ms=300)
    other = [replace_field(plan.episodes[1], options={"start": 1})]
    desk = Desk(replace_field(plan, episodes=(plan.episodes[0], *other)))
    desk.press("enter")
    desk.act("forward", "forward")
    assert desk.session.phase is Phase.HOLD
    late(desk, 40)
    desk.now_ns += 400 * MS
    used_ns = desk.now_ns - late_ms * MS
    happened = {
        "key": KeyDown(used_ns, "1", "1"),
        "release": KeyUp(used_ns, "1", "1"),
        "focus": FocusChanged(desk.now_ns, False),
        "experimenter": ExperimenterCommand(desk.now_ns, "note", "somebody came in"),
    }[what]
    desk.recorder.write(desk.session.receive(happened, at_ns=desk.now_ns))
    before = [event.text for event in desk.of(Noted) if event.kind == "phase"]
    assert Phase.PREPARING in before
    assert (before[-1] == Phase.READY) == (what == "key")  # time passes once for the session, once for what a press did
    desk.give(FocusChanged(desk.now_ns + MS, True))
    desk.pass_ms(20)
    desk.press("enter")
    desk.act("forward")
    assert len(desk.of(EpisodeStarted)) == 2
    assert list(compare_replay(desk.events, World)) == []


@pytest.mark.parametrize(
    "happened",
    [KeyDown, KeyUp, lambda t_ns, key, _: AxisChanged(t_ns, key, 0.5), lambda t_ns, *_: FocusChanged(t_ns, False)],
    ids=["key", "release", "axis", "focus"],
)
def test_nothing_follows_the_end_of_a_session_that_an_input_finds_over(happened):
    desk = Desk(corridor_plan(episodes=1, max_steps=2, hold_ms=300))
    desk.press("enter")
    desk.act("forward", "forward")
    late(desk, 40)
    desk.now_ns += 400 * MS
    desk.give(happened(desk.now_ns, "pad_left_x", "pad_left_x"))
    assert desk.session.over
    assert isinstance(desk.events[-1], SessionEnded)
    assert list(compare_replay(desk.events, World)) == []
