"""`minihuman learn ppo --resume`: killed at any moment, a training ends with the weights of one that was not."""

import csv
import random
import sys
import time
from dataclasses import replace

import pytest
import torch

from minihuman.errors import LearnError
from minihuman.learn.policy.file import load_policy, read_checkpoint
from minihuman.learn.training import TrainingStoppedError, train
from minihuman.learn.training_settings import TrainingJob, TrainingSettings, WorldChoice, read_job
from tests.programs import running

WORLDS = (
    WorldChoice("minihuman/MiniGrid-DoorKey-5x5-v0", {"max_steps": 30}),
    WorldChoice("minihuman/MiniGrid-Empty-5x5-v0", {"max_steps": 15}),
)
BRIEF = TrainingSettings(steps=1_000, worlds=4, rollout=16, minibatches=2, checkpoint_every=1, evaluation=0)
JOBS = {
    "batch": TrainingJob(WORLDS[:1], BRIEF),
    "memory, stages": TrainingJob(WORLDS[::-1], replace(BRIEF, memory=True, curriculum="staged", stage_episodes=5)),
    "vectors, memory": TrainingJob(
        (WorldChoice("minihuman/MiniWorld-OneRoom-v0", {"control": "continuous", "max_steps": 20}),),
        replace(BRIEF, memory=True, network="mlp"),
    ),
    "plr": TrainingJob(WORLDS, replace(BRIEF, curriculum="plr", replay_levels=6)),
}


class KilledError(Exception):
    pass


def read_curve(path):
    with path.with_suffix(".csv").open(newline="") as file:
        return [{name: cell for name, cell in row.items() if name != "cpu_s"} for row in csv.DictReader(file)]


def assert_same(path, other):
    weights, other_weights = (load_policy(file)[0].state_dict() for file in (path, other))
    assert all(torch.equal(weights[name], other_weights[name]) for name in weights)
    assert read_curve(path) == read_curve(other)


@pytest.mark.parametrize("name", JOBS)
def test_a_run_that_broke_off_anywhere_ends_as_one_that_did_not(tmp_path, name):
    job = JOBS[name]
    train(job, tmp_path / "whole.pt")
    stops = iter(sorted(random.Random(name).sample(range(1, 15), 3)))
    stop = next(stops)
    updates = 0

    def break_off(point, curriculum):
        nonlocal updates
        updates += 1
        if updates == stop:
            raise KilledError

    broken = tmp_path / "broken.pt"
    for _ in range(3):
        with pytest.raises(KilledError):
            train(job, broken, resume=True, follow=break_off)
        assert (tmp_path / "broken.pt.checkpoint").exists()
        stop = next(stops, 0)
    train(job, broken, resume=True, follow=break_off)
    assert_same(tmp_path / "whole.pt", broken)
    assert not (tmp_path / "broken.pt.checkpoint").exists()


@pytest.mark.program
@pytest.mark.parametrize("number", [pytest.param(n, marks=[] if n < 2 else pytest.mark.nightly) for n in range(10)])
def test_a_program_that_is_killed_at_a_drawn_moment_resumes_to_the_same_weights(tmp_path, number):
    file = tmp_path / "job.toml"
    file.write_text(
        "steps = 3000\nworlds = 4\nrollout = 16\nminibatches = 2\ncheckpoint_every = 2\nevaluation = 0\n"
        f"memory = {'true' if number % 2 else 'false'}\n"
        '[[world]]\nid = "minihuman/MiniGrid-DoorKey-5x5-v0"\noptions = { max_steps = 30 }\n'
    )
    train(read_job(file), tmp_path / "whole.pt")
    killed = tmp_path / "killed.pt"
    checkpoint = tmp_path / "killed.pt.checkpoint"
    rng = random.Random(number)
    command = [sys.executable, "-m", "minihuman", "learn", "ppo", "--job", str(file), "--out", str(killed)]
    with running(command) as process:
        while not checkpoint.exists():
            assert process.poll() is None, "it ended before it could be killed"
            time.sleep(0.002)
        time.sleep(rng.random() * 0.3)  # whatever it is at
        process.kill()
    if not killed.exists():
        print(f"killed with {read_checkpoint(checkpoint)['run']['counts'][0]} of 3008 steps in the checkpoint")
        train(read_job(file), killed, resume=True)
    assert_same(tmp_path / "whole.pt", killed)


def test_a_run_that_is_stopped_writes_and_evaluates_its_policy(tmp_path):
    def stop(point, curriculum):
        if point.steps >= 192:
            raise TrainingStoppedError

    job = TrainingJob(WORLDS[:1], replace(BRIEF, evaluation=2))
    report = train(job, tmp_path / "policy.pt", follow=stop)
    assert [point.steps for point in report.points] == [64, 128, 192]
    assert [evaluation.episodes for evaluation in report.evaluations] == [2]
    assert load_policy(tmp_path / "policy.pt")[1].steps == 192
    assert not (tmp_path / "policy.pt.checkpoint").exists()


def test_a_checkpoint_is_neither_ignored_nor_taken_for_another_job(tmp_path):
    def stop(point, curriculum):
        raise KilledError

    out = tmp_path / "policy.pt"
    job = JOBS["batch"]
    with pytest.raises(KilledError):
        train(job, out, follow=stop)
    with pytest.raises(LearnError, match="is a run that was interrupted; resume it with --resume"):
        train(job, out)
    other = TrainingJob(job.worlds, replace(job.settings, gamma=0.9))
    with pytest.raises(LearnError, match=r"a run whose gamma is 0\.99, not 0\.9; resume with the same settings"):
        train(other, out, resume=True)
    with pytest.raises(LearnError, match="is of a run in other worlds"):
        train(TrainingJob(WORLDS[1:], job.settings), out, resume=True)
    (tmp_path / "policy.pt.checkpoint").write_bytes(b"no checkpoint")
    with pytest.raises(LearnError, match="cannot be read"):
        train(job, out, resume=True)
