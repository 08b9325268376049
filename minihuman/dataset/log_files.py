"""Find the log files below a path and read them in parallel, without the data of participants who withdrew.

No file is changed. A file that cannot be read is reported with its reason, and the others are still read. The data of
participants who withdrew from a study are excluded everywhere, and no message names these participants.
"""

import atexit
import gc
import os
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from minihuman.dataset.withdrawn_codes import LEDGER_FILE_NAME, read_withdrawn_codes
from minihuman.errors import LogError, ProtocolError
from minihuman.garbage_collection import SELDOM, infrequent_collection as infrequent_collection
from minihuman.log.model.session_log import SessionLog
from minihuman.log.paths import (
    SYSTEM_COMPANION,
    find_log_folders,
    find_system_companions,
    group_sessions,
    raise_as_log_error,
)
from minihuman.log.salvage.summary_section import read_first_metadata
from minihuman.operating_system import count_processes
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME, URL_FILE_NAME

_N_PARENTS = 3  # folders above a session's to search for its study: <study>/sub-07/ses-01

T = TypeVar("T")
_SEGMENT_ENDING = re.compile(r"(_seg-\d+)?\.mcap(\.part)?$")
_MIN_LOGS_PER_PROCESS = 32  # sessions; fewer are read faster than another process starts
_BATCH = 4  # sessions sent to a process together
_RAY_BATCH = 16  # sessions per task; a cluster's tasks cost more than a process's
_AHEAD = 4  # unconsumed batches, in addition to two per worker process
_Batch = tuple[list[Path], "Future[list[T]]"]


@dataclass(frozen=True, slots=True)
class SkippedLog:
    """A file that is not read, and the reason in one sentence."""

    path: Path
    reason: str

    def line(self) -> str:
        """Describe the skipped file in one line."""
        return f"skipped {self.path}: {self.reason}"

    def relative_to(self, source: Path) -> "SkippedLog":
        """Return a copy with paths relative to the study's folder, so that outputs name no folder outside the study."""
        if source in self.path.parents:
            path = self.path.relative_to(source)
        else:
            path = Path(self.path.name)
        return SkippedLog(path, make_paths_relative(source, self.reason))


def find_containing_folder(path: Path) -> Path:
    """Return the path itself if it is a folder, else the folder that contains the file."""
    if path.is_dir():
        return path
    return path.parent


def make_paths_relative(source: Path, text: str) -> str:
    """Return a text with its file paths relative to the study's folder, or to the folder that contains a single log."""
    folder_prefix = os.fspath(find_containing_folder(source) / "_")[:-1]  # the folder's path with its separator
    return text.replace(folder_prefix, "")


def list_readable_logs(
    source: Path, read_metadata: Callable[[Path, Path], dict[str, str]] = lambda log, first: read_first_metadata(first)
) -> tuple[list[Path], list[SkippedLog]]:
    """Return the logs to read, in the order of their paths, and the logs to skip, each with its reason.

    Each session is listed once. A session in several segments is listed as its folder, so that they are read together.
    Of several logs of a session, the one in its regular place is listed. The logs of participants who withdrew are
    skipped.

    Args:
        source: a log, or a folder with logs at any depth.
        read_metadata: a function that returns a log's first metadata, given the log's path and its first file.

    Raises:
        LogError: if there is no such file or folder.
    """
    sessions, companions = _find_sessions(source)
    facts = {path: read_metadata(path, first) for path, first in sessions}
    withdrawn = _find_withdrawn_logs(facts)
    skipped = [SkippedLog(path, SYSTEM_COMPANION) for path in companions]
    skipped += _skip_copies({path: metadata for path, metadata in facts.items() if path not in withdrawn})
    skipped.sort(key=lambda log: log.path)
    if withdrawn:
        n_withdrawn = len({facts[path]["participant"] for path in withdrawn})
        participants = "1 participant" if n_withdrawn == 1 else f"{n_withdrawn} participants"
        skipped.append(SkippedLog(find_containing_folder(source), f"{participants} withdrew: excluded"))
    unread = withdrawn.union(log.path for log in skipped)
    return [path for path in facts if path not in unread], skipped


def _find_withdrawn_logs(facts: Mapping[Path, dict[str, str]]) -> set[Path]:
    """Find the logs of participants who withdrew; ``facts`` is each log's metadata."""
    find_withdrawn_codes = _make_withdrawn_code_finder()
    return {path for path, metadata in facts.items() if metadata.get("participant") in find_withdrawn_codes(path)}


def _skip_copies(facts: Mapping[Path, dict[str, str]]) -> Iterator[SkippedLog]:
    """Yield the copies to skip of each session that has several logs.

    The log in the session's regular place is not skipped; if there is none, the first one by path is not.
    """
    paths_by_session: dict[tuple[str, ...], list[Path]] = {}
    for path, metadata in facts.items():
        paths_by_session.setdefault(_find_session_key(metadata) or (str(path),), []).append(path)
    for paths in paths_by_session.values():
        first, *copies = sorted(paths, key=lambda path: (not _is_in_place(path, facts[path]), path))
        for path in copies:
            yield SkippedLog(path, f"{_name_session(facts[path])}, as is {first}; move one of them away")


def _make_withdrawn_code_finder() -> Callable[[Path], frozenset[str]]:
    """Return a function that finds the codes of the participants who withdrew from the study of a given log.

    The function caches the codes of each folder.
    """

    @cache
    def read_codes(folder: str, n_parents: int) -> frozenset[str]:
        """Read the withdrawn codes of a folder and of the ``n_parents`` folders above it."""
        parent = os.path.dirname(folder)
        files = (
            os.path.join(folder, ENROLMENT_FILE_NAME),
            os.path.join(parent, URL_FILE_NAME),
            os.path.join(parent, LEDGER_FILE_NAME),
        )
        if any(map(os.path.exists, files)):
            codes = read_withdrawn_codes(Path(folder))
        else:
            codes = frozenset()
        if n_parents:
            return codes | read_codes(parent, n_parents - 1)
        return codes

    def find_codes(log: Path) -> frozenset[str]:
        """Find the withdrawn codes of the folders in which the study of a log may lie."""
        folder = os.path.dirname(log)
        n_parents = _N_PARENTS
        if os.path.basename(folder).startswith("ses-"):  # only the folders above the participant's have enrolment logs
            folder = os.path.dirname(os.path.dirname(folder))
            n_parents -= 2
        if not os.path.isabs(folder):
            folder = os.path.abspath(folder)
        return read_codes(folder, n_parents)

    return find_codes


def list_participant_logs(source: Path, participant: str) -> list[Path]:
    """List the readable logs of one participant below a folder, reading only the first metadata of each log.

    Logs that are too damaged to name their participant are included.

    Raises:
        LogError: if the folder does not exist.
    """
    first_files = dict(_find_sessions(source)[0])
    codes = {
        path: read_first_metadata(first_files[path]).get("participant", "") for path in list_readable_logs(source)[0]
    }
    return [path for path, code in codes.items() if code in (participant, "")]


def list_other_sessions(log: SessionLog) -> list[Path]:
    """List the logs of the same participant's other sessions in the study, in the order of session number.

    The search covers the participant's folder if the log lies in its regular place, else the folder that contains the
    log.
    """
    folder = find_containing_folder(log.path).absolute()
    own = {"study": log.plan.study, "participant": log.plan.participant.id, "session": str(log.plan.session)}
    is_in_place = _is_in_place(folder, own)
    root = folder.parent if is_in_place else folder
    if not root.is_dir():
        return []
    sessions, _ = _find_sessions(root)
    if not is_in_place:
        prefix = f"{own['participant']}_"
        sessions = [(path, first) for path, first in sessions if first.name.startswith(prefix)]
    facts = {path: read_first_metadata(first) for path, first in sessions}
    path_by_session: dict[int, Path] = {}
    for path in sorted(facts, key=lambda path: (not _is_in_place(path, facts[path]), path)):
        study, participant, session = _find_session_key(facts[path]) or ("", "", "")
        is_of_participant = (study, participant) == (own["study"], own["participant"])
        if is_of_participant and session not in ("", own["session"]):
            path_by_session.setdefault(int(session), path)
    return [path_by_session[session] for session in sorted(path_by_session)]


def _find_sessions(source: Path) -> tuple[list[tuple[Path, Path]], list[Path]]:
    """Find a log, or all session logs below a folder, and the companion files that operating systems add to logs.

    Returns:
        The paths that ``open_log`` accepts, each with the first file of its session; and the companion files.

    Raises:
        LogError: if there is no such file or folder.
    """
    if source.is_file():
        return [(source, source)], []
    if not source.is_dir():
        raise LogError(f"{source} does not exist; name a session log or a folder of session logs")
    folders = sorted(find_log_folders(source), key=lambda folder: folder[0].parts)
    logs = []
    for folder, names in folders:
        for files in group_sessions(folder, names).values():
            first = files[0]
            path = first if len(files) == 1 else folder  # several segments are read as their folder
            logs.append((path, first))
    return logs, find_system_companions(folders)


def _find_session_key(facts: dict[str, str]) -> tuple[str, ...]:
    """Return the study, participant and session in a log's first metadata; an empty tuple if damage hides any."""
    session_key = tuple(facts.get(name, "") for name in ("study", "participant", "session"))
    if not all(session_key):
        return ()
    return session_key


def _is_in_place(path: Path, facts: dict[str, str]) -> bool:
    """Return whether a log has the regular folder and name of its session; ``facts`` is the log's first metadata."""
    folder = find_containing_folder(path)
    participant = facts.get("participant", "")
    session = f"ses-{facts.get('session', ''):0>2}"
    stem = _SEGMENT_ENDING.sub("", path.name)
    return folder.parts[-2:] == (participant, session) and (path == folder or stem == f"{participant}_{session}")


def _name_session(facts: dict[str, str]) -> str:
    return f"session {facts['session']} of {facts['participant']}, begun {facts.get('started_at', 'some time')}"


def map_logs(
    paths: Sequence[Path],
    work: Callable[[SessionLog], T],
    *,
    processes: int | None = None,
    engine: str = "local",
) -> Iterator[T | SkippedLog]:
    """Yield the result of ``work`` for each session in turn, in the manner of ``map_paths``.

    If a log cannot be read, or ``work`` raises LogError or ProtocolError, a `SkippedLog` is yielded in its place.
    """
    return map_paths(paths, partial(_read_and_work, work=work), processes=processes, engine=engine)


def map_paths(
    paths: Sequence[Path],
    work: Callable[[Path], T],
    *,
    processes: int | None = None,
    engine: str = "local",
    per_process: int = _MIN_LOGS_PER_PROCESS,
) -> Iterator[T]:
    """Yield the result of ``work`` for each log in order, working on several in parallel, here or in a Ray cluster.

    Only a few results are held in memory at a time.

    Args:
        paths: the paths of the logs.
        work: the function to call with each path; it and its results must be picklable.
        processes: the largest number of processes; by default the number of processors.
        engine: "local" for processes of this machine, or "ray" for a Ray cluster.
        per_process: the number of logs per process; one further process is started for each such number.

    Raises:
        LogError: if the engine is neither "local" nor "ray".
    """
    paths = list(paths)
    if engine == "ray":
        yield from _map_with_ray(paths, partial(_work_on_each, work=work))
        return
    if engine != "local":
        raise LogError(f"no engine is called {engine!r}; there are local and ray")
    n_processes = min(processes or count_processes(), len(paths) // per_process + 1)
    n_workers = n_processes - 1  # this process works, too
    if n_workers:
        yield from _map_with_workers(paths, work, n_workers)
    else:
        yield from map(work, paths)


def _map_with_workers(paths: list[Path], work: Callable[[Path], T], n_workers: int) -> Iterator[T]:
    """Yield the result of ``work`` for each log in order, working in this process and in ``n_workers`` others."""
    work_on_batch = partial(_work_on_each, work=work)
    with ProcessPoolExecutor(n_workers, get_context("spawn"), _prepare_worker, (work,)) as pool:
        pending: deque[_Batch[T]] = deque()
        for first in range(0, len(paths), _BATCH):
            batch = paths[first : first + _BATCH]
            pending.append((batch, pool.submit(work_on_batch, batch)))
            if len(pending) >= _AHEAD + 2 * n_workers:
                yield from _take_oldest_batch(pending, work_on_batch)
        while pending:
            yield from _take_oldest_batch(pending, work_on_batch)


def _map_with_ray(paths: list[Path], work_on_batch: Callable[[list[Path]], list[T]]) -> Iterator[T]:
    """Yield a result for each log in order; a Ray cluster, whose nodes share their files, works on batches of logs.

    The cluster is the one that RAY_ADDRESS names, or a local one with this machine's cores.
    """
    ray: Any = import_module("ray")  # an extra
    with ray.init(log_to_driver=False, logging_level=30):  # warnings
        work = ray.remote(num_cpus=1)(_work_in_folder)
        shared_function = ray.put(work_on_batch)  # sent to each node once
        ahead = 2 * int(ray.cluster_resources()["CPU"])
        waiting = deque[Any]()
        for first in range(0, len(paths), _RAY_BATCH):
            waiting.append(work.remote(shared_function, paths[first : first + _RAY_BATCH], Path.cwd()))
            if len(waiting) > ahead:
                yield from ray.get(waiting.popleft())
        while waiting:
            yield from ray.get(waiting.popleft())


def _work_in_folder(work_on_batch: Callable[[list[Path]], list[T]], paths: list[Path], folder: Path) -> list[T]:
    """Work on a batch of logs in another process, with ``folder`` as the working directory."""
    os.chdir(folder)  # paths may be relative
    with infrequent_collection():
        return work_on_batch(paths)


def _take_oldest_batch(pending: "deque[_Batch[T]]", work_on_batch: Callable[[list[Path]], list[T]]) -> list[T]:
    """Remove the oldest batch and return its results.

    Until it is done, work in this process on the newest batch that no other process has begun; if there is none, wait.
    """
    _, oldest = pending[0]
    while not oldest.done():
        index = _cancel_newest_batch(pending)
        if index is None:
            break
        batch, _ = pending[index]
        future = Future[list[T]]()
        future.set_result(work_on_batch(batch))
        pending[index] = (batch, future)
        _, oldest = pending[0]
    pending.popleft()
    return oldest.result()


def _cancel_newest_batch(pending: "deque[_Batch[T]]") -> int | None:
    """Cancel the newest batch that no process has begun; return its index, or None if all are begun or done."""
    for index in reversed(range(len(pending))):
        _, future = pending[index]
        if future.cancel():
            return index
    return None


def _prepare_worker(work: Callable[[Path], object]) -> None:
    """Make garbage collection rare in a worker process, and exempt the objects that exist at its start.

    ``work`` is not called. It is an argument because unpickling it imports all modules that the worker needs, before
    the objects of these modules are exempted.
    """
    gc.freeze()
    gc.set_threshold(*SELDOM)
    atexit.register(gc.unfreeze)  # otherwise C libraries report the frozen objects as leaks


def _work_on_each(paths: list[Path], work: Callable[[Path], T]) -> list[T]:
    return [work(path) for path in paths]


def _read_and_work(path: Path, work: Callable[[SessionLog], T]) -> T | SkippedLog:
    """Read a log and return the result of ``work``, or the reason why the log is skipped."""
    from minihuman.log.read.session_reader import read_log

    try:
        log = read_log(path)
        with raise_as_log_error(path):  # a log's content can be invalid in ways that only its use reveals
            return work(log)
    except (LogError, ProtocolError, OSError) as error:
        return SkippedLog(path, str(error))
