"""Correction after the fact: an episode is gone through, and from one of its steps shown how it should have gone."""

import numpy as np
import pytest

from minihuman.activities.clip_requests import EpisodeRequest
from minihuman.activities.correction.events import (
    CorrectionBegun,
    CorrectionEnded,
    CorrectionSeen,
    CorrectionStepped,
    NothingToCorrect,
)
from minihuman.activities.correction.screens import FilmScreen
from minihuman.activities.episode_clips import ClipOffered, EpisodeClip
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import PartEnded, SessionEnded
from minihuman.experiment.machine.inputs import FocusChanged
from minihuman.experiment.machine.screens import PlayScreen
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.replay import compare_replay
from minihuman.log.model.teaching_events import gather_corrections
from minihuman.worlds.adapters.world import World
from tests.study.sessions import Desk, key_of
from tests.study.studies import CORRIDOR, plan_of

PARTS = """
[[activities]]
name = "correct"
kind = "correction"
settings = { source = "corridor", episodes = 2, steps = 3 }
[[pages]]
name = "after"
text = "Well."
"""
WORLD = "tests.worlds.corridor:tests/Corridor-v0"
EPISODE = EpisodeClip(0, 1, 0, WORLD, "{}", 7, (1, 0, 1, 0))


class Correcting(Desk):
    """A desk at which episodes are offered whenever some are wanted."""

    offered = (EPISODE, EPISODE)

    def answer(self):
        while isinstance(want := self.session.request, EpisodeRequest):
            there = want.number < len(self.offered)
            self.give(ClipOffered(self.now_ns, self.offered[want.number] if there else None))
        self.show()

    def go(self, *keys):
        for key in keys:
            self.press(key)
            self.answer()


@pytest.fixture
def desk():
    desk = Correcting(plan_of(PARTS + CORRIDOR, ["correct", "after", "corridor"]))
    desk.answer()
    return desk


def proven(desk):
    return find_violations(desk.events) == [] and list(compare_replay(desk.events, World)) == []


def test_an_episode_is_gone_through_step_by_step(desk):
    screen = desk.session.screen
    assert isinstance(screen, FilmScreen)
    assert (len(screen.pictures), screen.step) == (5, 0)
    desk.go("period", "period", "comma", "period")
    assert desk.session.screen.step == 2
    desk.go(*["period"] * 9)
    assert desk.session.screen.step == 4
    assert [seen.step for seen in desk.of(CorrectionSeen)][:5] == [0, 1, 2, 1, 2]
    assert proven(desk)


def test_from_a_step_on_somebody_shows_what_should_have_been_done(desk):
    desk.go("period", "space")
    assert isinstance(desk.session.screen, PlayScreen)
    desk.go(key_of(desk.plan, "forward"), key_of(desk.plan, "back"), "space")
    (begun,) = desk.of(CorrectionBegun)
    assert (begun.episode, begun.attempt, begun.step) == (0, 1, 1)
    assert [(step.step, step.action) for step in desk.of(CorrectionStepped)] == [(2, 1), (3, 0)]
    assert [end.outcome for end in desk.of(CorrectionEnded)] == ["stopped"]
    assert desk.session.phase is Phase.LOOKING
    (corrected,) = gather_corrections(desk.events)
    assert (corrected.episode, corrected.step, corrected.before.tolist()) == (0, 1, [1])
    assert corrected.actions.tolist() == [1, 0]
    with_world = World(WORLD, {})
    with_world.reset(7)
    hashes = []
    for action in [1, 1, 0]:
        with_world.step(action)
        hashes.append(with_world.state_hash())
    assert np.array_equal(corrected.state_hashes, np.array(hashes, np.uint64))
    assert proven(desk)


def test_it_ends_after_as_many_steps_as_the_plan_allows(desk):
    desk.go("space", *[key_of(desk.plan, "back")] * 3)
    assert [end.outcome for end in desk.of(CorrectionEnded)] == ["timeout"]
    assert len(desk.of(CorrectionStepped)) == 3
    assert desk.session.phase is Phase.LOOKING
    assert proven(desk)


def test_enter_goes_to_the_next_episode_and_on(desk):
    desk.go("enter", "enter")
    assert [event.end for event in desk.of(PartEnded)] == ["done"]
    assert proven(desk)


def test_with_fewer_episodes_than_the_plan_asks_for_the_part_is_over_sooner(desk):
    desk.offered = (EPISODE,)
    desk.go("enter")
    assert len(desk.of(NothingToCorrect)) == 1
    assert [event.end for event in desk.of(PartEnded)] == ["done"]
    assert proven(desk)


def test_a_pause_and_the_end_of_the_session_leave_a_whole_log(desk):
    desk.go("space", key_of(desk.plan, "forward"))
    desk.give(FocusChanged(desk.now_ns, False))
    desk.give(FocusChanged(desk.now_ns, True))
    desk.answer()
    desk.quit()
    assert [end.outcome for end in desk.of(CorrectionEnded)] == ["stopped"]
    assert len(desk.of(SessionEnded)) == 1
    assert proven(desk)
