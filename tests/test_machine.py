"""What a machine lacks is left out of a run, and the run's last lines say how many tests that is and how to have it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.counts import PATIENCE_S

pytestmark = pytest.mark.program

ROOT = Path(__file__).parents[1]
TESTS = """
import pytest

from tests.machine import need, needs


@needs("chromium")
@pytest.mark.parametrize("number", range(70))
def test_of_seventy(number):
    need("chromium")


def test_that_comes_to_need_it():
    need("chromium")


def test_of_a_window(display):
    raise AssertionError("it is run where there is an X server alone")


@pytest.fixture
def display():
    need("xvfb")


def test_that_needs_nothing():
    pass
"""
MODULE = """
from tests.machine import need_module

need_module("validators")
"""


def run_pytest(folder: Path, *options: str, ci: bool = False) -> subprocess.CompletedProcess[str]:
    """Run tests on a machine that has no programs, and no validators."""
    (folder / "test_it.py").write_text(TESTS)
    (folder / "test_module.py").write_text(MODULE)
    (folder / "pytest.ini").write_text("[pytest]\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTEST_ADDOPTS": "", "PATH": str(folder)}
    for name in ("CI", "MINIHUMAN_STANDARDS"):
        environment.pop(name, None)
    if ci:
        environment["CI"] = "true"
    command = [sys.executable, "-m", "pytest", "-p", "tests.machine", *options]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)


@pytest.mark.parametrize("processes", ["-n0", "-n2"])
def test_what_is_missing_is_left_out_counted_and_named_with_what_to_install(tmp_path: Path, processes: str) -> None:
    done = run_pytest(tmp_path, processes)
    summary = done.stdout[done.stdout.index("left out on this machine") :].splitlines()
    assert summary[1:4] == [
        "70 tests left out, 1 test skipped for want of Chromium: apt-get install chromium",
        "1 test left out for want of the X server Xvfb: apt-get install xvfb",
        "1 module of tests left out for want of the validators of archives: .ci/run standards",
    ]
    assert "`.ci/run all`" in summary[4]
    assert "1 passed, 1 skipped" in summary[-1]
    assert done.returncode == 0


def test_in_ci_a_test_fails_without_what_ci_has(tmp_path: Path) -> None:
    done = run_pytest(tmp_path, "-n0", ci=True)
    assert done.returncode == 1
    assert "1 failed, 1 passed, 71 errors" in done.stdout
    assert "Chromium, missing here: apt-get install chromium" in done.stdout
    assert "1 module of tests left out for want of the validators of archives: .ci/run standards" in done.stdout


def test_where_nothing_is_missing_nothing_is_said(tmp_path: Path) -> None:
    done = run_pytest(tmp_path, "-n0", "test_it.py::test_that_needs_nothing")
    assert done.returncode == 0
    assert "left out" not in done.stdout
