"""Tables to files, a few sessions at a time, so that ten thousand sessions take no more memory than ten."""

import json
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from minihuman.report.columns import TABLES, dictionary, schema
from minihuman.report.tables import Rows

_ROWS = 50_000  # held back per table, so that a Parquet file is not one row group a session


class TableWriter:
    """Writes every table as Parquet and CSV into a folder, and what the columns mean as ``dictionary.json``."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.paths = tuple(folder / f"{name}.{kind}" for name in TABLES for kind in ("parquet", "csv"))
        self.dictionary = folder / "dictionary.json"
        self.dictionary.write_text(json.dumps(dictionary(), indent=1) + "\n")
        self._waiting: dict[str, list[pa.Table]] = {name: [] for name in TABLES}
        self._parquet = {
            name: pa.parquet.ParquetWriter(folder / f"{name}.parquet", schema(name), compression="zstd")
            for name in TABLES
        }
        self._csv = {name: pa.csv.CSVWriter(folder / f"{name}.csv", schema(name)) for name in TABLES}

    def write(self, rows: Rows) -> None:
        """Take one session's rows."""
        for name, table in rows.items():
            self._waiting[name].append(table)
            if sum(waiting.num_rows for waiting in self._waiting[name]) >= _ROWS:
                self._flush(name)

    def close(self) -> None:
        """Write what is held back and finish the files."""
        for name in TABLES:
            self._flush(name)
            self._parquet[name].close()
            self._csv[name].close()

    def __enter__(self) -> "TableWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _flush(self, name: str) -> None:
        if self._waiting[name]:
            table = pa.concat_tables(self._waiting[name])
            self._parquet[name].write_table(table)
            self._csv[name].write_table(table)
            self._waiting[name] = []


def write_tables(sessions: Iterable[Rows], folder: Path) -> tuple[Path, ...]:
    """Write every session's rows and the data dictionary; give the files."""
    with TableWriter(folder) as writer:
        for rows in sessions:
            writer.write(rows)
    return (*writer.paths, writer.dictionary)
