import dataclasses

import msgspec
import pytest

from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import (
    EpisodeEnded,
    KeyMapDrawn,
    ObservationStored,
    Resumed,
    SessionEnded,
    Stepped,
)
from minihuman.worlds.hashing import hash64
from tests.study.sessions import Desk, corridor_plan


def played(*, record_observations):
    plan = corridor_plan(episodes=2)
    episodes = [msgspec.structs.replace(its, record_observations=record_observations) for its in plan.episodes]
    desk = Desk(msgspec.structs.replace(plan, episodes=tuple(episodes)))
    for _ in range(2):
        desk.press("enter")
        desk.show()
        desk.act("forward", "forward", "forward")
    assert desk.session.over
    return list(desk.events)


@pytest.fixture(scope="module")
def events():
    return played(record_observations=False)


@pytest.fixture(scope="module")
def with_observations():
    return played(record_observations=True)


def place(events, kind, number=0) -> int:
    return [index for index, event in enumerate(events) if isinstance(event, kind)][number]


def changed(events, kind, number=0, **values):
    index = place(events, kind, number)
    return [*events[:index], dataclasses.replace(events[index], **values), *events[index + 1 :]]


def without(events, kind, number=0):
    index = place(events, kind, number)
    return [*events[:index], *events[index + 1 :]]


def test_asked_for_a_sessions_observations_come_before_their_steps(with_observations):
    assert find_violations(with_observations) == []
    assert all(find_violations(with_observations[:length]) == [] for length in range(len(with_observations)))
    first = [event for event in with_observations if isinstance(event, ObservationStored) and event.episode == 0]
    assert [event.step for event in first] == [0, 1, 2, 3]
    assert hash64(first[2].observation) == with_observations[place(with_observations, Stepped, 1)].observation_hash


@pytest.mark.parametrize(
    ("breakage", "said"),
    [
        (lambda e: without(e, ObservationStored, 1), "a step's observation comes before it"),
        (lambda e: changed(e, ObservationStored, 1, step=2), "the observation of step 1 is next"),
        (lambda e: changed(e, ObservationStored, 1, episode=1), "where the plan asks for them"),
    ],
)
def test_a_stream_whose_observations_are_wrong_is_told(with_observations, breakage, said):
    assert any(said in complaint for complaint in find_violations(breakage(with_observations)))


def test_a_played_session_breaks_no_rule_nor_does_one_cut_short(events):
    assert find_violations(events) == []
    assert all(find_violations(events[:length]) == [] for length in range(len(events)))


@pytest.mark.parametrize(
    ("breakage", "said"),
    [
        (lambda e: e[1:], "SessionStarted is the first event"),
        (lambda e: [*e, e[-2]], "nothing follows SessionEnded"),
        (lambda e: changed(e, Stepped, t_ns=0), "time goes back"),
        (lambda e: without(e, Stepped), "step 1 is next, not 2"),
        (lambda e: changed(e, Stepped, 1, step=1), "step 2 is next, not 1"),
        (lambda e: changed(e, Stepped, return_=7.0), "rewards sum to"),
        (lambda e: changed(e, Stepped, action=9), "there is no action 9"),
        (lambda e: changed(e, Stepped, rt_ms=-1.0), "a reaction follows"),
        (lambda e: changed(e, Stepped, terminated=True), "nothing steps after the end"),
        (lambda e: changed(e, EpisodeEnded, outcome="timeout"), "makes it goal, not timeout"),
        (lambda e: changed(e, EpisodeEnded, state_hash=1), "in the state of its last step"),
        (lambda e: changed(e, EpisodeEnded, steps=9), "counts the episode"),
        (lambda e: without(e, EpisodeEnded), "one episode at a time"),
        (lambda e: without(e, KeyMapDrawn), "key map was drawn before"),
        (lambda e: changed(e, SessionEnded, episodes_completed=1), "completed episodes are counted"),
        (lambda e: [e[0], Resumed(0), *e[1:]], "only a pause can be resumed"),
    ],
)
def test_a_broken_rule_is_named(events, breakage, said):
    assert any(said in complaint for complaint in find_violations(breakage(events)))
