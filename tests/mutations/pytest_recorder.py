"""A plug-in of pytest: writes each test's outcome and seconds, and tells coverage.py which test executes lines.

Works without the rest of this folder, so that the tests of another commit can be run with it. Fixtures of a wider scope
than a test are a context of their own: what they execute counts for every test that uses them. Processes that tests
start read their context from the environment.
"""

import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

RESULTS = "MINIHUMAN_MUTATION_RESULTS"  # the file of outcomes
CONTEXT = "MINIHUMAN_MUTATION_CONTEXT"  # of a child process's coverage
FIXTURE = "fixture "  # before a context that is no test

_context = ""


def _write(**row: object) -> None:
    with Path(os.environ[RESULTS]).open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def _switch_context(context: str) -> str:
    """Make lines count for a context; return the one before."""
    global _context
    before, _context = _context, context
    os.environ[CONTEXT] = context
    _tell_coverage()
    return before


def _tell_coverage() -> None:
    module = sys.modules.get("coverage")
    running = module.Coverage.current() if module is not None else None
    if running is not None:
        running.switch_context(_context)


os.register_at_fork(after_in_child=_tell_coverage)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Write that a test starts, then how long it took."""
    _write(event="start", test=item.nodeid, fixtures=list(getattr(item, "fixturenames", ())))
    before = _switch_context(item.nodeid)
    start = time.perf_counter()
    try:
        return (yield)
    finally:
        seconds = time.perf_counter() - start
        _switch_context(before)
        _write(event="end", test=item.nodeid, seconds=round(seconds, 4))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Write whatever did not pass."""
    if report.outcome != "passed":
        _write(event=report.outcome, test=report.nodeid)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Write which files could not be imported."""
    if report.failed:
        _write(event="failed", test=report.nodeid)


def pytest_unconfigure() -> None:
    """Write the CPU time of the run: of this process and of all that it waited for."""
    times = os.times()
    cpu_s = times.user + times.system + times.children_user + times.children_system
    _write(event="cpu", test="", seconds=round(cpu_s, 2))


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object], request: pytest.FixtureRequest) -> Iterator[None]:
    """Let a fixture that several tests share have a context of its own."""
    if fixturedef.scope == "function":
        return (yield)
    before = _switch_context(f"{FIXTURE}{fixturedef.baseid}::{fixturedef.argname}")
    try:
        return (yield)
    finally:
        _switch_context(before)
