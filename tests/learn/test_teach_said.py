"""Learners from what a person says: ratings and comparisons."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from minihuman.errors import LearnError
from minihuman.learn.teaching import learner as fitting
from minihuman.learn.teaching.dataset import Comparison, LessonFragment, LessonRating
from minihuman.learn.teaching.learner import LearningRequest, make_fresh_policy, make_learner
from minihuman.learn.teaching.preference_learner import (
    PreferenceSettings,
    RewardFitting,
    RewardModelEnv,
    compute_disagreement,
    fit_reward,
)
from minihuman.learn.teaching.provenance import make_policy, reproduce_policy
from minihuman.learn.teaching.rating_learners import collect_presses, find_delay
from minihuman.simulation.supervisor import Critic, CriticParameters
from teaching_study.feedback import (
    ComparedTrial,
    Progress,
    draw_pairs,
    play_wandering,
    rated_episode,
    run_compared,
    select_disputed_pairs,
)
from tests.learn.taught import sitting

EMPTY = "minihuman/MiniGrid-Empty-8x8-v0"


def rated(mu_ms, *, episodes=8, seed=1):
    taking, dataset = sitting(EMPTY, actions=3, most_steps=60, seed=seed)
    fresh = make_fresh_policy(dataset, np.random.default_rng(seed))
    critic = Critic(CriticParameters(mu_ms=mu_ms), np.random.default_rng(seed))
    for layout in range(episodes):
        shown, ratings = rated_episode(taking, critic, fresh, layout)
        dataset = dataset.with_more([shown], ratings)
    return dataset


@pytest.fixture(scope="module")
def once():
    return rated(500)


@pytest.mark.parametrize("mu_ms", [300, 700, 1100])
def test_the_delay_of_a_critic_is_found_from_its_presses(mu_ms):
    dataset = rated(mu_ms, episodes=12)
    assert find_delay(*collect_presses(dataset)) == pytest.approx(mu_ms + 100, abs=50)


def test_of_a_few_presses_no_delay_is_told(once):
    few = sitting(EMPTY, actions=3)[1].with_more(once.lessons, once.ratings[:5])
    assert find_delay(*collect_presses(few)) is None
    assert (
        make_learner("tamer:updates=2").learn(LearningRequest(few, np.random.default_rng(1))).notes["delay_ms"] is None
    )


@pytest.mark.parametrize("name", ["tamer:updates=15", "deep-coach:updates=15"])
def test_the_same_ratings_and_seed_give_the_same_policy(once, name):
    one, same = (make_learner(name).learn(LearningRequest(once, np.random.default_rng(1))).policy for _ in range(2))
    assert all(torch.equal(values, same.state_dict()[key]) for key, values in one.state_dict().items())


@pytest.mark.parametrize("name", ["tamer:updates=120", "deep-coach:updates=60"])
def test_what_was_rated_well_becomes_likelier(once, name):
    values = {True: 1.0, False: -1.0}
    lesson = once.lessons[0]
    forward = [
        LessonRating(int(lesson.shown_ns[step + 1] + 600e6), values[bool(lesson.actions[step] == 2)], lesson.name)
        for step in range(len(lesson.actions) - 1)
    ]
    taught = sitting(EMPTY, actions=3)[1].with_more([lesson], forward)
    policy = make_learner(name).learn(LearningRequest(taught, np.random.default_rng(1))).policy
    chances = policy.log_probabilities({"image": torch.as_tensor(lesson.observations["image"])}).exp()
    assert chances[:, 2].mean() > 0.6


def test_a_press_is_about_what_its_own_session_showed(once):
    others = [replace(lesson, name=f"other-{lesson.name}", participant="other") for lesson in once.lessons]
    alone, _ = collect_presses(once)
    together, _ = collect_presses(replace(once, lessons=(*once.lessons, *others)))  # every session's clock begins at 0
    np.testing.assert_array_equal(together.steps, alone.steps)
    np.testing.assert_array_equal(together.after_ms, alone.after_ms)


def test_ratings_of_nothing_are_refused(once):
    silent = sitting(EMPTY, actions=3)[1].with_more(once.lessons)
    for name in ("tamer", "deep-coach", "preferences"):
        with pytest.raises(LearnError, match="none of the 0"):
            make_learner(name).learn(LearningRequest(silent, np.random.default_rng(1)))


SMALL = ComparedTrial(
    "Empty-8x8",
    EMPTY,
    3,
    rounds=(40, 20),
    shown=150,
    held_out=40,
    settings=PreferenceSettings(steps=64, n_steps=64, n_epochs=1),
    fitting=RewardFitting(members=2, updates=100),
)


def compared(answer="left"):
    """A little that was played, and one comparison of it."""
    dataset, _ = play_wandering(SMALL, np.random.default_rng(1), steps=100)
    name = dataset.lessons[0].name
    return dataset.with_more(comparisons=[Comparison(LessonFragment(name, 0, 5), LessonFragment(name, 4, 9), answer)])


@pytest.mark.parametrize("pairing", ["random", "disputed"])
def test_answers_order_what_was_never_compared(pairing):
    first, last = run_compared(SMALL, pairing, 1, episodes=4)
    assert (first.comparisons, last.comparisons) == (40, 60)
    assert last.agreement > 0.65  # chance is half


def test_the_same_answers_and_seed_give_the_same_policy():
    learner = make_learner("preferences:reward_updates=3,steps=64,n_steps=64,n_epochs=1")
    one, same = (learner.learn(LearningRequest(compared(), np.random.default_rng(1))).policy for _ in range(2))
    assert all(torch.equal(values, same.state_dict()[key]) for key, values in one.state_dict().items())


def test_preferences_that_ran_out_of_time_are_made_again_without_a_limit(tmp_path, monkeypatch):
    asked = (number**2 for number in count())  # a machine that becomes slower and slower
    monkeypatch.setattr(fitting, "time", SimpleNamespace(monotonic=lambda: next(asked)))
    dataset, settings = compared(), "reward_updates=1000,steps=128,n_steps=64,n_epochs=1"
    made = make_policy(dataset, f"preferences:{settings}", tmp_path / "policy.pt", seed=5, budget_s=300)
    assert 1 < made.card.notes["made"]["settings"]["reward_updates"] < 1000
    assert reproduce_policy(made.path, dataset) == []


def test_preferences_go_on_from_the_policy_so_far():
    dataset = compared()
    start = make_fresh_policy(dataset, np.random.default_rng(5))
    learner = make_learner("preferences:reward_updates=1,steps=64,n_steps=64,n_epochs=1,learning_rate=1e-9")
    learnt = learner.learn(LearningRequest(dataset, np.random.default_rng(1), start)).policy
    assert all(
        torch.allclose(values, learnt.state_dict()[key], atol=1e-4) for key, values in start.state_dict().items()
    )


def test_the_pairs_that_are_asked_about_are_those_whose_order_is_least_certain():
    dataset = compared()
    model, _ = fit_reward(dataset, RewardFitting(members=3, updates=20), np.random.default_rng(1))
    chosen = select_disputed_pairs(model, dataset, 4, steps=6, among=len(dataset.lessons), rng=np.random.default_rng(2))
    any_pairs = draw_pairs(dataset.lessons, 40, steps=6, rng=np.random.default_rng(2))
    assert sorted(compute_disagreement(model, dataset, chosen)) == pytest.approx(
        sorted(compute_disagreement(model, dataset, any_pairs))[-4:]
    )
    with pytest.raises(LearnError, match="no two stretches of 99 steps"):
        draw_pairs(dataset.lessons, 1, steps=99, rng=np.random.default_rng(2))


def test_what_is_added_to_every_reward_changes_nothing_that_is_learnt_from():
    """Rewards have mean 0 and one spread over what was looked at."""
    dataset = compared()
    model, _ = fit_reward(dataset, RewardFitting(members=2, updates=5), np.random.default_rng(1))
    rewards = [
        model.reward({"image": seen}, int(action))
        for lesson in dataset.lessons
        for seen, action in zip(lesson.observations["image"], lesson.actions, strict=True)
    ]
    assert np.mean(rewards) == pytest.approx(0, abs=1e-6)
    assert np.std(rewards) == pytest.approx(0.1, abs=1e-6)


def test_reaching_the_goal_is_no_end_for_who_learns_from_judgements():
    world = RewardModelEnv(compared(), Progress(), seed=1)
    begin, _ = world.reset()
    for action in (2, 2, 2, 2, 2, 1, 2, 2, 2, 2):
        world.step(action)
    seen, worth, terminated, truncated, _ = world.step(2)
    assert worth == 1.0
    assert not terminated
    assert not truncated
    assert np.array_equal(seen["image"], begin["image"])
    assert (world._episode, world._steps) == (1, 0)


def test_progress_is_what_a_step_shortens_the_way_by():
    world = RewardModelEnv(compared(), Progress(), seed=1)
    world.reset()
    world.step(2)
    assert [world.step(action)[1] for action in (2, 0, 1)] == [1.0, -1.0, 1.0]
