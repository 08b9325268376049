"""Run the study: a folder of finished jobs, a pool of local processes or a Ray cluster (extra `cluster`), and a
display of the time left.
"""

import abc
import json
import multiprocessing
import multiprocessing.connection
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from minihuman.errors import LearnError
from minihuman.learn.ppo import PpoSettings
from minihuman.storage.durable_files import write_atomically
from transfer_study.job import Result, read_result, run_job, steps_so_far
from transfer_study.plan import TransferJob, TransferStudy


class Engine(abc.ABC):
    """Takes jobs and runs as many at a time as it has room for."""

    name: str

    @abc.abstractmethod
    def submit(self, job: TransferJob, out: Path, device: str) -> "Future[Result]":
        """Run ``run_job(job, out, device)`` somewhere, some time."""

    @abc.abstractmethod
    def close(self) -> None:
        """Drop what has not begun, and let go. What has begun is resumable."""


class LocalPool(Engine):
    """Processes on this machine, one thread each."""

    def __init__(self, workers: int) -> None:
        """Open a pool of so many processes."""
        if workers < 1:
            raise LearnError(f"workers is {workers}; at least one process has to work")
        self.name = f"local pool of {workers}"
        # spawn: a forked child would inherit torch's and numba's threads half alive
        spawn = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(workers, mp_context=spawn, initializer=_end_with_parent)

    def submit(self, job: TransferJob, out: Path, device: str) -> "Future[Result]":
        """Queue a job."""
        return self._pool.submit(run_job, job, out, device)

    def close(self) -> None:
        """Stop the processes."""
        processes = list((self._pool._processes or {}).values())
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()


def _end_with_parent() -> None:
    """A worker whose study was killed must not train on unseen: what it has begun is resumable."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


class RayCluster(Engine):
    """A Ray cluster, or a local one where no address is given. ``out`` must be a folder that every node sees."""

    def __init__(self, address: str | None = None, *, workers: int | None = None) -> None:
        """Connect, or start a local cluster of so many CPUs.

        Raises:
            LearnError: if Ray is not installed or the cluster cannot be reached.
        """
        try:
            import ray
        except ImportError:
            raise LearnError('the ray engine needs Ray; pip install "ray>=2.40"') from None
        self._ray = ray
        settings: dict[str, Any] = {"include_dashboard": False, "logging_level": "warning"}
        if address is not None:
            settings = {"address": address}
        elif workers is not None:
            settings["num_cpus"] = workers
        try:
            ours = {"py_modules": [str(Path(__file__).parent)]}  # its workers import this package
            ray.init(log_to_driver=False, runtime_env=ours, **settings)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise LearnError(f"no Ray cluster at {address or 'this machine'}: {str(error).splitlines()[0]}") from None
        self.name = f"Ray at {address}" if address else "local Ray"
        self._run = ray.remote(num_cpus=1)(run_job)

    def submit(self, job: TransferJob, out: Path, device: str) -> "Future[Result]":
        """Queue a job."""
        future: Future[Result] = self._run.remote(job, out.resolve(), device).future()  # type: ignore[call-arg]
        return future

    def close(self) -> None:
        """Disconnect; a local cluster ends."""
        self._ray.shutdown()


def open_engine(name: str, *, workers: int | None = None, address: str | None = None) -> Engine:
    """The engine of that name; by default one job at a time for every core.

    Raises:
        LearnError: if there is no such engine, or it cannot be opened.
    """
    match name:
        case "local":
            return LocalPool(workers if workers is not None else os.cpu_count() or 1)
        case "ray":
            return RayCluster(address, workers=workers)
        case _:
            raise LearnError(f"no engine is called {name!r}; there are local and ray")


STUDY = "study.json"
COUNTS = ("runs", "baselines")


def open_folder(study: TransferStudy, out: Path) -> None:
    """Make the folder the study's own, or see that it is already; a study may come back with more runs.

    Raises:
        LearnError: if the folder holds another study, or anything else; nothing is touched then.
    """
    path = out / STUDY
    wanted = json.loads(json.dumps(study.as_dict()))
    if path.exists():
        held = json.loads(path.read_text())
        changed = [name for name in {**held, **wanted} if held.get(name) != wanted.get(name)]
        # a run's seeds do not depend on how many there are
        if changed and set(changed) <= set(COUNTS) and all(wanted[name] >= held[name] for name in COUNTS):
            write_atomically(json.dumps(wanted, indent=1), path)
            return
        if not changed:
            return
        name = changed[0]
        raise LearnError(
            f"{out} holds another study ({name} is {held.get(name)!r} there and {wanted.get(name)!r} here); "
            "choose another --out"
        )
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise LearnError(f"{out} is not empty and holds no study; choose a new --out")
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(json.dumps(wanted, indent=1), path)


def read_results(study: TransferStudy, out: Path) -> dict[TransferJob, Result]:
    """The results of the jobs that are done, in the study's order."""
    results = {job: read_result(job, out) for job in study.jobs()}
    return {job: result for job, result in results.items() if result is not None}


def read_study(out: Path) -> TransferStudy:
    """Which study a folder holds.

    Raises:
        LearnError: if it holds none, or one of another version.
    """
    path = out / STUDY
    try:
        settings = json.loads(path.read_text())
        return TransferStudy(
            **settings | {"ppo": PpoSettings(**settings["ppo"]), "transfers": tuple(settings["transfers"])}
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LearnError(
            f"{path} is no study of this version ({error}); name a folder of analysis/transfer.py run"
        ) from None


def read_merged(folders: Sequence[Path]) -> tuple[TransferStudy, dict[TransferJob, Result]]:
    """One study out of the folders that hold runs of it. Where two have the same run, the first folder's counts.

    Raises:
        LearnError: if a folder holds another study.
    """
    studies = [read_study(folder) for folder in folders]
    whole = replace(studies[0], **{name: max(getattr(study, name) for study in studies) for name in COUNTS})
    for folder, study in zip(folders, studies, strict=True):
        if replace(study, **{name: getattr(whole, name) for name in COUNTS}) != whole:
            raise LearnError(
                f"{folder} holds another study than {folders[0]}; only runs of one study can be put together"
            )
    results: dict[TransferJob, Result] = {}
    for folder in reversed(folders):
        results |= read_results(whole, folder)
    return whole, {job: results[job] for job in whole.jobs() if job in results}


POLL_S = 1.0


def run_study(
    study: TransferStudy,
    out: Path,
    open_engine: Callable[[], Engine],
    *,
    first_run: int = 0,
    device: str = "auto",
    console: Console | None = None,
) -> dict[TransferJob, Result]:
    """Run every job that is not done yet, and return all results. The engine opens only if something is to do.

    Runs before ``first_run`` are left to another machine.

    Raises:
        LearnError: if the folder holds another study.
    """
    open_folder(study, out)
    jobs = study.jobs(first_run)
    if all(read_result(job, out) is not None for job in jobs):
        return read_results(study, out)
    with ExitStack() as stack:
        engine = open_engine()
        stack.callback(engine.close)
        display = stack.enter_context(_Display(jobs, out, console or Console(stderr=True)))
        _run_all(jobs, out, lambda job: engine.submit(job, out, device), display)
    return read_results(study, out)


def _run_all(
    jobs: Sequence[TransferJob], out: Path, submit: "Callable[[TransferJob], Future[Result]]", display: "_Display"
) -> None:
    done = {job for job in jobs if read_result(job, out) is not None}
    waiting = [job for job in jobs if job not in done]
    running: dict[Future[Result], TransferJob] = {}
    while waiting or running:
        ready = [job for job in waiting if job.source is None or job.source in done]
        for job in ready:
            running[submit(job)] = job
            waiting.remove(job)
        finished, _ = wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED)
        for future in finished:
            job = running.pop(future)
            display.finished(job, future.result())
            done.add(job)
        display.update(running.values())


class _Display:
    """A bar over all steps with the time left, a bar for each running job, and one line as each job ends."""

    def __init__(self, jobs: Sequence[TransferJob], out: Path, console: Console) -> None:
        self._out = out
        self._jobs = jobs
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("steps"),
            TimeRemainingColumn(compact=True),
            console=console,
            # the speed of a whole study is steady only over minutes
            speed_estimate_period=600,
        )
        self._bars: dict[TransferJob, TaskID] = {}

    def __enter__(self) -> "_Display":
        self._progress.start()
        done = sum(min(steps_so_far(job, self._out), job.steps) for job in self._jobs)
        self._all = self._progress.add_task("all jobs", total=sum(job.steps for job in self._jobs), completed=done)
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def update(self, running: Iterable[TransferJob]) -> None:
        """Read how far the jobs are."""
        steps = {job: min(steps_so_far(job, self._out), job.steps) for job in self._jobs}
        self._progress.update(self._all, completed=sum(steps.values()))
        for job in running:
            if steps[job] and job not in self._bars:
                self._bars[job] = self._progress.add_task(job.name, total=job.steps)
            if job in self._bars:
                self._progress.update(self._bars[job], completed=steps[job])

    def finished(self, job: TransferJob, result: Result) -> None:
        """Say that a job is done."""
        if job in self._bars:
            self._progress.remove_task(self._bars.pop(job))
        done = sum(read_result(other, self._out) is not None for other in self._jobs)
        self._progress.console.print(
            f"{done} of {len(self._jobs)} jobs done: {job.name}, {result.steps:,} steps, "
            f"{result.steps / result.busy_s:,.0f} steps/s, mean reward {result.points[-1].reward:.3f}",
            highlight=False,
        )
