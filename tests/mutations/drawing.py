"""Which mutants are drawn: a seed chooses, and hand-written reasons leave out what no test could tell apart.

A mutant lies in a function. The thirty are spread over the packages: each has one, and packages drawn by their lines
have the rest. Within a package, modules are drawn by their lines, then one of the operators that fit the module, then
one of its places. A mutant that is left out is replaced by the next draw of its package, and no other changes.

Never drawn from: generated modules, and the sources of kernels. Kernels run as machine code, where no coverage is
measured; an edit changes the digest of all that is compiled from the module, so tests that compare digests would notice
it whatever it meant; and each process would compile the kernels anew, for minutes. Tests that compare them bit by bit
with plain Python and with the worlds they are taken from prove kernels.
"""

import json
import random
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from itertools import groupby, islice
from pathlib import Path

from minihuman.worlds.source_digest import import_closure
from tests.mutations.mutant import PACKAGE, SOURCES, Mutant
from tests.mutations.operators import Edit, apply_edit, find_edits, is_mutant

SEED = 44
COUNT = 30
DRAWN = Path(__file__).with_name("drawn.json")
KERNEL = re.compile(r"^@(kernel|device_function|inline|simd_function)\b", re.M)
MOST_DRAWS = 500  # of a package, before it counts as one without mutants


@dataclass(frozen=True)
class LeftOut:
    """A drawn mutant that is not tried, and why."""

    mutant: Mutant
    reason: str


def draw(sources: Mapping[str, str], *, seed: int = SEED, count: int = COUNT) -> list[Mutant]:
    """Draw mutants.

    Args:
        sources: the text of each module that may be changed, by its path in the package.
        seed: another one draws others.
        count: at least as many as there are packages.
    """
    by_package = _group_by_package(sources)
    counts = _count_by_package(by_package, seed, count)
    return [
        mutant
        for package, modules in by_package.items()
        for mutant in islice(draw_from_package(package, modules, seed), counts[package])
    ]


def replace_mutants(
    mutants: Sequence[Mutant], sources: Mapping[str, str], left_out: Collection[Mutant], *, seed: int = SEED
) -> list[Mutant]:
    """Return the mutants with the next draws of their packages for those that are left out or whose place is gone."""
    by_package = _group_by_package(sources)
    streams = {package: draw_from_package(package, modules, seed) for package, modules in by_package.items()}
    tried = {*mutants, *left_out}
    replaced = []
    for mutant in mutants:
        fits = mutant not in left_out and mutant.fits(sources.get(mutant.file, ""))
        if not fits:
            mutant = next(other for other in streams[_package(mutant.file)] if other not in tried)
        replaced.append(mutant)
    return replaced


def draw_from_package(package: str, modules: Mapping[str, str], seed: int) -> Iterator[Mutant]:
    """Yield mutants of a package without end, or until hundreds of draws found no other one."""
    rng = random.Random(f"{seed} {package}")
    lines = [text.count("\n") for text in modules.values()]
    earlier: set[Mutant] = set()
    for _ in range(MOST_DRAWS):
        (file,) = rng.choices(list(modules), lines)
        mutant = _draw_from_module(file, modules[file], rng)
        if mutant is not None and mutant not in earlier:
            earlier.add(mutant)
            yield mutant


def read_sources(package: Path = SOURCES) -> dict[str, str]:
    """Return the modules that mutants are drawn from, by their paths in the package."""
    modules = {path.relative_to(package).as_posix(): path for path in sorted(package.rglob("*.py"))}
    texts = {file: path.read_text(encoding="utf-8") for file, path in modules.items() if not file.endswith("_pb2.py")}
    kernels = [file for file, text in texts.items() if KERNEL.search(text)]
    names = [f"{PACKAGE}.{file.removesuffix('.py').replace('/', '.')}" for file in kernels]
    compiled = set(import_closure(*names))
    return {file: text for file, text in texts.items() if file not in compiled}


def read_drawn(path: Path = DRAWN) -> tuple[list[Mutant], list[LeftOut]]:
    """Return the committed mutants, and those that were left out; none if there is no file."""
    if not path.exists():
        return [], []
    content = json.loads(path.read_text(encoding="utf-8"))
    mutants = [Mutant(**row) for row in content["mutants"]]
    return mutants, [LeftOut(Mutant(**row["mutant"]), row["reason"]) for row in content["left_out"]]


def write_drawn(mutants: list[Mutant], left_out: list[LeftOut], commit: str, path: Path = DRAWN) -> None:
    """Write the mutants of a commit's sources, and those left out with their reasons."""
    content = {
        "seed": SEED,
        "commit": commit,
        "mutants": [_as_row(mutant) for mutant in mutants],
        "left_out": [{"reason": omission.reason, "mutant": _as_row(omission.mutant)} for omission in left_out],
    }
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _as_row(mutant: Mutant) -> dict[str, object]:
    return {name: field for name, field in asdict(mutant).items() if name != "tests"}


def _group_by_package(sources: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Group modules by the package at the top that holds them; those of none are one more group."""
    groups = groupby(sorted(sources, key=lambda file: (_package(file), file)), key=_package)
    return {package: {file: sources[file] for file in files} for package, files in groups}


def _package(file: str) -> str:
    return file.partition("/")[0] if "/" in file else ""


def _count_by_package(by_package: Mapping[str, Mapping[str, str]], seed: int, count: int) -> Counter[str]:
    lines = [sum(text.count("\n") for text in modules.values()) for modules in by_package.values()]
    more = random.Random(seed).choices(list(by_package), lines, k=count - len(by_package))
    return Counter([*by_package, *more])


def _draw_from_module(file: str, text: str, rng: random.Random) -> Mutant | None:
    edits = _find_edits(text)
    if not edits:
        return None
    operator = rng.choice(sorted({edit.operator for edit in edits}))
    edit = rng.choice([edit for edit in edits if edit.operator == operator])
    return _mutant_of(file, text, edit) if is_mutant(text, edit) else None


@cache
def _find_edits(text: str) -> list[Edit]:
    return find_edits(text)


def _mutant_of(file: str, text: str, edit: Edit) -> Mutant:
    """Return an edit with as many whole lines around it as say where it stands."""
    start = text.rfind("\n", 0, edit.start) + 1
    end = text.find("\n", edit.end)
    while text.count(text[start:end]) > 1:
        start = text.rfind("\n", 0, start - 1) + 1
    changed = apply_edit(text, edit)
    return Mutant(edit.operator, file, text[start:end], changed[start : end + len(changed) - len(text)])
