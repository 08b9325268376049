"""Which tests execute a line: a run of the test files under coverage.py, and the questions to its record.

The record is a folder outside the repository. It holds a copy of the project, so that sources may change meanwhile,
and for each folder of tests and each kind (default, nightly) the coverage of each test, its seconds and its outcome.
The files of a folder run in one process, so a record that was broken off goes on with the folder at which it stopped.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import groupby
from pathlib import Path, PurePosixPath
from threading import Event

from tests.mutations import pytest_recorder
from tests.mutations.mutant import PACKAGE, ROOT, Mutant, MutationError
from tests.mutations.pytest_recorder import CONTEXT, FIXTURE, RESULTS

KINDS = ("default", "nightly")
MARKS = {"default": (), "nightly": ("-m", "nightly")}  # what pytest's own settings leave out of a default run
COMPILED = "minihuman/worlds/compiled"  # made by the installation, and ignored by git
OWN = "tests/mutations/"  # the tests of this folder say nothing about the package
OWNER = "MINIHUMAN_MUTATION_OWNER"  # in the environment of what a run starts: the process that asked for it
STOPPED = Event()
NO_TESTS = 5  # pytest's exit status where a file has none of the kind

# `core`: others know no contexts of tests. `patch`: processes that end without Python's end are measured, too.
SETTINGS = """\
[run]
include =
    {modules}
data_file = {data}
parallel = true
core = ctrace
context = ${{{context}}}
sigterm = true
patch =
    _exit
    fork
disable_warnings =
    no-data-collected
    module-not-measured
    module-not-imported
    couldnt-parse
"""


@dataclass
class RecordedTest:
    """A test of the record.

    Args:
        test: pytest's node ID.
        seconds: with coverage, its own fixtures included.
        fixtures: names of all fixtures it uses.
        outcome: "passed", "failed" or "skipped"; "started" if it did not end.
    """

    test: str
    seconds: float = 0.0
    fixtures: list[str] = field(default_factory=list)
    outcome: str = "started"

    @property
    def file(self) -> str:
        return self.test.partition("::")[0]

    @property
    def folder(self) -> str:
        return _folder_of(self.file)


@dataclass(frozen=True)
class FolderRun:
    """How the run of a folder's test files ended: pytest's exit status, None if out of time; and what it took."""

    status: int | None
    seconds: float
    cpu_s: float = 0.0

    @property
    def is_whole(self) -> bool:
        """Whether every test was tried: neither was pytest interrupted, nor could a file not be imported."""
        return self.status is None or self.status in (0, 1, NO_TESTS)


class Record:
    """A folder with the record of one state of the project."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.project = folder / "project"

    @classmethod
    def open(cls, folder: Path, root: Path = ROOT) -> "Record":
        """Return the record of a folder, or begin one with a copy of a project as it is now.

        Raises:
            MutationError: if the folder is in the repository.
        """
        folder = folder.absolute()
        if folder.is_relative_to(ROOT):
            raise MutationError(f"{folder} is inside the repository; give a folder outside it")
        record = cls(folder)
        if not (folder / "commit").exists():
            shutil.rmtree(record.project, ignore_errors=True)
            copy_project(root, record.project)
            (folder / "commit").write_text(read_commit(root), encoding="utf-8")
        return record

    @property
    def commit(self) -> str:
        """The commit that was copied, "+" behind it if files differed from it."""
        return (self.folder / "commit").read_text(encoding="utf-8")

    def test_files(self, paths: Sequence[str] = ()) -> list[str]:
        """Return the test files of the copy, all or those at paths in it."""
        files = sorted(path.relative_to(self.project).as_posix() for path in self.project.glob("tests/**/test_*.py"))
        wanted = tuple(path.rstrip("/") for path in paths)
        return [
            file
            for file in files
            if not file.startswith(OWN)
            and (not wanted or file in wanted or any(file.startswith(f"{path}/") for path in wanted))
        ]

    def ended(self, kind: str, folder: str) -> FolderRun | None:
        """Return how the recorded run of a folder's test files ended; None if there is none."""
        try:
            return FolderRun(**json.loads((self._place(kind, folder) / "ended.json").read_text(encoding="utf-8")))
        except FileNotFoundError:
            return None

    def measure(
        self, kind: str, folder: str, files: Sequence[str], most_s: float, modules: Sequence[str] = ()
    ) -> FolderRun:
        """Run the test files of a folder under coverage, and keep what they executed.

        Args:
            kind: of tests, "default" or "nightly".
            folder: of the files, by its path in the project.
            files: paths in the project.
            most_s: seconds that they may take.
            modules: of the package that are measured, by their paths in it; all without any.
        """
        place = self._place(kind, folder)
        shutil.rmtree(place, ignore_errors=True)
        (place / "raw").mkdir(parents=True)
        settings = place / "coveragerc"
        package = self.project / PACKAGE
        measured = "\n    ".join(str(package / module) for module in modules or ["*"])
        settings.write_text(
            SETTINGS.format(modules=measured, data=place / "raw" / ".coverage", context=CONTEXT), encoding="utf-8"
        )
        environment = {"COVERAGE_PROCESS_START": str(settings), CONTEXT: ""}
        run = run_pytest(
            self.project, [*MARKS[kind], "-o", f"cache_dir={place / 'cache'}", *files], place, most_s, environment
        )
        _combine(place)
        for name in ("raw", "cache"):
            shutil.rmtree(place / name, ignore_errors=True)
        if run.is_whole:
            (place / "ended.json").write_text(json.dumps(asdict(run)) + "\n", encoding="utf-8")
        return run

    def read_tests(self, kind: str) -> dict[str, RecordedTest]:
        """Return the recorded tests of a kind."""
        tests: dict[str, RecordedTest] = {}
        for path in sorted((self.folder / kind).glob("*/tests.jsonl")):
            tests |= read_tests(path)
        return tests

    def executing(self, kind: str, mutant: Mutant) -> list[RecordedTest]:
        """Return the tests that passed and executed the place of a mutant, the cheapest first."""
        source = (self.project / PACKAGE / mutant.file).read_text(encoding="utf-8")
        lines = mutant.executed_lines(source)
        contexts = self._contexts(kind, mutant.file, lines)
        fixtures = {context for _, context in contexts if context.startswith(FIXTURE)}
        tests = [
            test
            for test in self._tests[kind].values()
            if test.outcome == "passed"
            and ((test.folder, test.test) in contexts or (test.folder, "") in contexts or _uses(test, fixtures))
        ]
        return sorted(tests, key=lambda test: test.seconds)

    @cached_property
    def _tests(self) -> dict[str, dict[str, RecordedTest]]:
        return {kind: self.read_tests(kind) for kind in KINDS}

    def _contexts(self, kind: str, module: str, lines: range) -> set[tuple[str, str]]:
        """Return which context of which folder of tests executed one of the lines."""
        from coverage import CoverageData

        contexts: set[tuple[str, str]] = set()
        path = str(self.project / PACKAGE / module)
        for measured in sorted((self.folder / kind).glob("*/coverage.sqlite")):
            folder = measured.parent.name.replace("+", "/")
            coverage = CoverageData(str(measured))
            coverage.read()
            by_line = coverage.contexts_by_lineno(path)
            contexts |= {(folder, context) for line in lines for context in by_line.get(line, ())}
            coverage.close()
        return contexts

    def _place(self, kind: str, folder: str) -> Path:
        return self.folder / kind / folder.replace("/", "+")


def record_all(
    record: Record, kind: str, files: Iterable[str], *, workers: int, most_s: float, modules: Sequence[str] = ()
) -> Iterator[str]:
    """Measure the folders of test files that were not measured yet; yield a line for each as it ends."""
    folders = {folder: list(group) for folder, group in groupby(sorted(files, key=_folder_of), key=_folder_of)}
    missing = [folder for folder in folders if record.ended(kind, folder) is None]
    with ThreadPoolExecutor(workers) as pool:
        runs = pool.map(
            lambda folder: (folder, record.measure(kind, folder, folders[folder], most_s, modules)), missing
        )
        for number, (folder, run) in enumerate(runs, 1):
            status = "out of time" if run.status is None else f"exit status {run.status}"
            yield f"{number}/{len(missing)} {folder}: {status}, {run.seconds:.1f} s, CPU {run.cpu_s:.1f} s"


def run_pytest(
    project: Path, arguments: Sequence[str], place: Path, most_s: float, environment: dict[str, str] | None = None
) -> FolderRun:
    """Run pytest in a copy of a project, in one process, with outcomes in `place`/tests.jsonl.

    What the tests started and left running is ended, too.

    Raises:
        MutationError: if the command was stopped meanwhile.
    """
    plugin = place / "plugin"
    plugin.mkdir(exist_ok=True)
    shutil.copy(pytest_recorder.__file__, plugin / "minihuman_recorder.py")
    marker = str(place / "tests.jsonl")
    variables = os.environ | {"PYTHONPATH": f"{project}{os.pathsep}{plugin}", RESULTS: marker, OWNER: str(os.getpid())}
    variables |= environment or {}
    command = [sys.executable, "-m", "pytest", "-n0", "-q", "-p", "minihuman_recorder", *arguments]
    start = time.perf_counter()
    with (place / "output.txt").open("wb") as output:
        process = subprocess.Popen(command, cwd=project, env=variables, stdout=output, stderr=subprocess.STDOUT)
        try:
            status = process.wait(most_s)
        except subprocess.TimeoutExpired:
            status = None
            process.terminate()  # coverage writes what it has
            _wait(process, 20)
        finally:
            end_processes(f"{RESULTS}={marker}")
            process.wait()
    if STOPPED.is_set():
        raise MutationError("stopped; the same command goes on where it was")
    return FolderRun(status, round(time.perf_counter() - start, 2), _read_cpu_s(place / "tests.jsonl"))


def stop(*_: object) -> None:
    """End all runs of this process: a signal's handler."""
    STOPPED.set()
    end_processes(f"{OWNER}={os.getpid()}")


def end_processes(variable: str) -> None:
    """Kill the processes whose environment has a variable; on Linux alone, where /proc says so."""
    for environ in Path("/proc").glob("[0-9]*/environ"):
        try:
            if variable.encode() in environ.read_bytes().split(b"\0"):
                os.kill(int(environ.parent.name), signal.SIGKILL)
        except (OSError, ProcessLookupError):
            continue  # of another user, or ended


def read_tests(path: Path) -> dict[str, RecordedTest]:
    """Return the tests that a run wrote down, by node ID, in the order in which they started."""
    tests: dict[str, RecordedTest] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        row = json.loads(line)
        if row["event"] == "cpu":
            continue
        test = tests.setdefault(row["test"], RecordedTest(row["test"]))
        match row["event"]:
            case "start":
                test.fixtures = row["fixtures"]
            case "end":
                test.seconds = row["seconds"]
                test.outcome = "passed" if test.outcome == "started" else test.outcome
            case "failed" | "skipped" as outcome:
                test.outcome = outcome
    return tests


def _read_cpu_s(path: Path) -> float:
    """Return the CPU time that pytest wrote at its end; 0 if it was killed."""
    rows = map(json.loads, path.read_text(encoding="utf-8").splitlines()) if path.exists() else ()
    return sum(row["seconds"] for row in rows if row["event"] == "cpu")


def copy_project(root: Path, target: Path) -> None:
    """Copy what git knows or would add, and the compiled kernels."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        source, copy = root / name, target / name
        if source.is_file():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, copy, follow_symlinks=False)
    if (root / COMPILED).is_dir():
        shutil.copytree(root / COMPILED, target / COMPILED, dirs_exist_ok=True)


def read_commit(root: Path) -> str:
    """Return the short name of a checkout's commit, with "+" if tracked files differ from it."""
    command = ["git", "describe", "--always", "--exclude=*", "--abbrev=8", "--dirty=+"]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout.strip()


def _combine(place: Path) -> None:
    """Make one file of what the processes of a run measured."""
    from coverage import CoverageData
    from coverage.exceptions import DataError

    combined = CoverageData(str(place / "coverage.sqlite"))
    for path in sorted((place / "raw").iterdir()):
        part = CoverageData(str(path))
        try:
            part.read()
            combined.update(part)
        except DataError:
            continue  # of a process that was killed as it wrote
        finally:
            part.close()
    combined.write()
    combined.close()


def _uses(test: RecordedTest, fixtures: set[str]) -> bool:
    """Whether a test uses one of the wider fixtures, each named by where it is defined and its name."""
    return any(f"{FIXTURE}{base}::{name}" in fixtures for base in _bases(test.test) for name in test.fixtures)


def _bases(test: str) -> list[str]:
    """Return where fixtures that a test sees may be defined: its classes, its file, folders, plug-ins."""
    file, *inner = test.partition("[")[0].split("::")
    classes = ["::".join([file, *inner[:count]]) for count in range(len(inner))]
    return [*classes, *(str(parent) if str(parent) != "." else "" for parent in Path(file).parents), "."]


def _folder_of(file: str) -> str:
    return PurePosixPath(file).parent.as_posix()


def _wait(process: subprocess.Popen[bytes], seconds: float) -> None:
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.kill()
