"""Write tables to CSV and Parquet with their data dictionary, some rows at a time: 10,000 sessions need no more memory
than ten.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from minihuman.dataset.rows import arrow_schema
from minihuman.dataset.store import TableDatabase
from minihuman.dataset.table_columns import TABLES, build_data_dictionary, build_data_package

TableFormat = Literal["parquet", "csv"]


def _parquet(path: Path, columns: pa.Schema) -> pa.parquet.ParquetWriter:
    """A writer that keeps a dictionary of what recurs.

    The smallest and largest value of a piece of a column are kept of numbers: who reads them skips pieces by them.
    Of texts, which stand in the order of sessions, they would take a third of the time.
    """
    numbers = [field.name for field in columns if not pa.types.is_string(field.type)]
    return pa.parquet.ParquetWriter(path, columns, compression="zstd", use_dictionary=True, write_statistics=numbers)


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


_WRITERS: dict[TableFormat, Callable[[Path, pa.Schema], Any]] = {"parquet": _parquet, "csv": _Csv}


def write_tables(
    tables: TableDatabase,
    folder: Path,
    *,
    names: Sequence[str] = tuple(TABLES),
    kinds: Sequence[TableFormat] = ("parquet", "csv"),
    without: frozenset[str] = frozenset(),
    empty: bool = False,
) -> tuple[Path, ...]:
    """Write the tables that have rows into a folder, as Parquet, CSV or both; give the files.

    Beside them is what the columns mean:
    ``dictionary.json`` says it in the shortest form, ``datapackage.json`` as a Frictionless data package. The columns
    ``without`` are excluded; ``empty`` writes the tables without rows too.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = [name for name in names if empty or tables.count(name)]
    files = [(name, folder / f"{name}.{kinds[0]}") for name in names]  # the same rows twice are one resource
    explained = {name: columns for name, columns in build_data_dictionary(without=without).items() if name in names}
    described = {
        folder / "dictionary.json": explained,
        folder / "datapackage.json": build_data_package("minihuman-tables", files, without=without),
    }
    for path, content in described.items():
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8", newline="\n")
    for name in names:
        columns = arrow_schema(name, without=without)
        writers = [_WRITERS[kind](folder / f"{name}.{kind}", columns) for kind in kinds]
        for batch in tables.batches(name, without=without):
            for writer in writers:
                writer.write_table(pa.Table.from_batches([batch]))
        for writer in writers:
            writer.close()
    return (*(folder / f"{name}.{kind}" for name in names for kind in kinds), *described)
