"""Programs that tests start: each ends with the block that runs it, and all of them with the process that runs tests.

Run as a script, this is the guardian: `python programs.py PID RUN` waits until that process has ended, however it did,
and then ends every process of the run. It imports the standard library alone, so that a guardian starts in 20 ms.
"""

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

RUN_VARIABLE = "MINIHUMAN_TEST_RUN"  # in the environment of all that a test starts: the runs that it belongs to
TERMINATE_S = 10.0  # in which a program that was asked to end has ended
KILL_S = 60.0


class Process(NamedTuple):
    """A process; its start tells it from a later one with the same number."""

    pid: int
    start_ticks: int

    def is_alive(self) -> bool:
        """Whether it is there and has not ended."""
        stat = _read_stat(self.pid)
        return stat is not None and stat[0] != "Z" and stat[1] == self.start_ticks

    def command_line(self) -> str:
        """Its words; empty once it has ended."""
        with suppress(OSError):
            return Path(f"/proc/{self.pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
        return ""


def find_process(pid: int) -> Process | None:
    """Return the process of that number, unless it has ended."""
    stat = _read_stat(pid)
    return None if stat is None or stat[0] == "Z" else Process(pid, stat[1])


def _read_stat(pid: int) -> tuple[str, int] | None:
    """Return the state of a process and when it started; None where it is gone."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return words[0], int(words[19])


def find_children(pid: int) -> set[Process]:
    """Return the processes that a process started, or adopted, and that have not ended."""
    children = set()
    with suppress(OSError):  # a process or a thread that ended meanwhile
        for task in os.listdir(f"/proc/{pid}/task"):
            with suppress(OSError), open(f"/proc/{pid}/task/{task}/children") as listed:
                children |= {find_process(int(word)) for word in listed.read().split()}
    return {child for child in children if child is not None}


def find_descendants(pid: int) -> set[Process]:
    """Return a process's children, their children, and so on."""
    descendants = set()
    for child in find_children(pid):
        descendants |= {child} | find_descendants(child.pid)
    return descendants


def find_run(run: str) -> set[Process]:
    """Return the processes with a run in their environment, and all that these started; this one left out."""
    processes = set()
    for folder in Path("/proc").glob("[0-9]*"):
        pid = int(folder.name)
        with suppress(OSError):
            variables = (folder / "environ").read_bytes().split(b"\0")
            runs = [words.partition(b"=")[2] for words in variables if words.startswith(f"{RUN_VARIABLE}=".encode())]
            if pid != os.getpid() and any(run.encode() in names.split(b"/") for names in runs):
                process = find_process(pid)
                processes |= find_descendants(pid) | ({process} if process else set())
    return {process for process in processes if process.pid != os.getpid()}


def end_processes(processes: set[Process]) -> None:
    """Ask processes to end; kill those that have not ended in time."""
    for number, patience_s in ((signal.SIGTERM, TERMINATE_S), (signal.SIGKILL, KILL_S)):
        for process in processes:
            if process.is_alive():
                with suppress(ProcessLookupError):
                    os.kill(process.pid, number)
        if not wait_until_ended(processes, patience_s):
            return


def wait_until_ended(processes: set[Process], patience_s: float) -> set[Process]:
    """Wait until processes have ended; those that have not in time."""
    deadline_s = time.monotonic() + patience_s
    pause_s = 0.001
    while (alive := {process for process in processes if process.is_alive()}) and time.monotonic() < deadline_s:
        time.sleep(pause_s)
        pause_s = min(2 * pause_s, 0.1)
    return alive


@contextmanager
def running(command: Sequence[str | Path], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Run a program for as long as a block does. A block that ends well waits for it; one that fails ends it.

    ``with subprocess.Popen(...)`` waits in both cases: for ever, where an assertion fails before it is told to stop.
    """
    if options.get("env") is not None:  # whatever else it is not to know, it belongs to this run
        options["env"] = {RUN_VARIABLE: os.environ.get(RUN_VARIABLE, ""), **options["env"]}
    program = subprocess.Popen(command, **options)
    with ended_with_block(program) as process:
        yield process


Program = TypeVar("Program", bound=Any)  # a `subprocess.Popen`, or what can be used as one


@contextmanager
def ended_with_block(process: Program) -> Iterator[Program]:
    """Wait for a program at the end of a block that ends well; end it at the end of one that fails."""
    try:
        yield process
    except BaseException:
        stop(process)
        raise
    finally:
        with process:  # closes its streams
            pass


def stop(process: Any) -> None:
    """End a program, and wait until it has ended."""
    process.terminate()
    try:
        process.wait(TERMINATE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def guard(pid: int, run: str) -> None:
    """Wait until a process has ended; then end whatever is left of its run."""
    for number in (signal.SIGINT, signal.SIGHUP):  # which a terminal sends to everything in it
        signal.signal(number, signal.SIG_IGN)
    with suppress(ProcessLookupError):
        watched = os.pidfd_open(pid)
        if os.getppid() == pid:  # else it had ended before, and its number may be another's
            select.select([watched], [], [])
    while left := find_run(run):
        end_processes(left)


if __name__ == "__main__":
    guard(int(sys.argv[1]), sys.argv[2])
