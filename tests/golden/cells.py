"""The frozen studies' tables, cell by cell: ``python -m tests.golden.cells FOLDER`` keeps those of the studies there.

A study's tables are one packed JSON in ``v1-tables``: table, column, then its cells as CSV writes them, null where
nothing is known. They are those that an export and a report write, with the columns that a world is asked for.

Those of the 21 studies that commit e7fb9c2 wrote are its numbers: exported again by that program on 26 November 2026,
375,496 cells were the same but for six slopes of equal rewards, which differed in rounding (below 3e-16). No number of
an old log has changed since, so there is no list of changed cells.
"""

import csv
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import zstandard

from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_files import write_tables
from tests.golden import renamed

FOLDER = Path(__file__).parent / "v1-tables"
SAME = 1e-12  # of a number: libraries of other machines may round the last digit otherwise

Cells = dict[str, dict[str, list[str | None]]]  # table, column, row


def cells_of(study: Path, folder: Path) -> Cells:
    """Every table of a study as it is written today, by way of a folder; beside the study its cache is left."""
    with StudyStore(StudySessions(study), with_shortest=True) as store:
        written = write_tables(store.tables, folder, kinds=("csv",), empty=True)
    return {path.stem: _columns(path) for path in written if path.suffix == ".csv"}


def frozen_cells(study: str) -> Cells:
    """Those of a study as they were when it was frozen."""
    return json.loads(zstandard.decompress((FOLDER / f"{study}.json.zst").read_bytes()))


def differences(frozen: Cells, now: Cells) -> Iterator[str]:
    """Yield what of the frozen cells is not there any more, by today's names; tables and columns may be added."""
    for then, columns in frozen.items():
        table = renamed.TABLES.get(then, then)
        if table not in now:
            yield f"{then}: there is no table {table}"
            continue
        for name, cells in columns.items():
            column = renamed.COLUMNS.get(f"{then}.{name}", renamed.COLUMNS.get(name, name))
            if column not in now[table]:
                yield f"{then}.{name}: there is no column {column} in {table}"
                continue
            found = now[table][column]
            if len(found) != len(cells):
                yield f"{then}.{name}: {len(cells)} rows frozen, {len(found)} now"
            for row, (cell, its) in enumerate(zip(cells, found, strict=False), 1):
                if not _same(cell, its):
                    yield f"{then}.{name} row {row}: {cell!r} frozen, {its!r} now"


def _columns(path: Path) -> dict[str, list[str | None]]:
    with path.open(encoding="utf-8", newline="") as file:
        names = next(csv.reader(file))
    texts = pa.csv.ConvertOptions(
        column_types=dict.fromkeys(names, pa.string()),
        null_values=[""],
        strings_can_be_null=True,
        quoted_strings_can_be_null=False,
    )
    parsing = pa.csv.ParseOptions(newlines_in_values=True)
    return pa.csv.read_csv(path, convert_options=texts, parse_options=parsing).to_pydict()


def _same(frozen: str | None, now: str | None) -> bool:
    if frozen == now or frozen is None or now is None or (frozen.isdigit() and now.isdigit()):
        return frozen == now
    try:
        return math.isclose(float(frozen), float(now), rel_tol=SAME, abs_tol=SAME)
    except ValueError:
        return False


def keep(data: Path) -> None:
    """Freeze the tables of every study in a folder that has none yet."""
    FOLDER.mkdir(exist_ok=True)
    for study in sorted(path.parent for path in data.glob("*/register.jsonl")):
        kept = FOLDER / f"{study.name}.json.zst"
        if not kept.exists():
            with tempfile.TemporaryDirectory() as folder:
                cells = json.dumps(cells_of(study, Path(folder)), separators=(",", ":"))
            kept.write_bytes(zstandard.ZstdCompressor(level=19).compress(cells.encode()))


if __name__ == "__main__":
    keep(Path(sys.argv[1]))
