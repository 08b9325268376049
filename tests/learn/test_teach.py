from dataclasses import replace

import numpy as np
import pytest
import torch

from minihuman.errors import LearnError
from minihuman.learn.policy.file import load_policy
from minihuman.learn.policy.network import build_policy
from minihuman.learn.policy.observation import REACH, ObservationEncoder, encode_whole_grid
from minihuman.learn.teaching import learner, provenance
from minihuman.learn.teaching.dataset import Comparison, LessonFragment, LessonRating
from minihuman.learn.teaching.learner import LearningRequest, make_learner
from minihuman.learn.teaching.provenance import make_policy, reproduce_policy
from minihuman.testing.learner_contract import build_teaching_dataset
from teaching_study.simulation import evaluate_taught_policy
from tests.learn.taught import sitting, taught

UNLIMITED = float("inf")


@pytest.fixture(scope="module")
def demonstrated():
    return taught()


@pytest.fixture(scope="module")
def watched(demonstrated):
    """The same demonstrations, and what happened when a fresh policy played and the supervisor watched."""
    with torch.random.fork_rng():
        torch.manual_seed(1)
        fresh = build_policy(demonstrated.space, 6, "codes")
    return taught(policy=fresh, watched=3)


def learn(name, dataset, *, seed=1, budget_s=UNLIMITED, checkpoint=None):
    return make_learner(name).learn(LearningRequest(dataset, np.random.default_rng(seed), None, budget_s, checkpoint))


def weights(policy):
    return torch.cat([values.flatten() for values in policy.state_dict().values()])


def test_the_supervisor_takes_over_from_a_policy_that_wanders_and_hands_back(watched):
    lesson = watched.lessons[-1]
    assert 0 < lesson.by_person.sum() < len(lesson.actions)
    own = ~lesson.by_person
    assert np.array_equal(lesson.actions[own], lesson.policy_actions[own])
    assert (lesson.actions != lesson.policy_actions)[lesson.by_person].any()
    assert np.all(np.diff(lesson.shown_ns) > 0)


def test_a_supervisor_shows_what_it_would_do_without_a_policy(demonstrated):
    assert all(lesson.is_demonstration and lesson.rewards[-1] > 0 for lesson in demonstrated.lessons)
    assert demonstrated.labelled_steps == demonstrated.steps


@pytest.mark.parametrize("name", ["cloning", "hg-dagger", "intervention-weighted"])
def test_the_same_data_and_seed_give_the_same_policy(watched, name):
    one, same, other = (learn(f"{name}:updates=20", watched, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(weights(one.policy), weights(same.policy))
    assert not torch.equal(weights(one.policy), weights(other.policy))


def test_learners_differ_in_the_steps_they_take(watched):
    taken = {
        name: learn(f"{name}:updates=1", watched).notes for name in ("cloning", "hg-dagger", "intervention-weighted")
    }
    demonstrated = sum(len(lesson.actions) for lesson in watched.lessons if lesson.is_demonstration)
    assert taken["cloning"]["steps"] == demonstrated
    assert taken["hg-dagger"]["labelled_steps"] == watched.labelled_steps > demonstrated
    assert taken["intervention-weighted"]["steps"] == watched.steps


def test_enough_of_what_was_shown_makes_a_policy_that_gets_there():
    shown = taught(40)
    fresh = evaluate_taught_policy(learn("cloning:updates=1", shown).policy, shown, episodes=40, seed=1)
    cloned = evaluate_taught_policy(learn("cloning:updates=400", shown).policy, shown, episodes=40, seed=1)
    assert cloned.rate > 0.7 > fresh.rate + 0.2


def test_the_first_updates_are_shorter_while_it_warms_up():
    moved = {}
    for warm_up in (0, 4):
        network = torch.nn.Linear(1, 1, bias=False)
        before = float(network.weight.detach())
        learner.minimise_loss(
            network,
            lambda _, network=network: network(torch.ones(1)).sum(),
            np.random.default_rng(1),
            updates=1,
            learning_rate=0.1,
            warm_up=warm_up,
        )
        moved[warm_up] = before - float(network.weight.detach())
    assert moved == pytest.approx({0: 0.1, 4: 0.025}, rel=1e-3)


def test_a_learner_that_was_stopped_goes_on_to_the_same_weights(watched, tmp_path, monkeypatch):
    monkeypatch.setattr(learner, "SAVE_EVERY", 10)
    whole = learn("hg-dagger:updates=30,warm_up=15", watched)
    checkpoint = tmp_path / "checkpoint"
    saved = learner.save_atomically

    def save_and_stop(content, path):
        saved(content, path)
        raise KeyboardInterrupt

    monkeypatch.setattr(learner, "save_atomically", save_and_stop)
    with pytest.raises(KeyboardInterrupt):
        learn("hg-dagger:updates=30,warm_up=15", watched, checkpoint=checkpoint)
    monkeypatch.setattr(learner, "save_atomically", saved)
    resumed = learn("hg-dagger:updates=30,warm_up=15", watched, checkpoint=checkpoint)
    assert torch.equal(weights(whole.policy), weights(resumed.policy))
    assert not checkpoint.exists()


def test_a_policy_says_what_it_was_made_from_and_is_made_again(watched, tmp_path):
    policy = make_policy(watched, "hg-dagger:updates=30", tmp_path / "policy.pt", seed=5)
    card = load_policy(policy.path)[1]
    assert card.notes["made"]["data_sha256"] == watched.sha256()
    assert card.notes["made"]["settings"]["updates"] == 30
    assert reproduce_policy(policy.path, watched) == []
    assert "data_sha256" in reproduce_policy(policy.path, taught(3))[0]


def test_a_policy_that_ran_out_of_time_is_made_again_without_a_limit(watched, tmp_path):
    policy = make_policy(watched, "cloning:updates=100000", tmp_path / "policy.pt", seed=5, budget_s=0.2)
    assert 1 <= policy.card.notes["made"]["settings"]["updates"] < 100_000
    assert reproduce_policy(policy.path, watched) == []


def test_a_policy_that_other_code_made_says_so_where_its_weights_differ(watched, tmp_path, monkeypatch):
    one = make_policy(watched, "hg-dagger:updates=30", tmp_path / "policy.pt", seed=5)
    assert one.card.notes["made"]["code"]["minihuman"]
    monkeypatch.setattr(
        provenance, "get_code_versions", lambda: one.card.notes["made"]["code"] | {"sources_sha256": "other"}
    )
    assert reproduce_policy(one.path, watched) == []  # other code, equal weights
    monkeypatch.setattr(provenance, "_find_differences", lambda policy, again: ["weights differ"])
    assert "it was made by sources_sha256" in reproduce_policy(one.path, watched)[0]


def test_what_cannot_be_learned_from_is_said(watched):
    with pytest.raises(LearnError, match="cloning: none of its lessons has a step taken by a person"):
        learn("cloning", sitting()[1].with_more([watched.lessons[-1]]))
    with pytest.raises(LearnError, match="learner 'clonning' is unknown; it is one of"):
        make_learner("clonning")
    with pytest.raises(LearnError, match="cloning has no setting 'update'"):
        make_learner("cloning:update=3")
    with pytest.raises(LearnError, match="updates is 'many'"):
        make_learner("cloning:updates=many")


def test_data_that_do_not_belong_together_are_refused(demonstrated):
    with pytest.raises(LearnError, match="is not in the dataset"):
        demonstrated.with_more(ratings=[LessonRating(1, 1.0, "nobody")])
    name = demonstrated.lessons[0].name
    far = LessonFragment(name, 0, 10_000)
    with pytest.raises(LearnError, match=r"has \d+ steps"):
        demonstrated.with_more(comparisons=[Comparison(far, far, "left")])


def test_a_fingerprint_changes_with_every_part(demonstrated):
    name = demonstrated.lessons[0].name
    others = [
        demonstrated.with_more(ratings=[LessonRating(1, 1.0, name)]),
        demonstrated.with_more(
            comparisons=[Comparison(LessonFragment(name, 0, 1), LessonFragment(name, 1, 2), "left")]
        ),
        demonstrated.with_more([demonstrated.lessons[0].part(0, 2)]),
        taught(seed=1).with_more(),
    ]
    fingerprints = [each.sha256() for each in others]
    assert fingerprints[-1] == demonstrated.sha256()
    assert len({*fingerprints}) == len(others)


def test_the_fingerprint_of_known_data_stays_as_policy_files_carry_it():
    dataset = build_teaching_dataset()
    assert dataset.sha256() == "9ef2a4f24d51bf0a1db3166ef4908df383a1b419f4684acf224c0aaea5ef8b5f"
    one = replace(dataset, ratings=dataset.ratings[:1], comparisons=dataset.comparisons[:1])
    assert one.sha256() == "874266633cd5624de1504c5cebc83f3abf9dbd404a98accc1fda6f6fc82a5899"


def test_a_world_that_is_remembered_shows_what_was_in_view_and_nothing_else():
    taking, dataset = sitting(
        "minihuman/MiniGrid-FourRooms-v0", eyesight=ObservationEncoder(missions=False, sight="remembered")
    )
    world = taking.world
    encoder = dataset.eyesight.episode_encoder()
    world.reset(3)
    first = encoder.encode(world.unwrapped, world.observation)["image"]
    assert first.shape == dataset.space["image"].shape
    shown = (first[0] > 0).sum()
    assert 1 < shown <= 49
    for action in (0, 0, 0):  # once round
        world.step(action)
        last = encoder.encode(world.unwrapped, world.observation)["image"]
    assert (last[0] > 0).sum() > shown
    near = slice(18 - REACH, 19 + REACH)
    whole = np.moveaxis(encode_whole_grid(world.unwrapped), -1, 0)[:, near, near]
    known = last[0] > 0
    known[REACH, REACH] = False  # the agent's own cell shows what it carries
    assert np.array_equal(last[0][known], (whole * 25)[0][known])
    world.reset(3)
    assert np.array_equal(encoder.encode(world.unwrapped, world.observation)["image"], first)
