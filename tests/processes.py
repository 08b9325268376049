"""A pytest plug-in: no process outlives the test that started it, or the widest fixture that did.

Each process that runs tests adopts what its descendants leave behind (a child subreaper), so that whatever a test
started is below it. After each test, what is still alive and belongs to no fixture that is still in use is ended, and
the test has an error that names it. When a process that runs tests is itself killed, its guardian ends them.
"""

import ctypes
import os
import sys
import uuid
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests import programs
from tests.counts import count
from tests.programs import RUN_VARIABLE, Process, end_processes, find_children, find_descendants, wait_until_ended

# How long a test may take, where pytest-timeout is installed: whatever it waits for has come by then or never comes.
TIMEOUT_S = count(1_800, 12 * 3_600)
os.environ.setdefault("PYTEST_TIMEOUT", str(TIMEOUT_S))

_PR_SET_CHILD_SUBREAPER = 36  # <linux/prctl.h>
_GRACE_S = 5.0  # a process that was told to end may be about to
# Python's own, which end with this process; their command lines are what breaks if it starts them another way.
_HELPERS = ("from multiprocessing.forkserver import main", "from multiprocessing.resource_tracker import main")
_KEPT: set[Process] = set()  # of which no test is the owner


@contextmanager
def kept_for_the_run() -> Iterator[None]:
    """Let what starts within the block run until the run's end: a browser that tests share."""
    before = find_descendants(os.getpid())
    try:
        yield
    finally:
        _KEPT.update(find_descendants(os.getpid()) - before)


class ProcessWatch:
    """Knows which processes are there, and which fixture started them."""

    def __init__(self) -> None:
        self._known = find_descendants(os.getpid())  # started before any test
        self._owners: dict[Process, pytest.FixtureDef[Any]] = {}
        self._in_use: set[pytest.FixtureDef[Any]] = set()

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Generator[None, object, object]:
        """Note what a fixture of a module, a class or the session starts."""
        if fixturedef.scope == "function":
            return (yield)
        before = find_descendants(os.getpid())
        self._in_use.add(fixturedef)
        try:
            return (yield)
        finally:
            for process in find_descendants(os.getpid()) - before:
                self._owners.setdefault(process, fixturedef)

    def pytest_fixture_post_finalizer(self, fixturedef: pytest.FixtureDef[Any]) -> None:
        """Note that a fixture is no longer in use."""
        self._in_use.discard(fixturedef)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_teardown(self) -> Generator[None, None, None]:
        """When a test's fixtures are gone, end what it left running and say so."""
        try:
            yield
        except BaseException:
            end_processes(self._find_strays())
            raise
        strays = wait_until_ended(self._find_strays(), _GRACE_S)
        if strays:
            lines = sorted(f"{process.pid} {process.command_line()}" for process in strays)
            end_processes(strays)
            pytest.fail("the test left running, and it was ended:\n" + "\n".join(lines), pytrace=False)

    def _find_strays(self) -> set[Process]:
        owned = {process for process, fixturedef in self._owners.items() if fixturedef in self._in_use}
        helpers = {
            process
            for process in find_children(os.getpid())
            if any(words in process.command_line() for words in _HELPERS)
        }
        beside = self._known | owned | helpers | _KEPT
        started_by_these = [find_descendants(process.pid) for process in beside]
        return find_descendants(os.getpid()) - beside.union(*started_by_these)


def pytest_configure(config: pytest.Config) -> None:
    """Before anything is started: mark the run, set a guardian, adopt what descendants leave behind, and watch."""
    if sys.platform != "linux":
        return
    run = uuid.uuid4().hex
    os.environ[RUN_VARIABLE] = "/".join(filter(None, (os.environ.get(RUN_VARIABLE), run)))
    start_guardian(run)
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl cannot make this process adopt what its descendants leave behind")
    config.pluginmanager.register(ProcessWatch(), "process-watch")


def start_guardian(run: str) -> None:
    """Start the process that ends what is left of a run when this one has ended, however it does."""
    script = str(Path(programs.__file__))
    command = [sys.executable, "-I", "-S", script, str(os.getpid()), run]
    silent = [(os.POSIX_SPAWN_OPEN, stream, os.devnull, os.O_RDWR, 0) for stream in (0, 1, 2)]
    os.posix_spawn(sys.executable, command, os.environ, file_actions=silent, setsid=True)
