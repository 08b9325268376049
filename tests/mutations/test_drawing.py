"""Which mutants are drawn, and that each is another program."""

import ast
from collections import Counter
from pathlib import PurePosixPath

import pytest

from tests.mutations.drawing import draw, read_drawn, read_sources, replace_mutants
from tests.mutations.mutant import ROOT, SOURCES, executed_lines
from tests.mutations.operators import OPERATORS, apply_edit, find_edits, is_mutant
from tests.mutations.planted import PLANTED

PACKAGES = ("agents", "replay")
EXAMPLE = '''\
def clip(values, low=0, *, high=1.5):
    """Clip."""
    if not values or low > high:
        raise ValueError(f"{low + 1}")
    return [value - low for value in values[1:] if value is not None and (value) < high]


def report(clipped):
    clipped.sort()
    clipped.strict = True
'''


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    return {file: text for file, text in read_sources().items() if file.startswith(PACKAGES)}


def test_the_same_seed_draws_the_same_mutants_and_another_one_others(sources: dict[str, str]) -> None:
    assert draw(sources, count=8) == draw(dict(reversed(sources.items())), count=8)
    assert draw(sources, count=8) != draw(sources, count=8, seed=1)


def test_each_drawn_mutant_is_another_program_and_each_package_has_one(sources: dict[str, str]) -> None:
    mutants = draw(sources, count=8)
    assert len(set(mutants)) == 8
    assert {PurePosixPath(mutant.file).parts[0] for mutant in mutants} == set(PACKAGES)
    for mutant in mutants:
        changed = mutant.mutate(sources[mutant.file])
        compile(changed, mutant.file, "exec", dont_inherit=True)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(sources[mutant.file]))
        assert mutant.executed_lines(sources[mutant.file])


def test_a_mutant_that_is_left_out_is_replaced_and_the_others_stay(sources: dict[str, str]) -> None:
    mutants = draw(sources, count=8)
    replaced = replace_mutants(mutants, sources, [mutants[2]])
    assert replaced[2] not in mutants
    assert replaced[:2] + replaced[3:] == mutants[:2] + mutants[3:]


def test_every_operator_finds_its_places_and_nothing_else() -> None:
    edits = [edit for edit in find_edits(EXAMPLE) if is_mutant(EXAMPLE, edit)]
    assert {edit.operator for edit in edits} == {operator.__name__ for operator in OPERATORS}
    changed = Counter(line for edit in edits for line in apply_edit(EXAMPLE, edit).splitlines())
    for line in (
        "def clip(values, low, *, high=1.5):",
        "def clip(values, low=0, *, high):",
        "    if values or low > high:",
        "    if not values and low > high:",
        "    if not values or low >= high:",
        "    if not values or low <= high:",
        "    return None",
        "    return [value + low for value in values[1:] if value is not None and (value) < high]",
        "    return [value - low for value in values[1 + 1:] if value is not None and (value) < high]",
        "    return [value - low for value in values[2:] if value is not None and (value) < high]",
        "    return [value - low for value in values[1:] if value is None and (value) < high]",
        "    return [value - low for value in values[1:] if value is not None and (value) <= high]",
        "    return [value - low for value in values[1:] if value is not None and (value) >= high]",
        "    return [value - low for value in values[1:] if value is not None or (value) < high]",
        "    return",
        "    pass",
        "    clipped.strict = False",
    ):
        assert changed[line] == 1, line
    assert len(edits) == 17


@pytest.mark.parametrize(
    ("line", "lines"),
    [(1, range(3, 4)), (3, range(3, 4)), (4, range(4, 5)), (9, range(9, 10)), (7, range(0))],
    ids=["a header", "a condition", "a statement", "another function", "outside functions"],
)
def test_the_lines_that_are_executed_where_a_mutant_acts(line: int, lines: range) -> None:
    assert executed_lines(ast.parse(EXAMPLE), line) == lines


def test_the_place_of_each_mutant_is_there() -> None:
    gone = [mutant.file for mutant in [*PLANTED, *read_drawn()[0]] if not mutant.fits(_read(mutant.file))]
    assert gone == [], "`python -m tests.mutations draw` replaces drawn mutants; correct planted ones"


def test_the_tests_named_with_planted_mutants_are_there() -> None:
    assert [path for mutant in PLANTED for path in mutant.tests if not (ROOT / path).exists()] == []


def _read(file: str) -> str:
    path = SOURCES / file
    return path.read_text(encoding="utf-8") if path.exists() else ""
