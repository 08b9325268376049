"""PPO that begins with a clone of a study's people, and a policy beside the people on their levels."""

import subprocess
import sys

import pytest
import torch

from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError
from minihuman.learn.evaluation import compare_with_people
from minihuman.learn.training import train
from minihuman.learn.training_settings import TrainingJob, TrainingSettings, WorldChoice
from minihuman.runtime.simulated_session import simulate

pytestmark = pytest.mark.program

EMPTY = "minihuman/MiniGrid-Empty-5x5-v0"
PROTOCOL = f"""
[study]
name = "people"
version = "1.0"
seed = 3
participants = 5

[keys]
pool = ["1", "2", "3"]

[[groups]]
name = "everyone"
blocks = ["grid"]

[[blocks]]
name = "grid"
world = "{EMPTY}"
episodes = 4
actions = ["left", "right", "forward"]
max_steps = 40
key_map = "shown"
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Five participants who take the shortest way."""
    folder = tmp_path_factory.mktemp("people")
    (folder / "people.toml").write_text(PROTOCOL)
    list(simulate(read_protocol(folder / "people.toml"), folder / "data", participants=5, seed=1, player="optimal"))
    return folder / "data" / "people"


def make_job(study, **settings):
    brief = {"steps": 512, "worlds": 8, "rollout": 16, "critic_updates": 2, "evaluation": 30}
    return TrainingJob((WorldChoice(EMPTY),), TrainingSettings(from_people=str(study), **{**brief, **settings}))


@pytest.fixture(scope="module")
def trained(study, tmp_path_factory):
    out = tmp_path_factory.mktemp("trained") / "policy.pt"
    return out, train(make_job(study, kl=0.5), out)


def test_it_begins_with_the_clone_and_does_not_lose_what_that_knew(trained):
    _, report = trained
    assert report.clone.rate >= 0.8
    assert report.points[0].approx_kl == pytest.approx(0, abs=1e-5), "only the critic learns at first"
    assert report.points[2].approx_kl > 0
    assert report.evaluations[0].rate >= 0.9


def test_a_weight_holds_it_nearer_to_the_clone(study, tmp_path):
    entropies = []
    for kl in (0.0, 100.0):
        job = make_job(study, kl=kl, evaluation=0, critic_updates=0, entropy=5.0)  # which draws it away
        entropies.append(train(job, tmp_path / f"{kl}.pt").points[-1].entropy)
    assert entropies[1] < entropies[0]


def test_a_broken_run_resumes_without_the_study(study, tmp_path):
    job = make_job(study, kl=0.1, checkpoint_every=1, evaluation=0)

    class KilledError(Exception):
        pass

    def stop(point, curriculum):
        if point.steps > 256:
            raise KilledError

    whole = train(job, tmp_path / "whole.pt")
    with pytest.raises(KilledError):
        train(job, tmp_path / "broken.pt", follow=stop)
    resumed = train(job, tmp_path / "broken.pt", resume=True)
    assert [point.value_loss for point in resumed.points] == [point.value_loss for point in whole.points]


def test_a_policy_is_scored_beside_each_participant_on_the_same_levels(study, trained):
    out, _ = trained
    run = [sys.executable, "-m", "minihuman", "learn", "compare", str(out), str(study)]
    lines = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()
    assert lines[0] == f"{EMPTY}: the person, the policy on the same levels"
    assert lines[1].split() == ["participant", "episodes", "success", "return", "steps"]
    assert [line.split()[:3] for line in lines[2:7]] == [[f"sub-0{n}", "4", "1.00,"] for n in range(1, 6)]
    assert lines[7].split()[:3] == ["everyone", "20", "1.00,"]
    comparison = compare_with_people(out, study, Selection(), seed=1)
    assert str(comparison).splitlines() == lines
    assert all(pair.policy.mean_steps >= pair.person.mean_steps for pair in comparison.people), "theirs was shortest"


def test_what_does_not_fit_is_refused(study, trained, tmp_path):
    out, _ = trained
    with pytest.raises(LearnError, match=r"was trained in .*Empty-5x5-v0, not in other; choose one of its worlds"):
        compare_with_people(out, study, Selection(), world="other")
    other = TrainingJob((WorldChoice("minihuman/MiniGrid-Empty-6x6-v0"),), make_job(study).settings)
    with pytest.raises(LearnError, match="has no included episode of minihuman/MiniGrid-Empty-6x6-v0"):
        train(other, tmp_path / "other.pt")
    team = TrainingJob((WorldChoice("minihuman/Team-CrampedRoom-v0"),), make_job(study).settings)
    with pytest.raises(LearnError, match="a team world draws its own levels and has no clone"):
        train(team, tmp_path / "other.pt")
    with pytest.raises(LearnError, match="a clone of people has no memory"):
        make_job(study, memory=True)
    assert torch.get_num_threads() == 1
