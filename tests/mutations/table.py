"""The committed table of mutants and of the tests that notice them, and whether that is enough."""

import csv
import platform
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tests.mutations.mutant import Mutant
from tests.mutations.trial import Verdict

TABLE = Path(__file__).with_name("mutants.tsv")
MAY_SURVIVE = 2  # that the default run may leave to the nightly one, of those that the earlier suite kills
FORMAT: dict[str, Any] = {"delimiter": "\t", "quoting": csv.QUOTE_NONE, "quotechar": None}  # no field has tabs
VERSIONS = ("pytest", "coverage", "hypothesis", "numpy")


@dataclass(frozen=True)
class Row:
    """A mutant with its verdicts.

    Args:
        killed_by: "default", "nightly", "none", or "not asked" of the nightly tests if they were not recorded.
        test: the one that killed it.
        n_tests: how many of the default run execute its place.
        seconds: of all trials of the suite of now.
        earlier: "killed", "survived", "" if the earlier suite was not asked, or why it could not be.
        earlier_test: the test of the earlier suite that killed it.
    """

    number: int
    commit: str
    date: str
    place: str
    meaning: str
    before: str
    after: str
    killed_by: str
    test: str
    n_tests: int
    seconds: float
    earlier: str = ""
    earlier_test: str = ""


def make_row(
    number: int,
    mutant: Mutant,
    source: str,
    commit: str,
    default: Verdict,
    nightly: Verdict | None = None,
    earlier: Verdict | None = None,
) -> Row:
    """Return the row of a mutant; the nightly tests and the earlier suite are asked where the default run is silent."""
    before, after = mutant.change(source)
    verdict = default if nightly is None or not nightly.killed else nightly
    return Row(
        number=number,
        commit=commit,
        date=date.today().isoformat(),
        place=f"{mutant.file}:{mutant.line(source)}",
        meaning=mutant.meaning,
        before=before,
        after=after,
        killed_by=_killed_by(default, nightly),
        test=verdict.test,
        n_tests=default.n_tests,
        seconds=default.seconds + (nightly.seconds if nightly else 0.0),
        earlier=_describe(earlier),
        earlier_test=earlier.test if earlier and earlier.killed else "",
    )


def read_table(path: Path = TABLE) -> list[Row]:
    """Return the committed rows; none if there is no table."""
    if not path.exists():
        return []
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    rows = csv.DictReader(lines, **FORMAT)
    return [
        Row(**row | {"number": int(row["number"]), "n_tests": int(row["n_tests"]), "seconds": float(row["seconds"])})
        for row in rows
    ]


def write_table(rows: Iterable[Row], path: Path = TABLE) -> None:
    """Write the rows in the order of their numbers, beside the versions of what ran them."""
    versions = ", ".join(f"{name} {version(name)}" for name in VERSIONS)
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write("# written by `python -m tests.mutations run`\n")
        file.write(f"# {date.today().isoformat()}, Python {platform.python_version()}, {versions}\n")
        table = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n", **FORMAT)
        table.writeheader()
        table.writerows(asdict(row) for row in sorted(rows, key=lambda row: row.number))


def judge(rows: Sequence[Row]) -> list[str]:
    """Return what is wrong: too much is left to the nightly tests, lost, or was never asked."""
    silent = [row for row in rows if row.killed_by != "default"]
    errors = [
        f"mutant {row.number}: the earlier suite was not asked; add --against" for row in silent if not row.earlier
    ]
    left = [row for row in silent if row.earlier == "killed"]
    errors += [_describe_loss(row) for row in left if row.killed_by != "nightly"]
    if len(left) > MAY_SURVIVE:
        errors.append(
            f"the default run leaves {len(left)} mutants that the earlier suite kills, not {MAY_SURVIVE} at most"
        )
    return errors


def _describe_loss(row: Row) -> str:
    if row.killed_by == "not asked":
        return f"mutant {row.number}: {row.earlier_test} killed it, and no executing nightly test is recorded"
    return f"mutant {row.number}: {row.earlier_test} killed it, and no test of now does"


def _killed_by(default: Verdict, nightly: Verdict | None) -> str:
    if default.killed:
        return "default"
    if nightly is None or nightly.killed is None:
        return "not asked"
    return "nightly" if nightly.killed else "none"


def _describe(verdict: Verdict | None) -> str:
    match verdict:
        case None:
            return ""
        case Verdict(killed=None):
            return verdict.test
        case _:
            return "killed" if verdict.killed else "survived"
