"""No program outlives its test: whatever a test started ends with it, passed, failed, skipped, cut short or killed."""

import ast
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.counts import PATIENCE_S
from tests.programs import RUN_VARIABLE, Process, find_process, running, stop, wait_until_ended

pytestmark = pytest.mark.program

ROOT = Path(__file__).parents[1]
TESTS = """
import os
import signal
import subprocess

import pytest

from tests.programs import running


def start(name):
    command = ["sleep", "1000"]
    if name == "adopted":  # its parent ends at once, it is in a session of its own and its environment is empty
        command = ["sh", "-c", "setsid env -i sleep 1000 & echo $! > adopted.pid"]
        return subprocess.run(command, check=True)
    process = subprocess.Popen(command)
    with open(f"{name}.pid", "w") as file:
        file.write(str(process.pid))


def test_passes():
    start("passes")


def test_is_followed():
    pass


def test_fails():
    start("fails")
    assert False


def test_is_skipped():
    start("is_skipped")
    pytest.skip("for some reason")


def test_leaves_it_to_be_adopted():
    start("adopted")


@pytest.mark.timeout(2)
def test_takes_too_long():
    with running(["sleep", "1000"]) as process:
        with open("takes_too_long.pid", "w") as file:
            file.write(str(process.pid))
        process.wait()


@pytest.fixture(scope="module")
def server():
    with running(["sleep", "1000"]) as process:
        yield process
        process.terminate()


def test_a_fixture_of_the_module_starts_it(server):
    pass


def test_it_still_runs(server):
    assert server.poll() is None


@pytest.fixture(scope="module")
def forgetful():
    start("forgetful")


def test_a_fixture_of_the_module_forgets_it(forgetful):
    pass


@pytest.fixture(scope="module")
def servers():
    started = []
    yield started
    for process in started:
        process.kill()
        process.wait()


def test_leaves_it_to_a_fixture_of_the_module(servers):
    servers.append(subprocess.Popen(["sleep", "1000"]))


def test_finds_it_running(servers):
    assert servers[0].poll() is None


@pytest.fixture(scope="module")
def careless():
    yield


def test_leaves_it_to_a_careless_fixture(careless):
    start("careless")


def test_is_killed():
    start("is_killed")
    os.kill(os.getpid(), signal.SIGKILL)


def test_kills_the_run():
    start("kills_the_run")
    os.kill(os.getppid(), signal.SIGKILL)
    signal.pause()
"""
INI = "[pytest]\nmarkers = timeout\n"


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A folder with tests that leave programs running."""
    (tmp_path / "test_it.py").write_text(TESTS)
    (tmp_path / "pytest.ini").write_text(INI)
    return tmp_path


def run_pytest(folder: Path, *tests: str, processes: int = 0) -> subprocess.CompletedProcess[str]:
    """Run tests of a folder with the plug-in, as the project's own are run."""
    named = [f"test_it.py::test_{name}" for name in tests]
    plugins = ["-p", "tests.processes", "-n", str(processes), f"--timeout={PATIENCE_S}"]
    command = [sys.executable, "-m", "pytest", *plugins, "-v", *named]
    environment = {**os.environ, "PYTHONPATH": python_path(), "PYTEST_ADDOPTS": ""}
    environment.pop("PYTEST_XDIST_WORKER", None)
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)


def python_path() -> str:
    """Return where the plug-in is found, and whatever else is."""
    return os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))


def program_of(folder: Path, test: str) -> Process | None:
    """Return the program that a test started, unless it has ended."""
    return find_process(int((folder / f"{test}.pid").read_text()))


@pytest.mark.parametrize(
    ("test", "outcomes"),
    [
        ("passes", "2 passed, 1 error"),
        ("fails", "1 failed, 1 passed, 1 error"),
        ("is_skipped", "1 passed, 1 skipped, 1 error"),
    ],
)
def test_what_a_test_leaves_running_is_ended_and_named(suite: Path, test: str, outcomes: str) -> None:
    done = run_pytest(suite, test, "is_followed")
    assert program_of(suite, test) is None
    assert f"ERROR at teardown of test_{test}" in done.stdout
    assert "these were left running, and were ended:" in done.stdout
    assert "sleep 1000" in done.stdout
    assert outcomes in done.stdout


def test_what_was_left_to_be_adopted_is_ended_too(suite: Path) -> None:
    done = run_pytest(suite, "leaves_it_to_be_adopted")
    assert program_of(suite, "adopted") is None
    assert "ERROR at teardown of test_leaves_it_to_be_adopted" in done.stdout


def test_what_a_fixture_of_a_module_starts_lives_as_long_as_the_fixture(suite: Path) -> None:
    done = run_pytest(suite, "a_fixture_of_the_module_starts_it", "it_still_runs")
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout


def test_what_a_fixture_of_a_module_forgets_is_ended_when_the_module_is_done(suite: Path) -> None:
    done = run_pytest(suite, "a_fixture_of_the_module_forgets_it")
    assert program_of(suite, "forgetful") is None
    assert "ERROR at teardown of test_a_fixture_of_the_module_forgets_it" in done.stdout


def test_what_a_test_leaves_to_a_fixture_of_the_module_lives_as_long_as_the_fixture(suite: Path) -> None:
    done = run_pytest(suite, "leaves_it_to_a_fixture_of_the_module", "finds_it_running")
    assert "2 passed" in done.stdout
    assert done.returncode == 0


def test_what_the_fixture_does_not_end_is_ended_after_it_and_named_with_its_test(suite: Path) -> None:
    done = run_pytest(suite, "leaves_it_to_a_careless_fixture", "is_followed")
    assert program_of(suite, "careless") is None
    assert "sleep 1000 (started in test_it.py::test_leaves_it_to_a_careless_fixture)" in done.stdout


def test_a_program_ends_with_a_test_that_takes_too_long(suite: Path) -> None:
    done = run_pytest(suite, "takes_too_long")
    assert program_of(suite, "takes_too_long") is None
    assert "1 failed" in done.stdout
    assert "left running" not in done.stdout, "the block that ran it ended it"


@pytest.mark.parametrize(("test", "processes"), [("is_killed", 0), ("is_killed", 1), ("kills_the_run", 1)])
def test_a_program_ends_with_the_process_that_runs_its_test(suite: Path, test: str, processes: int) -> None:
    done = run_pytest(suite, test, processes=processes)
    assert done.returncode != 0
    if program := program_of(suite, test):
        assert wait_until_ended({program}, PATIENCE_S) == set()


def test_tests_in_a_test_are_ended_with_it(suite: Path) -> None:
    """The outer run is killed: its guardian ends the inner one, and what that started."""
    outer = (
        "import subprocess, sys\n"
        "def test_outer():\n"
        "    inner = ['-m', 'pytest', '-p', 'tests.processes', '-n0', 'test_it.py::test_waits']\n"
        "    subprocess.run([sys.executable, *inner])\n"
    )
    waits = "\n\ndef test_waits():\n    start('waits')\n    signal.pause()\n"
    (suite / "test_outer.py").write_text(outer)
    (suite / "test_it.py").write_text(TESTS + waits)
    command = [sys.executable, "-m", "pytest", "-p", "tests.processes", "-n0", "test_outer.py"]
    environment = {**os.environ, "PYTHONPATH": python_path(), "PYTEST_ADDOPTS": ""}
    with running(command, cwd=suite, env=environment, stdout=subprocess.DEVNULL) as pytest_run:
        deadline_s = time.monotonic() + PATIENCE_S
        while not (suite / "waits.pid").exists() or not (suite / "waits.pid").read_text():
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        program = program_of(suite, "waits")
        assert program is not None
        pytest_run.send_signal(signal.SIGKILL)
    assert wait_until_ended({program}, PATIENCE_S) == set()


def test_a_block_that_fails_ends_the_program_that_it_runs() -> None:
    with pytest.raises(ZeroDivisionError), running(["sleep", "1000"]) as process:
        _ = 1 / 0
    assert process.returncode == -signal.SIGTERM


def test_a_program_that_does_not_listen_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.programs.TERMINATE_S", 0.1)
    deaf = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); signal.pause()"
    process = subprocess.Popen([sys.executable, "-c", deaf], stdout=subprocess.PIPE)
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"deaf\n"
        stop(process)
    assert process.returncode == -signal.SIGKILL


def test_what_a_test_starts_belongs_to_its_run() -> None:
    with running(["printenv", RUN_VARIABLE], env={"PATH": os.environ["PATH"]}, stdout=subprocess.PIPE) as program:
        assert program.stdout is not None
        assert program.stdout.read().decode().strip() == os.environ[RUN_VARIABLE]


def blocks_of_programs() -> Iterator[str]:
    """Yield the places of tests with a `with subprocess.Popen`, which waits for ever where its block fails."""
    for path in sorted((ROOT / "tests").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            blocks = node.items if isinstance(node, ast.With) else []
            if any("subprocess.Popen(" in ast.unparse(block) for block in blocks):
                yield f"{path.relative_to(ROOT)}:{node.lineno}"


def test_no_block_waits_for_a_program_that_it_does_not_end() -> None:
    assert list(blocks_of_programs()) == [], "use tests.programs.running"
