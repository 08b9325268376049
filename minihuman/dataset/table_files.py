"""Table files: write tables as CSV or Parquet, and compare stored tables with tables recomputed from the logs.

Tables are written with their data dictionary, or as Parquet partitioned by study and participant. The comparison of
table files and of the study's table cache is cell by cell. Only some rows are in memory at a time: 10,000 sessions need
no more memory than ten.
"""

import csv
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from hashlib import blake2b
from itertools import groupby, islice, zip_longest
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

import duckdb
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

import minihuman
from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.info_columns import add_info_columns, build_info_fields, list_info_columns
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.person_table import PERSON_TABLE, PersonTable
from minihuman.dataset.rows import arrow_schema
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import (
    TABLE_VERSION,
    TABLES,
    TablePartition,
    add_person_resource,
    build_data_dictionary,
    build_data_package,
    describe_columns,
)
from minihuman.dataset.table_columns import TableColumn
from minihuman.dataset.table_database import StoreVersionError, TableDatabase, digest_relation
from minihuman.dataset.table_types import TIMES, guard_texts, parse_times

TableFormat = Literal["parquet", "csv"]
TABLE_METADATA = {"table_version": TABLE_VERSION, "minihuman_version": minihuman.__version__}


def _open_parquet_writer(path: Path, columns: pa.Schema) -> pa.parquet.ParquetWriter:
    """Open a Parquet writer that encodes recurring values in dictionaries.

    For numbers it stores the smallest and largest value of each row group, so that readers can skip row groups. For
    texts, which are ordered by session, these statistics would take a third of the writing time.
    """
    numbers = [field.name for field in columns if not pa.types.is_string(field.type)]
    return pa.parquet.ParquetWriter(
        path, columns, compression="zstd", use_dictionary=True, write_statistics=numbers, write_page_checksum=True
    )


class _ParquetTableWriter:
    """A writer of Parquet tables that stores columns of UTC texts as timestamps with a time zone."""

    def __init__(self, path: Path, columns: pa.Schema) -> None:
        self._times = [field.name for field in columns if (field.metadata or {}).get(b"unit") == b"UTC"]
        fields = [field.with_type(TIMES) if field.name in self._times else field for field in columns]
        self._writer = _open_parquet_writer(path, pa.schema(fields, metadata=TABLE_METADATA))

    def write_table(self, table: pa.Table) -> None:
        for name in self._times:
            index = table.schema.get_field_index(name)
            times = parse_times(table.column(name))
            table = table.set_column(index, table.schema.field(index).with_type(TIMES), times)
        self._writer.write_table(table.replace_schema_metadata(TABLE_METADATA))

    def close(self) -> None:
        self._writer.close()


class _CsvTableWriter:
    """A writer of CSV tables for pandas, polars, R and DuckDB: booleans are TRUE and FALSE, missing values are empty.

    Texts that a spreadsheet would run as a formula are guarded by ``guard_texts``.
    """

    def __init__(self, path: Path, columns: pa.Schema) -> None:
        self._texts = [field.name for field in columns if pa.types.is_string(field.type)]
        self._booleans = [field.name for field in columns if pa.types.is_boolean(field.type)]
        fields = [field.with_type(pa.string()) if field.name in self._booleans else field for field in columns]
        self._writer = pa.csv.CSVWriter(path, pa.schema(fields))

    def write_table(self, table: pa.Table) -> None:
        for name in self._booleans:
            index = table.schema.get_field_index(name)
            texts = pc.if_else(table.column(name), "TRUE", "FALSE")
            table = table.set_column(index, table.schema.field(index).with_type(pa.string()), texts)
        for name in self._texts:
            index = table.schema.get_field_index(name)
            table = table.set_column(index, table.schema.field(index), guard_texts(table.column(name)))
        self._writer.write_table(table)

    def close(self) -> None:
        self._writer.close()


_WRITERS: dict[TableFormat, Callable[[Path, pa.Schema], Any]] = {"parquet": _ParquetTableWriter, "csv": _CsvTableWriter}


def write_tables(
    tables: TableDatabase,
    folder: Path,
    *,
    names: Sequence[str] | None = None,
    kinds: Sequence[TableFormat] = ("parquet", "csv"),
    without: frozenset[str] = frozenset(),
    empty: bool = False,
    people: PersonTable | None = None,
) -> tuple[Path, ...]:
    """Write the tables that have rows into a folder, as Parquet, CSV or both; return the paths of the files.

    Two further files explain the columns: ``dictionary.json`` in the shortest form, and ``datapackage.json`` as a
    Frictionless data package. The columns in ``without`` are omitted; ``empty`` also writes tables that have no rows.
    ``people`` is the person table, which does not come from the logs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = [name for name in (TABLES if names is None else names) if empty or tables.count(name)]
    infos = {name: list_info_columns(tables.connection, name) for name in names}
    described = {}
    for name, columns in build_data_dictionary(without=without).items():
        if name in names:
            described[name] = columns | describe_columns(infos[name].values())
    resources = [(name, folder / f"{name}.{kinds[0]}") for name in names]  # the same rows twice are one resource
    package = build_data_package("minihuman-tables", resources, without=without, infos=infos)
    if people is not None:
        described[PERSON_TABLE] = describe_columns(people.columns)
        add_person_resource(package, folder / f"{PERSON_TABLE}.{kinds[0]}", people.columns)
    descriptions = {folder / "dictionary.json": described, folder / "datapackage.json": package}
    for path, content in descriptions.items():
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8", newline="\n")
    paths: list[Path] = []
    for name in names:
        files = {kind: folder / f"{name}.{kind}" for kind in kinds}
        _write_table(tables, name, files, without=without, infos=infos[name])
        paths += files.values()
    if people is not None:
        paths += _write_people(people, folder, kinds)
    return (*paths, *descriptions)


def _write_people(people: PersonTable, folder: Path, kinds: Sequence[TableFormat]) -> list[Path]:
    """Write the person table into a file of each of the given formats; return the paths of the files."""
    paths = []
    for kind in kinds:
        path = folder / f"{PERSON_TABLE}.{kind}"
        writer = _WRITERS[kind](path, people.rows.schema)
        writer.write_table(people.rows)
        writer.close()
        paths.append(path)
    return paths


def _write_table(
    tables: TableDatabase,
    name: str,
    files: Mapping[TableFormat, Path],
    *,
    without: frozenset[str],
    infos: Mapping[str, TableColumn],
) -> None:
    """Write one table into a file of each of the given formats.

    Args:
        tables: the open tables.
        name: the table's name.
        files: the path of the file for each format.
        without: the columns to omit.
        infos: the columns to append for the keys of the table's JSON column, by key.
    """
    columns = pa.schema([*arrow_schema(name, without=without), *build_info_fields(infos)])
    writers = [_WRITERS[kind](path, columns) for kind, path in files.items()]
    for batch in tables.batches(name, without=without):
        rows = add_info_columns(pa.Table.from_batches([batch]), name, infos)
        for writer in writers:
            writer.write_table(rows)
    for writer in writers:
        writer.close()


def list_partitions(store: StudyStore) -> dict[TablePartition, int]:
    """Return the partitions of a store's tables, with the number of each partition's session.

    The partitions omit columns that require the worlds. Equal rows have equal partitions on every machine with the same
    version of DuckDB.
    """
    partitions: dict[TablePartition, int] = {}
    sql = "SELECT log, study, participant, session FROM kept.participants"
    sessions = store.tables.connection.execute(sql).fetchall()
    session_keys = {log: (study, participant, session) for log, study, participant, session in sessions}
    for table in TABLES:
        for number, row_digest in sorted(store.tables.digest_rows(table, without=COLUMNS_NEEDING_WORLD).items()):
            digest = _digest_partition(table, row_digest, str(store.selection))
            partitions[TablePartition(table, *session_keys[number], digest)] = number
    return partitions


def write_partitions(
    store: StudyStore, partitions: Mapping[TablePartition, int], folder: Path
) -> Iterator[tuple[TablePartition, Path]]:
    """Write the partitions that ``list_partitions`` returned into files below a folder.

    Yield each partition with the path of its file when the file is complete. The file's key-value metadata state the
    partition's digest, the selection, the selection's digest, and the versions of minihuman and DuckDB.
    """
    selection = str(store.selection)
    made_by = {
        **TABLE_METADATA,
        "duckdb_version": duckdb.__version__,
        "selection": selection,
        "selection_digest": blake2b(selection.encode(), digest_size=8).hexdigest(),
    }
    for table, table_partitions in groupby(partitions, key=attrgetter("table")):
        by_number = {partitions[partition]: partition for partition in table_partitions}
        for number, batches in store.tables.session_batches(table, list(by_number), without=COLUMNS_NEEDING_WORLD):
            partition = by_number[number]
            path = folder / partition.name
            path.parent.mkdir(parents=True, exist_ok=True)
            facts = made_by | {"partition_digest": partition.digest}
            schema = arrow_schema(table, without=COLUMNS_NEEDING_WORLD).with_metadata(facts)
            with _open_parquet_writer(path, schema) as writer:
                for batch in batches:
                    writer.write_batch(batch)
            yield partition, path


def find_partition_damage(path: Path, partition: TablePartition) -> str:
    """Return why a file is not the partition that its name states; "" if no damage is found.

    The whole file is read and the checksum of each page is verified; files of earlier versions have none. The rows are
    digested again only if the same versions of minihuman and DuckDB wrote the file, because another version's digest of
    the same rows can differ.
    """
    try:
        file = pa.parquet.ParquetFile(path, page_checksum_verification=True)
        facts = {name.decode(): text.decode() for name, text in (file.schema_arrow.metadata or {}).items()}
        for batch in file.iter_batches():
            batch.validate(full=True)
    except (OSError, ValueError) as error:  # pyarrow's errors are among these
        first_line = str(error).splitlines()[0]
        return f"it cannot be read ({first_line[:_MOST_ERROR_CHARACTERS]})"
    if facts.get("partition_digest") != partition.digest:
        return "it holds other rows than its name says"
    versions = {"minihuman_version": minihuman.__version__, "duckdb_version": duckdb.__version__}
    if any(facts.get(name) != version for name, version in versions.items()):
        return ""
    row_digest = _digest_file(path, partition.table)
    if _digest_partition(partition.table, row_digest, facts["selection"]) != partition.digest:
        return "its rows are not those of its digest"
    return ""


def _digest_partition(table: str, row_digest: int, selection: str) -> str:
    """Return a digest of a partition's selection and columns, and of the digest of its rows; 16 hexadecimal digits."""
    columns = [column for column in TABLES[table] if column.name not in COLUMNS_NEEDING_WORLD]
    return blake2b(repr((selection, columns, row_digest)).encode(), digest_size=8).hexdigest()


def _digest_file(path: Path, table: str) -> int:
    """Digest the rows of a partition file as the store digests the rows of its session."""
    with duckdb.connect() as connection:
        relation = connection.sql(
            "SELECT 0 AS log, file_row_number AS row, * FROM read_parquet(?, file_row_number = true)",
            params=[str(path)],
        )
        return digest_relation(relation, table, without=COLUMNS_NEEDING_WORLD).get(0, 0)


MAX_NAMED = 5  # differences of a table; one edit may change every row
_MOST_ERROR_CHARACTERS = 100
MAX_SHOWN = 100  # characters of a page's line
_Cells = Sequence[object]


def compare_cache(fresh: StudyStore, study: Path) -> Iterator[str]:
    """Yield the differences of a study's ``tables.duckdb`` from tables recomputed from its logs.

    Sessions whose logs have changed are not compared, because the next command reads them again. Nothing is yielded if
    there is no such file, or if another version of the software made it.

    Args:
        fresh: the store of the tables that were recomputed from the logs.
        study: the study's folder.
    """
    cache_path = study / TABLE_CACHE
    if not cache_path.exists():
        return
    try:
        TableDatabase(cache_path, read_only=True).close()
    except StoreVersionError:  # every command ignores such a cache
        return
    except Exception as error:
        first_line = str(error).splitlines()[0]
        yield f"{TABLE_CACHE} cannot be read and will be made anew: {first_line}"
        return
    connection = fresh.tables.connection
    quoted_path = str(cache_path).replace("'", "''")
    connection.execute(f"ATTACH '{quoted_path}' AS cache (READ_ONLY)")
    try:
        yield from _compare_databases(connection)
    finally:
        connection.execute("DETACH cache")


_CONTENT = r"regexp_replace({}.fingerprint, ' [^ \n]+(\n|$)', '\1', 'g')"  # as ``is_same_content`` does


def _compare_databases(connection: duckdb.DuckDBPyConnection) -> Iterator[str]:
    """Yield the differences of the attached database ``cache`` from the connection's own, which was built from logs."""
    connection.execute(
        "CREATE OR REPLACE TEMP TABLE pairs AS "
        "SELECT fresh.key, fresh.log AS fresh_log, cached.log AS cached_log, cached.with_shortest, "
        "fresh.about = cached.about AS same_about, fresh.facts = cached.facts AS same_facts "
        "FROM kept.logs AS fresh JOIN cache.kept.logs AS cached ON fresh.key = cached.key "
        f"AND {_CONTENT.format('fresh')} = {_CONTENT.format('cached')}"
    )
    yield from _compare_accounts(connection)
    for name, columns in TABLES.items():
        yield from _compare_rows_with_cache(connection, name, [column.name for column in columns])
        orphans = f"SELECT count(*) FROM cache.kept.{name} WHERE log NOT IN (SELECT log FROM cache.kept.logs)"
        ((count,),) = connection.execute(orphans).fetchall()
        if count:
            yield f"{TABLE_CACHE}: table {name} has {count} rows of no session"


def _compare_accounts(connection: duckdb.DuckDBPyConnection) -> Iterator[str]:
    """Yield the sessions that the cache holds twice, and where the cache's account of a session contradicts the log."""
    repeated = "SELECT key FROM cache.kept.logs GROUP BY key HAVING count(*) > 1 ORDER BY key"
    for (key,) in connection.execute(repeated).fetchall():
        yield f"{TABLE_CACHE}: session {key} is in it more than once"
    for key, same_about, same_facts in connection.execute(
        "SELECT key, same_about, same_facts FROM pairs WHERE NOT same_about OR (NOT same_facts) ORDER BY key"
    ).fetchall():
        differing = [name for name, same in (("account", same_about), ("episode facts", same_facts)) if not same]
        yield f"{TABLE_CACHE}: {key}: the log says otherwise than the {' and '.join(differing)}"


def _compare_rows_with_cache(connection: duckdb.DuckDBPyConnection, name: str, columns: list[str]) -> Iterator[str]:
    """Yield the first differences between a table's recomputed and cached rows."""
    differing_rows = connection.execute(_compose_row_comparison(name, columns)).fetchall()
    for session, number, is_added, is_missing, *cells in differing_rows:
        location = f"{TABLE_CACHE}: table {name}, {session}, row {number}"
        if is_added:
            yield f"{location} is in no log"
            continue
        if is_missing:
            yield f"{location} is missing"
            continue
        expected_cells = cells[: len(columns)]
        cached_cells = cells[len(columns) :]
        for column, expected, cached_cell in zip(columns, expected_cells, cached_cells, strict=True):
            if expected != cached_cell:
                yield _describe_difference(location, column, cached_cell, expected)


def _compose_row_comparison(name: str, columns: list[str]) -> str:
    """Return the SQL query for the first rows of a table that differ between a fresh database and the cache.

    Its columns: session, row, whether the row is in the cache alone, whether it is missing there, then the cells of the
    fresh row and those of the cached one.
    """
    differs = " OR ".join(map(_compare_column, columns))
    cells = ", ".join(f'{source}."{column}"' for source in ("fresh", "cached") for column in columns)
    return (
        "WITH fresh AS (SELECT pairs.key AS session, with_shortest, fresh_rows.* "
        f"FROM kept.{name} AS fresh_rows JOIN pairs ON fresh_rows.log = pairs.fresh_log), "
        "cached AS (SELECT pairs.key AS session, cached_rows.* "
        f"FROM cache.kept.{name} AS cached_rows JOIN pairs ON cached_rows.log = pairs.cached_log) "
        "SELECT coalesce(fresh.session, cached.session), coalesce(fresh.row, cached.row), "
        f"fresh.session IS NULL, cached.session IS NULL, {cells} "
        "FROM fresh FULL JOIN cached ON fresh.session = cached.session AND fresh.row = cached.row "
        f"WHERE fresh.session IS NULL OR cached.session IS NULL OR {differs} ORDER BY 1, 2 LIMIT {MAX_NAMED}"
    )


def _compare_column(column: str) -> str:
    """Return the SQL condition under which a column of two rows differs."""
    differs = f'fresh."{column}" IS DISTINCT FROM cached."{column}"'
    if column in COLUMNS_NEEDING_WORLD:
        return f"(with_shortest AND {differs})"
    return differs


def compare_table_files(folder: Path, recomputed: Path) -> Iterator[str]:
    """Yield the differences of a folder's CSV and Parquet tables from the files of the same names in ``recomputed``.

    ``recomputed`` is the folder of the tables that were recomputed from the logs. At most ``MAX_NAMED`` differences are
    yielded per file.
    """
    files = sorted(folder.iterdir())
    for path in files:
        if path.stem not in TABLES or path.suffix not in _READERS:
            continue
        expected_path = recomputed / path.name
        if not expected_path.exists():
            yield f"{path}: there is no such table"
        elif path.read_bytes() != expected_path.read_bytes():
            yield from islice(_compare_rows(path, expected_path), MAX_NAMED)
    suffixes = {path.suffix for path in files}
    for expected_path in sorted(recomputed.iterdir()):
        is_required = expected_path.stem in TABLES and expected_path.suffix in suffixes
        if is_required and not (folder / expected_path.name).exists():
            yield f"{folder / expected_path.name} is missing"


def compare_pages(page: Path, recomputed: Path) -> Iterator[str]:
    """Yield the first lines of a report page that differ from the page made from recomputed tables."""
    lines = page.read_text(encoding="utf-8").splitlines()
    expected_lines = recomputed.read_text(encoding="utf-8").splitlines()
    differences = (
        _describe_difference(str(page), f"line {number}", _shorten(line), _shorten(expected))
        for number, (line, expected) in enumerate(zip_longest(lines, expected_lines, fillvalue=""), 1)
        if line != expected
    )
    yield from islice(differences, MAX_NAMED)


def _shorten(line: str) -> str:
    """Return a line without tags and repeated spaces, cut to ``MAX_SHOWN`` characters."""
    text = " ".join(re.sub(r"<[^>]*>", " ", line).split())
    if len(text) <= MAX_SHOWN:
        return text
    return f"{text[:MAX_SHOWN]}..."


def _compare_rows(path: Path, expected_path: Path) -> Iterator[str]:
    """Yield the differences of a table's file from ``expected_path``, which was written from the logs.

    If all cells are equal, yield one line which says that only the bytes of the files differ.
    """
    read = _READERS[path.suffix]
    try:
        heads, rows = read(path)
        expected_heads, expected_rows = read(expected_path)
    except (OSError, UnicodeError, ValueError, csv.Error) as error:  # pyarrow raises ValueError
        yield f"{path} cannot be read: {error}"
        return
    if heads != expected_heads:
        changed = sorted({*map(str, heads)} ^ {*map(str, expected_heads)})
        yield f"{path}: the columns are others: {', '.join(changed) or 'in another order'}"
        return
    is_equal = True
    for number, (row, expected) in enumerate(zip_longest(rows, expected_rows), 1):
        if row is None:
            yield f"{path}: row {number} is missing"
            return
        if expected is None:
            yield f"{path}: row {number} is in no log"
            return
        for head, cell, expected_cell in zip_longest(heads, row, expected):
            if not _is_same_cell(cell, expected_cell):
                is_equal = False
                yield _describe_difference(f"{path}: row {number}", str(head), cell, expected_cell)
    if is_equal:
        yield f"{path}: the numbers are those of the logs, but the bytes are not as they are written"


def _is_same_cell(cell: object, expected: object) -> bool:
    are_both_nan = cell != cell and expected != expected
    return cell == expected or are_both_nan


def _describe_difference(location: str, column: str, actual: object, expected: object) -> str:
    return f"{location}, {column} is {actual!r}; the logs say {expected!r}"


def _read_csv(path: Path) -> tuple[_Cells, Iterable[_Cells]]:
    with path.open(newline="", encoding="utf-8") as file:
        heads, *rows = csv.reader(file)
    return heads, rows


def _read_parquet(path: Path) -> tuple[_Cells, Iterable[_Cells]]:
    table = pyarrow.parquet.read_table(path)
    return table.column_names, zip(*(column.to_pylist() for column in table.columns), strict=True)


_READERS = {".csv": _read_csv, ".parquet": _read_parquet}
