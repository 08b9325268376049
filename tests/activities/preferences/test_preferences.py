"""Preferences: two stretches made again side by side, and what is said of them."""

import pytest

from minihuman.activities.clip_requests import ClipRequest
from minihuman.activities.episode_clips import ClipOffered, EpisodeClip
from minihuman.activities.preferences.events import PairSeen, Preferred, StretchShown
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import PartEnded, SessionEnded
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.replay import compare_replay
from minihuman.worlds.adapters.world import World
from tests.study.sessions import Desk
from tests.study.studies import CORRIDOR as BLOCK, plan_of

PARTS = """
[[activities]]
name = "compare"
kind = "preferences"
settings = {{ source = "corridor", pairs = {pairs}, steps = 2, step_ms = 100 }}
[[pages]]
name = "after"
text = "Well."
"""
CORRIDOR = "tests.worlds.corridor:tests/Corridor-v0"
ONE = EpisodeClip(0, 1, 0, CORRIDOR, "{}", 7, (1, 1))
OTHER = EpisodeClip(1, 1, 0, CORRIDOR, "{}", 8, (1, 0))


class Comparing(Desk):
    """A desk at which stretches are offered whenever some are wanted."""

    offered = (ONE, OTHER)

    def answer(self):
        while isinstance(want := self.session.request, ClipRequest):
            self.give(ClipOffered(self.now_ns, self.offered[want.place]))
        self.show()

    def look(self, ms):
        for _ in range(ms // 100):
            self.pass_ms(100)
            self.show()


@pytest.fixture
def desk():
    desk = Comparing(plan_of(PARTS.format(pairs=4) + BLOCK, ["compare", "after"]))
    desk.answer()
    return desk


def test_an_answer_counts_when_both_have_been_seen_to_their_ends(desk):
    desk.press("f")
    assert desk.of(Preferred) == []
    assert desk.verdicts() == ["not_playing"]
    desk.look(300)
    desk.press("f")
    (said,) = desk.of(Preferred)
    assert (said.answer, said.pair, said.replays, said.pressed_ns) == ("left", 0, 0, said.t_ns)


def test_again_starts_both_from_their_first_pictures(desk):
    desk.look(200)
    desk.press("r")
    assert desk.session.screen.along == 0.0
    desk.look(400)
    desk.press("b")
    assert [(said.answer, said.replays) for said in desk.of(Preferred)] == [("equal", 1)]


def test_each_side_has_half_of_what_came_first_and_the_log_says_which(desk):
    for _ in range(4):
        desk.look(300)
        desk.press("n")
        desk.answer()
    firsts = [shown.side for shown in desk.of(StretchShown) if shown.stretch == ONE]
    assert sorted(firsts) == ["left", "left", "right", "right"]
    assert {said.answer for said in desk.of(Preferred)} == {"cannot_tell"}


def test_the_log_holds_when_every_picture_was_seen(desk):
    desk.look(300)
    assert [seen.step for seen in desk.of(PairSeen)] == [0, 1, 2, 2]


def test_where_there_is_nothing_to_compare_the_session_goes_on():
    desk = Comparing(plan_of(PARTS.format(pairs=4) + BLOCK, ["compare", "after"]))
    desk.offered = (None, None)
    desk.answer()
    assert [event.end for event in desk.of(PartEnded)] == ["failed"]
    assert desk.session.phase is Phase.PAGE


def test_a_comparison_is_well_formed_and_played_again_says_the_same(desk):
    for key in "fjbn":
        desk.look(400)
        desk.press(key)
        desk.answer()
    desk.press("enter")
    assert desk.of(SessionEnded)
    assert find_violations(desk.events) == []
    assert list(compare_replay(desk.events, World)) == []
