"""The sequence of a block's episodes, and the keys of its texts: each by itself, without a session."""

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from minihuman.activities.pages.page_reader import PageReader
from minihuman.activities.play.clocks import NS_PER_S, PhaseTimer
from minihuman.activities.play.episode_sequence import EpisodeSequence
from minihuman.activities.play.plan import PlayPlan, TrialRules
from minihuman.activities.play.text_keys import TextKeyEffect, TextKeys
from minihuman.experiment.machine.activity import PartEnding, SessionContext
from minihuman.experiment.machine.events import EpisodesSkipped, Scored
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.session_plan import ResumeState, SessionPlan
from minihuman.worlds.adapters.world import World
from tests.study.sessions import corridor_plan


def sequence_of(plan: SessionPlan, **fields: Any) -> tuple[EpisodeSequence, SessionContext]:
    number = next(number for number, part in enumerate(plan.parts) if isinstance(part.plan, PlayPlan))
    part = plan.parts[number]
    part = msgspec.structs.replace(part, plan=msgspec.structs.replace(part.plan, **fields))
    context = SessionContext(plan, World, None)
    return EpisodeSequence(number, part, context), context


def play_next(sequence: EpisodeSequence, outcome: str = "goal") -> None:
    """Play the next episode: three steps to the goal, or one until its time is over."""
    plan = sequence.next_plan
    play = RunningEpisode(plan, World(plan.world, plan.options), picture_px=None)
    play.start(0)
    forward = play.world.action_names.index("forward")
    if outcome == "goal":
        for step in range(3):
            play.step(step, forward, key="1", key_t_ns=step)
    else:
        play.step(0, forward, key="1", key_t_ns=0)
        play.end(1, "max_s")
    assert play.outcome == outcome
    sequence.add_episode(play)


def test_a_block_goes_on_to_its_last_episode_and_no_further():
    sequence, context = sequence_of(corridor_plan(episodes=2))
    assert sequence.next_plan.episode == 0
    play_next(sequence)
    assert sequence.has_next
    assert sequence.next_plan.episode == 1
    play_next(sequence, "timeout")
    assert not sequence.has_next
    assert sequence.end() == PartEnding()
    assert (context.next_episode, context.completed) == (2, 2)
    assert context.pop_events() == []


def test_what_is_skipped_is_said_with_its_reason():
    sequence, context = sequence_of(corridor_plan(episodes=3))
    play_next(sequence)
    sequence.decide(time_is_up=True)
    assert not sequence.has_next
    assert sequence.end() == PartEnding()
    assert context.pop_events() == [EpisodesSkipped(0, 1, 2, "time")]
    assert context.next_episode == 3


def test_points_are_added_up_and_only_a_block_with_points_says_so():
    sequence, context = sequence_of(corridor_plan(episodes=2, more="points = { goal = 5, per_step = -1 }"))
    context.points = 10.0
    play_next(sequence)
    assert sequence.last_points == 2.0
    assert context.pop_events() == [Scored(0, 0, 2.0, 12.0)]


def test_outcomes_of_an_earlier_segment_count_for_the_criterion():
    more = 'stop_criterion = { successes = 2, of = 2, otherwise = "end" }'
    plan = corridor_plan(episodes=3, more=more)
    number = next(number for number, part in enumerate(plan.parts) if isinstance(part.plan, PlayPlan))
    standing = ResumeState(number, 0.0, ("goal",), {})
    resumed = msgspec.structs.replace(plan, first_episode=1, segment=2, standing=standing)
    sequence, _ = sequence_of(resumed)
    sequence.resume()
    play_next(sequence)
    sequence.decide(time_is_up=False)
    assert not sequence.has_next


def test_who_misses_the_criterion_is_screened_out():
    sequence, _ = sequence_of(
        corridor_plan(episodes=1, more='stop_criterion = { successes = 1, of = 1, otherwise = "end" }')
    )
    play_next(sequence, "timeout")
    sequence.decide(time_is_up=False)
    assert sequence.end().reason == "screened_out"


def test_each_interval_that_was_drawn_comes_before_its_episode_and_none_after_the_last():
    sequence, _ = sequence_of(corridor_plan(episodes=2), interval_ms=7.0, trial=TrialRules(intervals_ms=(100.0, 200.0)))
    intervals_ms = [sequence.interval_ms]
    play_next(sequence)
    intervals_ms.append(sequence.interval_ms)
    play_next(sequence)
    assert [*intervals_ms, sequence.interval_ms] == [100.0, 200.0, 7.0]


def judge(key: str, phase: Phase, *, pages: int = 1, page: int = 0, flip_ns: int | None = None, rest_s: float = 0.0):
    plan = PlayPlan(0, 1, 0, 1, rest_s=rest_s)
    sequence, _ = sequence_of(corridor_plan(episodes=1))
    timer = PhaseTimer(plan, sequence, lambda: 0.0)
    timer.begin(phase, 0)
    reader = PageReader(pages)
    reader.page = page
    play: Any = SimpleNamespace(action_of={"1": 0}.get)
    return TextKeys(reader, timer).judge(KeyDown(5, key), phase, now_ns=NS_PER_S, flip_ns=flip_ns, play=play)


@pytest.mark.parametrize(
    ("key", "page", "effect"),
    [
        ("right", 0, TextKeyEffect("accepted", turns=1)),
        ("left", 0, TextKeyEffect("unmapped", turns=-1)),
        ("left", 1, TextKeyEffect("accepted", turns=-1)),
        ("right", 1, TextKeyEffect("unmapped", turns=1)),
        ("enter", 1, TextKeyEffect("accepted", turns=1)),
        ("q", 0, TextKeyEffect("unmapped")),
    ],
)
def test_keys_turn_the_pages_of_the_instructions(key, page, effect):
    assert judge(key, Phase.INSTRUCTIONS, pages=2, page=page) == effect


def test_enter_before_the_ready_screen_is_on_the_display_was_meant_for_the_screen_before():
    assert judge("enter", Phase.READY, flip_ns=6) == TextKeyEffect("not_playing")
    assert judge("enter", Phase.READY, flip_ns=5) == TextKeyEffect("accepted", goes_on=True)


def test_enter_ends_a_rest_only_when_its_time_is_over():
    assert judge("enter", Phase.REST, rest_s=2.0) == TextKeyEffect("not_playing")
    assert judge("enter", Phase.REST, rest_s=1.0) == TextKeyEffect("accepted", goes_on=True)


def test_a_key_of_the_world_is_not_playing_and_any_other_is_unmapped():
    assert judge("1", Phase.FEEDBACK).verdict == "not_playing"
    assert judge("q", Phase.FEEDBACK).verdict == "unmapped"
