"""Compare a study's table cache, and table files written from it, with tables recomputed from the logs, cell by cell.

A difference is one line: which table, row and column, what is there, and what the logs say.
"""

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice, zip_longest
from pathlib import Path

import duckdb
import pyarrow.parquet

from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.store import StoreVersionError, StudyStore, TableDatabase
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD, TABLES

MAX_NAMED = 5  # differences of a table; one edit may change every row
MAX_SHOWN = 100  # characters of a page's line
_Cells = Sequence[object]


def compare_cache(fresh: StudyStore, study: Path) -> Iterator[str]:
    """Yield the differences of a study's ``tables.duckdb`` from tables recomputed from its logs.

    Sessions that the next command would read again, since their logs changed, are not compared.
    """
    own = study / TABLE_CACHE
    if not own.exists():
        return
    try:
        TableDatabase(own, read_only=True).close()
    except StoreVersionError:  # no command believes it
        return
    except Exception as error:
        yield f"{TABLE_CACHE} cannot be read and will be made anew: {str(error).splitlines()[0]}"
        return
    connection = fresh.tables.connection
    path = str(own).replace("'", "''")
    connection.execute(f"ATTACH '{path}' AS cache (READ_ONLY)")
    try:
        yield from _compare_databases(connection)
    finally:
        connection.execute("DETACH cache")


def _compare_databases(connection: duckdb.DuckDBPyConnection) -> Iterator[str]:
    connection.execute(
        "CREATE OR REPLACE TEMP TABLE pairs AS "
        "SELECT key, ours.log AS ours, theirs.log AS theirs, theirs.with_shortest, "
        "ours.about = theirs.about AS same_about, ours.facts = theirs.facts AS same_facts "
        "FROM kept.logs AS ours JOIN cache.kept.logs AS theirs USING (key, fingerprint)"
    )
    unknown = "SELECT key FROM cache.kept.logs GROUP BY key HAVING count(*) > 1 ORDER BY key"
    for (key,) in connection.execute(unknown).fetchall():
        yield f"{TABLE_CACHE}: session {key} is in it more than once"
    for key, same_about, same_facts in connection.execute(
        "SELECT key, same_about, same_facts FROM pairs WHERE NOT same_about OR (NOT same_facts) ORDER BY key"
    ).fetchall():
        what = [name for name, same in (("account", same_about), ("episode facts", same_facts)) if not same]
        yield f"{TABLE_CACHE}: {key}: the log says otherwise than the {' and '.join(what)}"
    for name, columns in TABLES.items():
        names = [column.name for column in columns]
        differs = " OR ".join(
            f'ours."{column}" IS DISTINCT FROM theirs."{column}"'
            if column not in COLUMNS_NEEDING_WORLD
            else f'(with_shortest AND ours."{column}" IS DISTINCT FROM theirs."{column}")'
            for column in names
        )
        sides = ", ".join(f'{side}."{column}"' for side in ("ours", "theirs") for column in names)
        found = connection.execute(
            "WITH ours AS (SELECT pairs.key AS session, with_shortest, mine.* "
            f"FROM kept.{name} AS mine JOIN pairs ON mine.log = pairs.ours), "
            "theirs AS (SELECT pairs.key AS session, its.* "
            f"FROM cache.kept.{name} AS its JOIN pairs ON its.log = pairs.theirs) "
            "SELECT coalesce(ours.session, theirs.session), coalesce(ours.row, theirs.row), "
            f"ours.session IS NULL, theirs.session IS NULL, {sides} "
            "FROM ours FULL JOIN theirs ON ours.session = theirs.session AND ours.row = theirs.row "
            f"WHERE ours.session IS NULL OR theirs.session IS NULL OR {differs} ORDER BY 1, 2 LIMIT {MAX_NAMED}"
        ).fetchall()
        for session, place, is_added, is_missing, *cells in found:
            where = f"{TABLE_CACHE}: table {name}, {session}, row {place}"
            if is_added or is_missing:
                yield f"{where} {'is in no log' if is_added else 'is missing'}"
                continue
            ours, theirs = cells[: len(names)], cells[len(names) :]
            for column, expected, there in zip(names, ours, theirs, strict=True):
                if expected != there:
                    yield _describe_cell(where, column, there, expected)
        orphans = f"SELECT count(*) FROM cache.kept.{name} WHERE log NOT IN (SELECT log FROM cache.kept.logs)"
        ((count,),) = connection.execute(orphans).fetchall()
        if count:
            yield f"{TABLE_CACHE}: table {name} has {count} rows of no session"


def compare_table_files(folder: Path, recomputed: Path) -> Iterator[str]:
    """Yield the differences of a folder's CSV and Parquet tables from the files of the same names in another."""
    for path in sorted(path for path in folder.iterdir() if path.stem in TABLES and path.suffix in _READERS):
        own = recomputed / path.name
        if not own.exists():
            yield f"{path}: there is no such table"
        elif path.read_bytes() != own.read_bytes():
            yield from islice(_compare_rows(path, own), MAX_NAMED)
    kinds = {path.suffix for path in folder.iterdir()}
    for own in sorted(recomputed.iterdir()):
        if own.stem in TABLES and own.suffix in kinds and not (folder / own.name).exists():
            yield f"{folder / own.name} is missing"


def compare_pages(page: Path, recomputed: Path) -> Iterator[str]:
    """Yield the differences of a report's page from one made from recomputed tables, by line."""
    lines, own = (path.read_text(encoding="utf-8").splitlines() for path in (page, recomputed))
    found = (
        _describe_cell(str(page), f"line {number}", _shorten(line), _shorten(expected))
        for number, (line, expected) in enumerate(zip_longest(lines, own, fillvalue=""), 1)
        if line != expected
    )
    yield from islice(found, MAX_NAMED)


def _shorten(line: str) -> str:
    text = " ".join(re.sub(r"<[^>]*>", " ", line).split())
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."


def _compare_rows(path: Path, own: Path) -> Iterator[str]:
    read = _READERS[path.suffix]
    try:
        (heads, rows), (own_heads, own_rows) = read(path), read(own)
    except (OSError, UnicodeError, ValueError, csv.Error) as error:  # pyarrow raises ValueError
        yield f"{path} cannot be read: {error}"
        return
    if heads != own_heads:
        changed = sorted({*map(str, heads)} ^ {*map(str, own_heads)})
        yield f"{path}: the columns are others: {', '.join(changed) or 'in another order'}"
        return
    is_equal = True
    for number, (row, expected) in enumerate(zip_longest(rows, own_rows), 1):
        if row is None or expected is None:
            yield f"{path}: row {number} {'is missing' if row is None else 'is in no log'}"
            return
        for head, cell, its in zip_longest(heads, row, expected):
            if cell != its and not (cell != cell and its != its):  # NaN
                is_equal = False
                yield _describe_cell(f"{path}: row {number}", str(head), cell, its)
    if is_equal:
        yield f"{path}: the numbers are those of the logs, but the bytes are not as they are written"


def _describe_cell(where: str, column: str, there: object, expected: object) -> str:
    return f"{where}, {column} is {there!r}; the logs say {expected!r}"


def _read_csv(path: Path) -> tuple[_Cells, Iterable[_Cells]]:
    with path.open(newline="", encoding="utf-8") as file:
        heads, *rows = csv.reader(file)
    return heads, rows


def _read_parquet(path: Path) -> tuple[_Cells, Iterable[_Cells]]:
    table = pyarrow.parquet.read_table(path)
    return table.column_names, zip(*(column.to_pylist() for column in table.columns), strict=True)


_READERS = {".csv": _read_csv, ".parquet": _read_parquet}
