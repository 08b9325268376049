"""Where jobs run: a pool of local processes, or a Ray cluster (extra ``cluster``). The same jobs, the same numbers."""

import abc
import multiprocessing
import multiprocessing.connection
import os
import threading
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any

from minihuman.errors import LearnError
from minihuman.learn.transfer.job import Result, run_job
from minihuman.learn.transfer.plan import Job


class Engine(abc.ABC):
    """Takes jobs and runs as many at a time as it has room for."""

    name: str

    @abc.abstractmethod
    def submit(self, job: Job, out: Path, device: str) -> "Future[Result]":
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

    def submit(self, job: Job, out: Path, device: str) -> "Future[Result]":
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
            raise LearnError('the ray engine needs Ray; install it with pip install "minihuman[cluster]"') from None
        self._ray = ray
        settings: dict[str, Any] = {"include_dashboard": False, "log_to_driver": False, "logging_level": "warning"}
        if address is not None:
            settings = {"address": address, "log_to_driver": False}
        elif workers is not None:
            settings["num_cpus"] = workers
        try:
            ray.init(**settings)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise LearnError(f"no Ray cluster at {address or 'this machine'}: {str(error).splitlines()[0]}") from None
        self.name = f"Ray at {address}" if address else "local Ray"
        self._run = ray.remote(num_cpus=1)(run_job)

    def submit(self, job: Job, out: Path, device: str) -> "Future[Result]":
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
