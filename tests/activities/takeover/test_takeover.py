"""Takeover: who steers, from which key on, and what the log says of it."""

from types import MappingProxyType

import pytest

from minihuman.activities.agent_blocks.activity import AGENT_RULES
from minihuman.activities.agent_blocks.events import Advised, ControlChanged, LearnerAsked, PolicyGiven
from minihuman.activities.agent_blocks.requests import Advice, AdviceRequest, NewPolicy, PolicyRequest
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import EpisodeStarted, KeyPressed, Stepped
from minihuman.experiment.machine.inputs import FocusChanged
from minihuman.experiment.machine.screens import PlayScreen
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.replay import compare_replay
from minihuman.worlds.adapters.world import World
from tests.study.sessions import MS, Desk, corridor_plan, key_of

AGENT = """
kind = "takeover"
agent = { policy = "somebody", step_ms = 500 }
"""
LEARNER = """
kind = "takeover"
agent = { learner = "any", step_ms = 500, update_every = 2, wait_s = 3 }
"""
FORWARD = (0.0, 1.0, 0.0, 0.0, 0.0)  # of the corridor's back, forward, ...


class Beside(Desk):
    """A desk with an agent beside it, which always wants to go forward."""

    facts = MappingProxyType({"agent_rules": AGENT_RULES})
    policy = "somebody"
    failure = ""  # why there is none
    advice = FORWARD

    def answer(self):
        """Show the screen and give the session whatever it wants."""
        self.show()
        while (want := self.session.request) is not None:
            match want:
                case PolicyRequest():
                    self.give(NewPolicy(self.now_ns, self.policy, self.failure))
                case AdviceRequest(step=step):
                    chances = tuple(self.advice[: len(self.session.play.world.action_names)])
                    self.give(Advice(self.now_ns, step, chances))

    def wait_ms(self, ms):
        self.pass_ms(ms)
        self.answer()


class BesideBefore(Beside):
    """By the first rules."""

    facts = MappingProxyType({"machine": "desk"})


def playing(more=AGENT, *, desk_type=Beside, **options) -> Beside:
    desk = desk_type(corridor_plan(more=more, **options))
    desk.answer()
    desk.press("enter")
    desk.answer()
    assert desk.session.phase is Phase.PLAYING
    return desk


def who(desk):
    return [(event.who, event.reason, event.step) for event in desk.of(ControlChanged)]


def test_the_agent_steps_at_its_pace_and_its_picture_starts_each_period():
    desk = playing()
    shown_ns = desk.now_ns
    desk.wait_ms(499)
    assert desk.of(Stepped) == []
    desk.wait_ms(1)
    (stepped,) = desk.of(Stepped)
    assert (stepped.key, stepped.t_ns, stepped.rt_ms) == ("", shown_ns + 500 * MS, None)
    assert desk.session.play.world.action_names[stepped.action] == "forward"
    assert desk.session.screen.controller == "agent"


def test_any_key_with_an_action_takes_over_at_once_and_its_action_is_done():
    desk = playing()
    desk.wait_ms(100)
    key = key_of(desk.plan, "back")
    desk.down(key)
    (stepped,) = desk.of(Stepped)
    assert (stepped.key, stepped.t_ns) == (key, desk.now_ns)
    assert who(desk) == [("agent", "start", 0), ("person", "key", 0)]
    assert desk.of(ControlChanged)[1].pressed_ns == desk.now_ns
    assert isinstance(desk.session.screen, PlayScreen)
    assert desk.session.screen.controller == "person"


def test_a_person_who_steers_is_not_hurried():
    desk = playing()
    desk.act("back")
    desk.answer()
    desk.wait_ms(60_000)
    assert len(desk.of(Stepped)) == 1


def test_the_policys_own_action_is_logged_whoever_steers():
    desk = playing()
    for _ in range(2):
        desk.act("back")
        desk.answer()
    assert [(event.step, event.action) for event in desk.of(Advised)] == [(0, 1), (1, 1), (2, 1)]
    assert [event.action for event in desk.of(Stepped)] == [0, 0]


def test_one_key_hands_back_and_the_agent_goes_on_a_period_later():
    desk = playing()
    desk.act("back")
    desk.answer()
    desk.press("space")
    desk.answer()
    assert who(desk)[-1] == ("agent", "hand_back", 1)
    desk.wait_ms(499)
    assert len(desk.of(Stepped)) == 1
    desk.wait_ms(1)
    assert desk.of(Stepped)[-1].key == ""


def test_handing_back_what_one_does_not_have_changes_nothing():
    desk = playing()
    desk.press("space")
    assert who(desk) == [("agent", "start", 0)]
    assert desk.verdicts()[-1] == "not_playing"


def test_without_a_policy_the_person_plays_from_the_start():
    desk = Beside(corridor_plan(more=LEARNER))
    desk.policy = ""
    desk.answer()
    desk.press("enter")
    desk.answer()
    assert who(desk) == [("person", "no_policy", 0)]
    desk.press("space")
    assert who(desk) == [("person", "no_policy", 0)]
    desk.wait_ms(5_000)
    assert desk.of(Stepped) == []


@pytest.mark.parametrize(("desk_type", "reason"), [(Beside, "agent_failed"), (BesideBefore, "no_policy")])
def test_an_agent_that_fails_while_it_steers_leaves_the_person_to_steer(desk_type, reason):
    desk = playing(desk_type=desk_type)
    desk.give(NewPolicy(desk.now_ns, "somebody", "the agent failed: KeyError"))
    assert who(desk) == [("agent", "start", 0), ("person", reason, 0)]
    desk.act("back")
    assert len(desk.of(Stepped)) == 1
    assert list(compare_replay(desk.events, World)) == []


def test_an_agent_that_breaks_leaves_the_person_to_steer():
    desk = playing()
    desk.advice = (0.0,) * 5
    desk.act("back")
    desk.answer()
    desk.press("space")
    assert desk.of(PolicyGiven)[-1].failure == "the policy gives no chance to any action that has a key"
    desk.wait_ms(5_000)
    assert len(desk.of(Stepped)) == 1


def test_a_learner_is_asked_between_episodes_and_the_next_one_waits_for_it_so_long_and_no_longer():
    desk = Beside(corridor_plan(more=LEARNER, episodes=4))
    desk.policy = ""
    desk.answer()
    for _ in range(2):
        desk.press("enter")
        desk.answer()
        desk.act("dive")
        desk.show()
    (asked,) = desk.of(LearnerAsked)
    assert asked.episode == 2
    assert desk.session.phase is Phase.LEARNING
    desk.pass_ms(2_900)
    assert desk.session.phase is Phase.LEARNING
    desk.pass_ms(200)
    assert desk.session.phase is not Phase.LEARNING
    desk.policy = "learnt"
    desk.answer()
    assert desk.of(PolicyGiven)[-1].policy == "learnt"


def test_the_new_policy_plays_from_the_next_episode_on():
    desk = Beside(corridor_plan(more=LEARNER, episodes=3))
    desk.policy = ""
    desk.answer()
    for _ in range(2):
        desk.press("enter")
        desk.answer()
        desk.act("dive")
        desk.show()
    desk.policy = "learnt"
    desk.answer()
    desk.press("enter")
    desk.answer()
    assert len(desk.of(EpisodeStarted)) == 3
    assert who(desk)[-1] == ("agent", "start", 0)


def test_another_window_in_front_stops_the_agent_but_not_a_person():
    desk = playing()
    desk.give(FocusChanged(desk.now_ns, False))
    assert desk.session.phase is Phase.PAUSED
    desk.pass_ms(5_000)
    desk.give(FocusChanged(desk.now_ns, True))
    desk.press("f8")
    desk.answer()
    desk.act("back")
    desk.answer()
    desk.give(FocusChanged(desk.now_ns, False))
    assert desk.session.phase is Phase.UNFOCUSED


def test_a_session_with_an_agent_is_well_formed_and_played_again_says_the_same():
    desk = playing(episodes=3, max_steps=4)
    for _ in range(3):
        desk.wait_ms(500)
        desk.act("back")
        desk.answer()
        desk.press("space")
        desk.answer()
        while desk.session.phase is Phase.PLAYING:
            desk.wait_ms(250)
        desk.press("enter")
        desk.answer()
    assert find_violations(desk.events) == []
    assert list(compare_replay(desk.events, World)) == []
    assert {event.verdict for event in desk.of(KeyPressed)} >= {"accepted"}


def test_an_advice_that_was_changed_is_found():
    desk = playing()
    desk.wait_ms(500)
    events = list(desk.events)
    place = next(number for number, event in enumerate(events) if isinstance(event, Advised))
    events[place] = Advised(events[place].t_ns, 0, 0, 0, FORWARD[: len(events[place].probabilities)])
    assert "action" in next(iter(compare_replay(events, World)))
