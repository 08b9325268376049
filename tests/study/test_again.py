"""A session played again from what was recorded says the same, also of keys that came before a screen was seen."""

from dataclasses import replace

import pytest

from minihuman.experiment.machine.events import EpisodeStarted, KeyPressed
from minihuman.experiment.machine.inputs import KeyDown, ScreenShown, Tick
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
