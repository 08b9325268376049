"""The study, run: jobs handed to an engine as their sources become ready, with a display of time left."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from minihuman.learn.transfer.engines import Engine
from minihuman.learn.transfer.folder import open_folder, read_results
from minihuman.learn.transfer.job import Result, read_result, steps_so_far
from minihuman.learn.transfer.plan import Job, Study

POLL_S = 1.0


def run_study(
    study: Study,
    out: Path,
    open_engine: Callable[[], Engine],
    *,
    first_run: int = 0,
    device: str = "auto",
    console: Console | None = None,
) -> dict[Job, Result]:
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


def _run_all(jobs: Sequence[Job], out: Path, submit: "Callable[[Job], Future[Result]]", display: "_Display") -> None:
    done = {job for job in jobs if read_result(job, out) is not None}
    waiting = [job for job in jobs if job not in done]
    running: dict[Future[Result], Job] = {}
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

    def __init__(self, jobs: Sequence[Job], out: Path, console: Console) -> None:
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
        self._bars: dict[Job, TaskID] = {}

    def __enter__(self) -> "_Display":
        self._progress.start()
        done = sum(min(steps_so_far(job, self._out), job.steps) for job in self._jobs)
        self._all = self._progress.add_task("all jobs", total=sum(job.steps for job in self._jobs), completed=done)
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def update(self, running: Iterable[Job]) -> None:
        """Read how far the jobs are."""
        steps = {job: min(steps_so_far(job, self._out), job.steps) for job in self._jobs}
        self._progress.update(self._all, completed=sum(steps.values()))
        for job in running:
            if steps[job] and job not in self._bars:
                self._bars[job] = self._progress.add_task(job.name, total=job.steps)
            if job in self._bars:
                self._progress.update(self._bars[job], completed=steps[job])

    def finished(self, job: Job, result: Result) -> None:
        """Say that a job is done."""
        if job in self._bars:
            self._progress.remove_task(self._bars.pop(job))
        done = sum(read_result(other, self._out) is not None for other in self._jobs)
        self._progress.console.print(
            f"{done} of {len(self._jobs)} jobs done: {job.name}, {result.steps:,} steps, "
            f"{result.steps / result.busy_s:,.0f} steps/s, mean reward {result.points[-1].reward:.3f}",
            highlight=False,
        )
