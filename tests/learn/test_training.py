import dataclasses
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from minihuman.errors import LearnError
from minihuman.learn.ppo import PpoSettings
from tests.programs import running
from transfer_study.job import (
    CHECKPOINT,
    LOCK,
    POLICY,
    RESULT,
    load_weights,
    prepare,
    read_result,
    run_job,
    steps_so_far,
)
from transfer_study.plan import BASELINE, SOURCE, TransferCell, TransferJob, TransferStudy
from transfer_study.training import train_resumably

pytestmark = pytest.mark.program

SMALL = PpoSettings(n_steps=128, batch_size=64, n_epochs=2)


def small_study(**changes):
    return dataclasses.replace(TransferStudy(runs=1, steps=640, source_steps=640, ppo=SMALL, seed=5), **changes)


def same_weights(a, b):
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A source trained without a break."""
    out = tmp_path_factory.mktemp("whole")
    job = TransferJob(small_study(), TransferCell(SOURCE), 0)
    return job, out, run_job(job, out, "cpu")


def test_a_killed_job_goes_on_to_the_same_result(finished, tmp_path):
    job, whole, result = finished
    script = (
        "import sys; from pathlib import Path; from tests.learn.test_training import *\n"
        "run_job(TransferJob(small_study(), TransferCell(SOURCE), 0), Path(sys.argv[1]), 'cpu')"
    )
    root = Path(__file__).parents[2]
    paths = {"PYTHONPATH": os.pathsep.join((str(root), str(root / "analysis")))}
    process = subprocess.Popen([sys.executable, "-c", script, str(tmp_path)], cwd=root, env=os.environ | paths)
    while steps_so_far(job, tmp_path) < 256:
        assert process.poll() is None, "the job ended before it could be killed"
        time.sleep(0.005)
    with pytest.raises(LearnError, match="being trained by another process"):
        run_job(job, tmp_path, "cpu")
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert read_result(job, tmp_path) is None

    resumed = run_job(job, tmp_path, "cpu")
    assert resumed.points == result.points
    assert same_weights(load_weights(tmp_path / job.name / POLICY), load_weights(whole / job.name / POLICY))


def test_workers_end_with_a_killed_study(tmp_path):
    script = (
        "import sys; from pathlib import Path; from tests.learn.test_training import *\n"
        "from transfer_study.engines import LocalPool, run_study\n"
        "if __name__ == '__main__':\n"
        "    run_study(small_study(source_steps=10**6), Path(sys.argv[1]), lambda: LocalPool(1), device='cpu')"
    )
    started = tmp_path / "study.py"  # spawned workers import the main script, so it is a file
    started.write_text(script)
    root = Path(__file__).parents[2]
    paths = os.pathsep.join((str(root), str(root / "analysis")))
    out = tmp_path / "out"
    job = TransferJob(small_study(source_steps=10**6), TransferCell(SOURCE), 0)
    with running([sys.executable, started, str(out)], env=os.environ | {"PYTHONPATH": paths}) as process:
        while steps_so_far(job, out) == 0:
            assert process.poll() is None, "the study ended before it could be killed"
            time.sleep(0.01)
        process.kill()
    with (out / job.name / LOCK).open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # returns once the worker is gone


def test_a_result_of_another_version_is_named(finished, tmp_path):
    job, whole, _ = finished
    shutil.copytree(whole, tmp_path / "old")
    result = tmp_path / "old" / job.name / RESULT
    result.write_text(result.read_text().replace('"success"', '"wins"'))
    with pytest.raises(LearnError, match=r"result\.json is not a result of this version"):
        read_result(job, tmp_path / "old")


def test_a_checkpoint_of_another_version_is_named_and_left(finished, tmp_path):
    job, _, _ = finished
    checkpoint = tmp_path / job.name / CHECKPOINT
    checkpoint.parent.mkdir(parents=True)
    checkpoint.write_bytes(b"cminihuman.worlds\nNoSuchWorld\n.")
    with pytest.raises(LearnError, match=r"checkpoint\.pt cannot be read .*move the file away to start again"):
        run_job(job, tmp_path, "cpu")
    assert checkpoint.read_bytes() == b"cminihuman.worlds\nNoSuchWorld\n."


class StoppedError(Exception):
    pass


@pytest.mark.parametrize("protocol", ["as-intended", "as-published"])
def test_an_interrupted_transfer_goes_on_to_the_same_weights(finished, tmp_path, protocol):
    _, whole, _ = finished
    # the published code keeps gradients that are never cleared: they are part of the state
    job = TransferJob(small_study(protocol=protocol, steps=384), TransferCell("CM"), 0)
    source = load_weights(whole / "source/run-00" / POLICY)

    def stop_at_256(steps):
        if steps >= 256:
            raise StoppedError

    ppo, world = prepare(job, source, "cpu")
    history = train_resumably(ppo, world, steps=job.steps)

    checkpoint = tmp_path / "checkpoint.pt"
    broken, its_world = prepare(job, source, "cpu")
    with pytest.raises(StoppedError):
        train_resumably(broken, its_world, steps=job.steps, checkpoint=checkpoint, told=stop_at_256)
    resumed, its_world = prepare(job, source, "cpu")
    its_history = train_resumably(resumed, its_world, steps=job.steps, checkpoint=checkpoint)
    assert its_history.points == history.points
    assert same_weights(resumed.policy.state_dict(), ppo.policy.state_dict())


def test_a_finished_job_is_not_trained_again(finished):
    job, out, result = finished
    before = (out / job.name / POLICY).stat().st_mtime_ns
    assert run_job(job, out, "cpu") == result
    assert (out / job.name / POLICY).stat().st_mtime_ns == before


def test_a_folder_of_another_job_is_left_alone(finished):
    job, out, _ = finished
    other = TransferJob(small_study(seed=6), job.cell, job.run)
    before = (out / job.name / "result.json").read_text()
    with pytest.raises(LearnError, match="holds another job"):
        run_job(other, out, "cpu")
    assert (out / job.name / "result.json").read_text() == before


def test_a_run_shares_its_seed_with_its_baseline_only():
    study = TransferStudy(runs=3, baselines=5)
    seeds = {(job.cell.label, job.run): job.seed for job in study.jobs()}
    assert len(seeds) == 3 + 5 + 3 * 12
    assert all(seed == seeds[BASELINE, run] for (label, run), seed in seeds.items() if label != SOURCE)
    assert len(set(seeds.values())) == 3 + 5


def test_a_whole_table_exists_after_each_run():
    jobs = TransferStudy(runs=2, baselines=3).jobs()
    assert [job.run for job in jobs] == sorted(job.run for job in jobs)
    assert len(jobs) == 14 + 14 + 1


def test_as_published_has_one_source_for_all_runs():
    jobs = TransferStudy(protocol="as-published", runs=3).jobs()
    assert sum(job.cell.name == SOURCE for job in jobs) == 1
    assert {job.source for job in jobs if job.source is not None} == {jobs[0]}
