"""A pytest plug-in: no process outlives the test that started it, or the widest fixture that did.

Each process that runs tests adopts what its descendants leave behind (a child subreaper), so that whatever a test
started is below it. After each test, what no fixture that is still in use could end is ended, and the test has an error
that names it. When a process that runs tests is itself killed, its guardian ends what it started.
"""

import ctypes
import inspect
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

Fixture = pytest.FixtureDef[Any]
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
    """Knows which processes are there, and which fixtures may end them."""

    def __init__(self) -> None:
        self._known = find_descendants(os.getpid())  # started before any test
        self._owners: dict[Process, list[Fixture]] = {}
        self._starters: dict[Process, str] = {}  # the tests that started what was left to fixtures
        self._in_use: set[Fixture] = set()

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Fixture) -> Generator[None, object, object]:
        """Note what a fixture of a module, a class or the session starts."""
        if fixturedef.scope == "function":
            return (yield)
        before = find_descendants(os.getpid())
        self._in_use.add(fixturedef)
        try:
            return (yield)
        finally:
            for process in find_descendants(os.getpid()) - before:
                self._owners.setdefault(process, [fixturedef])

    def pytest_fixture_post_finalizer(self, fixturedef: Fixture) -> None:
        """Note that a fixture is no longer in use."""
        self._in_use.discard(fixturedef)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> Generator[None, None, None]:
        """When a test's fixtures are gone, end what it left running and say so."""
        owners = find_owners(item)
        try:
            yield
        except BaseException:
            end_processes(self._find_strays(owners, item.nodeid))
            raise
        strays = wait_until_ended(self._find_strays(owners, item.nodeid), _GRACE_S)
        if strays:
            lines = sorted(self._describe(process, item.nodeid) for process in strays)
            end_processes(strays)
            pytest.fail("these were left running, and were ended:\n" + "\n".join(lines), pytrace=False)

    def _find_strays(self, owners: list[Fixture], test: str) -> set[Process]:
        """Return what no fixture that is in use may end; what has no owner yet is left to some."""
        alive = find_descendants(os.getpid()) - self._known - _KEPT
        if alive:
            alive -= find_helpers()
            alive -= self._find_started_by_others()
        for process in alive - self._owners.keys():
            self._owners[process] = owners
            self._starters[process] = test
        return {process for process in alive if self._in_use.isdisjoint(self._owners[process])}

    def _find_started_by_others(self) -> set[Process]:
        """Return what programs started that no test is to end: a server's workers, a browser's pages."""
        programs = set(_KEPT)
        for process, owners in self._owners.items():
            if not self._in_use.isdisjoint(owners):
                programs.add(process)
        return set().union(*(find_descendants(process.pid) for process in programs))

    def _describe(self, process: Process, test: str) -> str:
        return f"{process.pid} {process.command_line()} (started in {self._starters.get(process, test)})"


def find_helpers() -> set[Process]:
    """Return Python's own helpers among the children of this process."""
    children = find_children(os.getpid())
    return {child for child in children if any(words in child.command_line() for words in _HELPERS)}


def find_owners(item: pytest.Item) -> list[Fixture]:
    """Return the fixtures of a test's class, module or package that could end what the test starts: they tear down."""
    named = item._fixtureinfo.name2fixturedefs  # pytest's own; without it, nothing is left to fixtures
    fixtures = [fixture for fixtures in named.values() for fixture in fixtures]
    scopes = ("class", "module", "package")
    return [one for one in fixtures if one.scope in scopes and inspect.isgeneratorfunction(one.func)]


def pytest_configure(config: pytest.Config) -> None:
    """Before anything is started: mark the run, set a guardian, adopt what descendants leave behind, and watch."""
    if sys.platform != "linux":
        return
    run = uuid.uuid4().hex
    os.environ[RUN_VARIABLE] = "/".join(filter(None, (os.environ.get(RUN_VARIABLE), run)))
    start_guardian(run)
    adopt_descendants()
    config.pluginmanager.register(ProcessWatch(), "process-watch")


def adopt_descendants() -> None:
    """Let this process become the parent of what its descendants leave behind."""
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl cannot make this process adopt what its descendants leave behind")


def start_guardian(run: str) -> None:
    """Start the process that ends what is left of a run when this one has ended, however it does."""
    script = str(Path(programs.__file__))
    command = [sys.executable, "-I", "-S", script, str(os.getpid()), run]
    silent = [(os.POSIX_SPAWN_OPEN, stream, os.devnull, os.O_RDWR, 0) for stream in (0, 1, 2)]
    os.posix_spawn(sys.executable, command, os.environ, file_actions=silent, setsid=True)
