"""Tables to files, a few sessions at a time, so that ten thousand sessions take no more memory than ten."""

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from minihuman.data.columns import TABLES, dictionary, schema
from minihuman.data.rows import Rows, together
from minihuman.data.table_schema import package

Kind = Literal["parquet", "csv"]
_SESSIONS = 64  # made Arrow together, so that not every column is made for every session,
_ROWS = 100_000  # or fewer sessions with so many rows in all tables
_BYTES = 256 * 1024  # of a table held back, so that a small one is not a row group for each of those few sessions


def _parquet(path: Path, columns: pa.Schema) -> pa.parquet.ParquetWriter:
    """A writer that keeps a dictionary of what recurs; of measured numbers it would take time and space for nothing."""
    recurring = [field.name for field in columns if not pa.types.is_floating(field.type)]
    return pa.parquet.ParquetWriter(path, columns, compression="zstd", use_dictionary=recurring)


class _Csv:
    """CSV as pandas, polars, R and DuckDB read it alike: TRUE and FALSE, and nothing at all where nothing is known."""

    def __init__(self, path: Path, columns: pa.Schema) -> None:
        self._yes_no = [name for name in columns.names if pa.types.is_boolean(columns.field(name).type)]
        said = [field.with_type(pa.string()) if field.name in self._yes_no else field for field in columns]
        self._writer = pa.csv.CSVWriter(path, pa.schema(said))

    def write_table(self, table: pa.Table) -> None:
        for name in self._yes_no:
            place = table.schema.get_field_index(name)
            said = pc.if_else(table.column(name), "TRUE", "FALSE")
            table = table.set_column(place, table.schema.field(place).with_type(pa.string()), said)
        self._writer.write_table(table)

    def close(self) -> None:
        self._writer.close()


_WRITERS: dict[Kind, Callable[[Path, pa.Schema], Any]] = {"parquet": _parquet, "csv": _Csv}


class TableWriter:
    """Writes every table into a folder, as Parquet, CSV or both, and beside them what the columns mean.

    ``dictionary.json`` says it in the shortest form, ``datapackage.json`` as a Frictionless data package.

    The columns ``without`` are left out.
    """

    def __init__(
        self, folder: Path, *, kinds: Sequence[Kind] = ("parquet", "csv"), without: frozenset[str] = frozenset()
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.paths = tuple(folder / f"{name}.{kind}" for name in TABLES for kind in kinds)
        self.dictionary = folder / "dictionary.json"
        self.dictionary.write_text(json.dumps(dictionary(without=without), indent=1) + "\n")
        self.package = folder / "datapackage.json"
        first = kinds[0]  # the same rows twice are one resource
        files = [(name, folder / f"{name}.{first}") for name in TABLES]
        described = package("minihuman-tables", files, without=without)
        self.package.write_text(json.dumps(described, indent=1) + "\n")
        self._without = without
        self._fresh: list[Rows] = []
        self._rows = 0  # of those
        self._waiting: dict[str, list[pa.Table]] = {name: [] for name in TABLES}
        self._writers = {
            name: [_WRITERS[kind](folder / f"{name}.{kind}", schema(name, without=without)) for kind in kinds]
            for name in TABLES
        }

    def write(self, rows: Rows) -> None:
        """Take one session's rows."""
        self._fresh.append(rows)
        self._rows += sum(rows.count(name) for name in rows)
        if len(self._fresh) >= _SESSIONS or self._rows >= _ROWS:
            self._settle()

    def close(self) -> None:
        """Write what is held back and finish the files."""
        self._settle()
        for name in TABLES:
            self._flush(name)
            for writer in self._writers[name]:
                writer.close()

    def __enter__(self) -> "TableWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _settle(self) -> None:
        """Make Arrow of the sessions that came last, and write the tables of which enough is held back."""
        if not self._fresh:
            return
        for name, waiting in self._waiting.items():
            waiting.append(together(name, self._fresh))
            if sum(table.nbytes for table in waiting) >= _BYTES:
                self._flush(name)
        self._fresh.clear()
        self._rows = 0

    def _flush(self, name: str) -> None:
        if self._waiting[name]:
            columns = schema(name, without=self._without).names
            table = pa.concat_tables(self._waiting[name]).select(columns)
            for writer in self._writers[name]:
                writer.write_table(table)
            self._waiting[name].clear()


def write_tables(sessions: Iterable[Rows], folder: Path) -> tuple[Path, ...]:
    """Write every session's rows and the data dictionary; give the files."""
    with TableWriter(folder) as writer:
        for rows in sessions:
            writer.write(rows)
    return (*writer.paths, writer.dictionary, writer.package)
