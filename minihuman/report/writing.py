"""Tables to files, a few sessions at a time, so that ten thousand sessions take no more memory than ten."""

import json
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from minihuman.report.columns import TABLES, dictionary, schema
from minihuman.report.tables import Rows

Kind = Literal["parquet", "csv"]
_ROWS = 50_000  # held back per table, so that a Parquet file is not one row group a session
_TABLES = 64  # held back before they are made one: a table of a single row takes as much as one of hundreds


_WRITERS: dict[Kind, Callable[[Path, pa.Schema], Any]] = {
    "parquet": partial(pa.parquet.ParquetWriter, compression="zstd"),
    "csv": pa.csv.CSVWriter,
}


class TableWriter:
    """Writes every table into a folder, as Parquet, CSV or both, and what the columns mean as ``dictionary.json``.

    The columns ``without`` are left out.
    """

    def __init__(
        self, folder: Path, *, kinds: Sequence[Kind] = ("parquet", "csv"), without: frozenset[str] = frozenset()
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.paths = tuple(folder / f"{name}.{kind}" for name in TABLES for kind in kinds)
        self.dictionary = folder / "dictionary.json"
        self.dictionary.write_text(json.dumps(dictionary(without=without), indent=1) + "\n")
        self._without = without
        self._waiting: dict[str, list[pa.Table]] = {name: [] for name in TABLES}
        self._writers = {
            name: [_WRITERS[kind](folder / f"{name}.{kind}", schema(name, without=without)) for kind in kinds]
            for name in TABLES
        }

    def write(self, rows: Rows) -> None:
        """Take one session's rows."""
        for name, table in rows.items():
            self._waiting[name].append(table)
            if len(self._waiting[name]) >= _TABLES:
                self._waiting[name] = [pa.concat_tables(self._waiting[name]).combine_chunks()]
            if sum(waiting.num_rows for waiting in self._waiting[name]) >= _ROWS:
                self._flush(name)

    def close(self) -> None:
        """Write what is held back and finish the files."""
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

    def _flush(self, name: str) -> None:
        if self._waiting[name]:
            columns = schema(name, without=self._without).names
            table = pa.concat_tables(self._waiting[name]).select(columns)
            for writer in self._writers[name]:
                writer.write_table(table)
            self._waiting[name] = []


def write_tables(sessions: Iterable[Rows], folder: Path) -> tuple[Path, ...]:
    """Write every session's rows and the data dictionary; give the files."""
    with TableWriter(folder) as writer:
        for rows in sessions:
            writer.write(rows)
    return (*writer.paths, writer.dictionary)
