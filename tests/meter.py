"""Counts what each test costs: the CPU time of its process and of all that it started, browsers and servers too.

Every run prints its total and the cost of collecting; ``--meter`` names the dearest tests and files,
``--meter-file FILE`` writes a line of JSON for each test. Times are CPU seconds: a busy machine changes how long a test
takes, not what it costs.
"""

import json
import os
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

_TICKS_PER_S = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100
_DEAREST = 25  # tests that are named
_DEAR_S = 0.5  # what costs less is not
_PROPERTY = "cost"  # by which a worker tells the controller


def measure_cpu_s() -> float:
    """Return the CPU seconds of this process, its living descendants, and those that ended and were waited for."""
    times = os.times()
    total_s = times.user + times.system + times.children_user + times.children_system
    waiting = _list_children(os.getpid())
    while waiting:
        process = waiting.pop()
        total_s += _read_cpu_s(process)
        waiting += _list_children(process)
    return total_s


def _list_children(process: int) -> list[int]:
    children: list[int] = []
    try:
        for thread in os.listdir(f"/proc/{process}/task"):
            children += map(int, Path(f"/proc/{process}/task/{thread}/children").read_text().split())
    except OSError:  # it has ended, or this system has no such folder
        pass
    return children


def _read_cpu_s(process: int) -> float:
    try:
        stat = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return 0.0
    fields = stat.rpartition(")")[2].split()  # the name before it may hold blanks
    return sum(map(int, fields[11:15])) / _TICKS_PER_S  # user and system, of it and of the children it waited for


@dataclass(eq=False)  # pytest wants plug-ins hashable
class RunMeter:
    """What a run cost: a plug-in of every process of it, of which the controller prints."""

    file: Path | None
    names_dearest: bool
    tests: dict[str, tuple[float, float]] = field(default_factory=dict)  # CPU and wall seconds
    collecting_s: float = 0.0
    workers_s: float = 0.0

    @pytest.hookimpl(trylast=True)
    def pytest_collection_finish(self) -> None:
        """Note what importing and collecting the tests cost."""
        self.collecting_s = measure_cpu_s()

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Tell the controller what a worker cost."""
        output = getattr(session.config, "workeroutput", None)
        if output is not None:
            output[_PROPERTY] = (self.collecting_s, measure_cpu_s())

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Note what a worker cost."""
        collecting_s, total_s = getattr(node, "workeroutput", {}).get(_PROPERTY, (0.0, 0.0))
        self.collecting_s = max(self.collecting_s, collecting_s)
        self.workers_s += total_s

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note what a test cost, where each is measured."""
        costs = dict(report.user_properties).get(_PROPERTY)
        if report.when == "teardown" and costs is not None:
            self.tests[report.nodeid] = tuple(costs)

    def pytest_terminal_summary(self, terminalreporter: "pytest.TerminalReporter") -> None:
        """Print what the run cost, and the dearest tests where they are asked for."""
        total_s = self.workers_s + _measure_own_s() if self.workers_s else measure_cpu_s()
        terminalreporter.write_line(
            f"{total_s:.0f} CPU seconds, {self.collecting_s:.1f} of them in each process until the tests were collected"
        )
        if self.names_dearest:
            self._print_dearest(terminalreporter)
        if self.file is not None:
            with self.file.open("w", encoding="utf-8") as lines:
                for name, (cpu_s, wall_s) in self.tests.items():
                    lines.write(json.dumps({"test": name, "cpu_s": round(cpu_s, 3), "wall_s": round(wall_s, 3)}) + "\n")

    def _print_dearest(self, terminalreporter: "pytest.TerminalReporter") -> None:
        terminalreporter.section("CPU seconds of the dearest tests")
        dear = [(name, cost) for name, cost in self.tests.items() if cost[0] >= _DEAR_S]
        for name, (cpu_s, wall_s) in sorted(dear, key=lambda test: -test[1][0])[:_DEAREST]:
            terminalreporter.write_line(f"{cpu_s:8.1f}  {name} ({wall_s:.1f} s of wall time)")
        of_files: defaultdict[str, float] = defaultdict(float)
        for name, (cpu_s, _) in self.tests.items():
            of_files[name.partition("::")[0]] += cpu_s
        terminalreporter.section("CPU seconds of the dearest files")
        for name, cpu_s in sorted(of_files.items(), key=lambda file: -file[1])[:_DEAREST]:
            terminalreporter.write_line(f"{cpu_s:8.1f}  {name}")


def _measure_own_s() -> float:
    """Return the CPU seconds of this process alone: workers tell their own, and are its children too."""
    times = os.times()
    return times.user + times.system


class TestMeter:
    """Measures each test where it runs."""

    __test__ = False

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        """Begin to measure."""
        item.stash[_START] = measure_cpu_s(), time.monotonic()
        return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> Iterator[None]:
        """Note the cost where the report of the teardown takes it."""
        try:
            return (yield)
        finally:
            start_cpu_s, start_s = item.stash[_START]
            item.user_properties.append((_PROPERTY, (measure_cpu_s() - start_cpu_s, time.monotonic() - start_s)))


_START = pytest.StashKey[tuple[float, float]]()


def add_option(parser: pytest.Parser) -> None:
    """Add ``--meter`` and ``--meter-file``."""
    parser.addoption("--meter", action="store_true", help="print the CPU seconds of the dearest tests")
    parser.addoption("--meter-file", type=Path, help="write what every test cost to this file, a line of JSON each")


def register(config: pytest.Config) -> None:
    """Measure this run, and each test if that is asked for."""
    file, names_dearest = config.getoption("meter_file"), config.getoption("meter")
    config.pluginmanager.register(RunMeter(file, names_dearest), "run-meter")
    if names_dearest or file is not None:
        config.pluginmanager.register(TestMeter(), "test-meter")
