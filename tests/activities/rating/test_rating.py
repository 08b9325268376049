"""Rating: two keys say good and bad of an agent that plays; the log holds when, and what was seen when."""

from minihuman.activities.agent_blocks.requests import NewPolicy
from minihuman.activities.rating.events import Rated
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import EpisodeEnded, FrameShown, Stepped
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.replay import compare_replay
from minihuman.worlds.adapters.world import World
from tests.activities.takeover.test_takeover import Beside, BesideBefore, playing
from tests.study.sessions import MS, corridor_plan, key_of

AGENT = """
kind = "rating"
agent = { policy = "somebody", step_ms = 500 }
"""


def test_a_press_is_logged_with_its_own_time_and_seen_for_a_moment():
    desk = playing(AGENT)
    desk.wait_ms(100)
    desk.press("j")
    desk.answer()
    (rated,) = desk.of(Rated)
    assert (rated.value, rated.step, rated.pressed_ns) == (1.0, 0, rated.t_ns)
    assert desk.session.screen.flash == "good"
    desk.wait_ms(150)
    assert desk.session.screen.flash == ""


def test_a_flash_does_not_put_the_agents_next_step_off():
    desk = playing(AGENT)
    shown_ns = desk.now_ns
    for _ in range(3):
        desk.press("f")
        desk.wait_ms(98)
    desk.wait_ms(500 - (desk.now_ns - shown_ns) / MS)
    assert [step.t_ns - shown_ns for step in desk.of(Stepped)] == [500 * MS]


def test_a_held_key_counts_once_in_a_tenth_of_a_second():
    desk = playing(AGENT)
    start_ns = desk.now_ns
    for ms in range(0, 301, 30):
        desk.give(KeyDown(start_ns + ms * MS, "j", "j", repeat=ms > 0))
    assert [(event.t_ns - start_ns) // MS for event in desk.of(Rated)] == [0, 120, 240]


def test_the_keys_of_actions_do_nothing():
    desk = playing(AGENT)
    desk.press(key_of(desk.plan, "forward"))
    assert desk.of(Stepped) == []


def test_what_comes_when_the_last_picture_is_held_counts_too():
    desk = playing(AGENT, max_steps=1, hold_ms=400.0)
    desk.wait_ms(500)
    assert desk.session.phase is Phase.HOLD
    desk.wait_ms(200)
    desk.press("f")
    assert [(event.value, event.step) for event in desk.of(Rated)] == [(-1.0, 1)]


def test_nothing_is_joined_a_press_and_the_pictures_stand_beside_each_other():
    desk = playing(AGENT)
    for _ in range(3):
        desk.wait_ms(250)
        desk.press("j")
        desk.answer()
        desk.wait_ms(248)
    assert [event.step for event in desk.of(Rated)] == [0, 1, 2]
    assert {event.step for event in desk.of(FrameShown)} == {0, 1, 2}
    assert find_violations(desk.events) == []
    assert list(compare_replay(desk.events, World)) == []


def fail(desk):
    desk.give(NewPolicy(desk.now_ns, "somebody", "the agent failed: KeyError"))


def test_an_agent_that_fails_ends_its_episode_and_plays_the_next():
    desk = playing(AGENT, episodes=2)
    desk.wait_ms(500)
    fail(desk)
    desk.wait_ms(1_000)
    desk.press("enter")
    desk.answer()
    [ended] = desk.of(EpisodeEnded)
    assert (ended.outcome, ended.cause, ended.steps) == ("agent_failed", "agent_failed", 1)
    desk.wait_ms(500)
    assert [step.episode for step in desk.of(Stepped)] == [0, 1]
    assert find_violations(desk.events) == []
    assert list(compare_replay(desk.events, World)) == []


def test_an_agent_that_gives_no_probabilities_ends_its_episode():
    desk = playing(AGENT)
    desk.advice = (float("nan"),) * 5
    desk.wait_ms(500)
    desk.answer()
    assert [(ended.outcome, ended.steps) for ended in desk.of(EpisodeEnded)] == [("agent_failed", 1)]


class NoPolicy(Beside):
    policy, failure = "", "the agent failed: KeyError"


def test_an_agent_that_cannot_be_loaded_is_not_replaced_by_a_random_one():
    desk = NoPolicy(corridor_plan(more=AGENT))
    desk.answer()
    desk.press("enter")
    desk.answer()
    desk.wait_ms(2_000)
    assert [(ended.outcome, ended.steps) for ended in desk.of(EpisodeEnded)][:1] == [("agent_failed", 0)]
    assert desk.of(Stepped) == []
    assert find_violations(desk.events) == []
    assert list(compare_replay(desk.events, World)) == []


def test_by_the_first_rules_a_random_agent_went_on():
    desk = playing(AGENT, desk_type=BesideBefore)
    fail(desk)
    desk.answer()
    desk.wait_ms(500)
    assert len(desk.of(Stepped)) == 1
    assert desk.of(EpisodeEnded) == []
    assert list(compare_replay(desk.events, World)) == []
