"""Trials of mutants: each in a copy of the project, with the tests that execute its place, until one fails.

A test kills a mutant if it fails with it, fails again alone, and passes without it; a test that fails for another
reason is left out.
"""

import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

from tests.mutations.execution import MARKS, NO_TESTS, Record, RecordedTest, copy_project, read_tests, run_pytest
from tests.mutations.mutant import PACKAGE, Mutant

FIRST_FILES = 4  # of the first run of tests; each further one has twice as many files
FILE_S = 3.0  # what a test file costs besides its tests
PATIENCE = 20  # how many times as long as recorded tests may take
LEAST_S = 300.0


@dataclass(frozen=True)
class Verdict:
    """What tests said of a mutant.

    Args:
        killed: whether a test noticed it; None if it could not be asked.
        test: the one that did, or why none could be asked.
        n_tests: how many execute its place; 0 where files were named instead.
        seconds: until it was known.
    """

    killed: bool | None
    test: str
    n_tests: int
    seconds: float


@dataclass(frozen=True)
class Batch:
    """Tests that one process of pytest runs.

    Args:
        arguments: node IDs or paths.
        marks: options of pytest that choose the kind.
        seconds: what they took when they were recorded.
    """

    arguments: tuple[str, ...]
    marks: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def most_s(self) -> float:
        return LEAST_S + PATIENCE * self.seconds

    def without(self, test: str) -> "Batch":
        """Return the batch without a test; where whole files were asked, pytest leaves it out."""
        if test in self.arguments:
            return replace(self, arguments=tuple(argument for argument in self.arguments if argument != test))
        return replace(self, marks=(*self.marks, "--deselect", test))


class Trial:
    """A copy of a project with one mutant in it, beside the project without it."""

    def __init__(self, project: Path, mutant: Mutant, folder: Path) -> None:
        self._project = project
        self._copy = folder / "project"
        self._folder = folder
        self._n_runs = 0
        shutil.copytree(project, self._copy, symlinks=True)
        path = self._copy / PACKAGE / mutant.file
        path.write_text(mutant.mutate(path.read_text(encoding="utf-8")), encoding="utf-8")

    def find_killer(self, batches: Iterable[Batch]) -> str:
        """Return the first test that notices the mutant; empty if none does."""
        for batch in batches:
            killer = self._try(batch)
            if killer:
                return killer
        return ""

    def _try(self, batch: Batch) -> str:
        while batch.arguments:
            failed = self._failing(self._copy, batch)
            if not failed:
                return ""
            alone = replace(batch, arguments=(failed,))
            if self._failing(self._copy, alone) and not self._failing(self._project, alone):
                return failed
            batch = batch.without(failed)
        return ""

    def _failing(self, project: Path, batch: Batch) -> str:
        """Return the first test of a batch that fails or hangs, the first argument if no test began; else empty."""
        self._n_runs += 1
        place = self._folder / f"run-{self._n_runs}"
        place.mkdir()
        (place / "arguments").write_text("\n".join(batch.arguments), encoding="utf-8")
        options = [*batch.marks, "-x", "-p", "no:cacheprovider", f"@{place / 'arguments'}"]
        run = run_pytest(project, options, place, batch.most_s)
        if run.status in (0, NO_TESTS):
            return ""
        tests = read_tests(place / "tests.jsonl").values()
        broken = [test.test for test in tests if test.outcome in ("failed", "started")]
        return broken[0] if broken else batch.arguments[0]


def ask_record(record: Record, kind: str, mutant: Mutant) -> Verdict:
    """Try a mutant with the recorded tests of a kind that execute its place."""
    tests = record.executing(kind, mutant)
    if tests:
        return _ask(record.project, mutant, make_batches(tests, MARKS[kind]), len(tests))
    if kind == "default" and mutant.tests:
        return _ask(record.project, mutant, [Batch((path,)) for path in mutant.tests])
    return Verdict(None, "no recorded test executes it", 0, 0.0)


def ask_earlier(root: Path, mutant: Mutant, record: Record) -> Verdict:
    """Try a mutant with an earlier state of the project and its tests.

    Args:
        root: its checkout, with compiled kernels, or the folder of a record of it.
        record: of the tests of now. Where the earlier ones were not recorded, the files that hold executing tests now
            run, and then those that are no more.
    """
    recorded = (root / "commit").exists()
    checkout = Record(root).project if recorded else root
    if not mutant.fits(_read(checkout / PACKAGE / mutant.file)):
        return Verdict(None, "the earlier package has no such place", 0, 0.0)
    if recorded:
        return ask_record(Record(root), "default", mutant)
    executing = {test.file for kind in MARKS for test in record.executing(kind, mutant)} or set(mutant.tests)
    earlier = {path.relative_to(root).as_posix() for path in root.glob("tests/**/test_*.py")}
    gone = earlier - set(record.test_files())
    files = [*sorted(executing & earlier), *sorted(gone - executing)]
    with tempfile.TemporaryDirectory() as folder:
        project = Path(folder) / "project"
        copy_project(root, project)
        return _ask(project, mutant, [Batch((file,)) for file in files])


def make_batches(tests: Sequence[RecordedTest], marks: tuple[str, ...] = ()) -> Iterator[Batch]:
    """Yield the tests in batches: the cheapest files first, the cheapest tests of a batch first."""
    by_file = groupby(sorted(tests, key=lambda test: test.file), key=lambda test: test.file)
    groups = sorted((list(group) for _, group in by_file), key=_cost)
    count = FIRST_FILES
    while groups:
        batch = sorted((test for group in groups[:count] for test in group), key=lambda test: test.seconds)
        seconds = sum(map(_cost, groups[:count]))
        yield Batch(tuple(test.test for test in batch), marks, seconds)
        groups = groups[count:]
        count *= 2


def _ask(project: Path, mutant: Mutant, batches: Iterable[Batch], n_tests: int = 0) -> Verdict:
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        killer = Trial(project, mutant, Path(folder)).find_killer(batches)
    return Verdict(bool(killer), killer, n_tests, round(time.perf_counter() - start, 1))


def _cost(group: Sequence[RecordedTest]) -> float:
    return FILE_S + sum(test.seconds for test in group)


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.exists() else ""
