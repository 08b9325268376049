"""Tables to files, some rows at a time, so that ten thousand sessions take no more memory than ten."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from minihuman.data.arrow import schema
from minihuman.data.columns import TABLES, dictionary
from minihuman.data.kept_files import KeptFiles
from minihuman.data.table_file import TableFile
from minihuman.data.table_schema import package

Kind = Literal["parquet", "csv"]


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


_WRITERS: dict[Kind, Callable[[Path, pa.Schema], Any]] = {"parquet": _parquet, "csv": _Csv}


def write_tables(
    tables: TableFile,
    folder: Path,
    *,
    names: Sequence[str] = tuple(TABLES),
    kinds: Sequence[Kind] = ("parquet", "csv"),
    without: frozenset[str] = frozenset(),
    kept: KeptFiles | None = None,
) -> tuple[Path, ...]:
    """Write tables into a folder, as Parquet, CSV or both, and beside them what the columns mean; give the files.

    ``dictionary.json`` says it in the shortest form, ``datapackage.json`` as a Frictionless data package. The columns
    ``without`` are left out. What is ``kept`` of the same rows is copied, and what is written kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    explained = {name: columns for name, columns in dictionary(without=without).items() if name in names}
    files = [(name, folder / f"{name}.{kinds[0]}") for name in names]  # the same rows twice are one resource
    described = {
        folder / "dictionary.json": explained,
        folder / "datapackage.json": package("minihuman-tables", files, without=without),
    }
    for path, content in described.items():
        path.write_text(json.dumps(content, indent=1) + "\n")
    for name in names:
        columns = schema(name, without=without)
        wanted = {kind: folder / f"{name}.{kind}" for kind in kinds}
        missing = {kind: path for kind, path in wanted.items() if kept is None or not kept.take(path, columns.names)}
        if not missing:
            continue
        writers = [_WRITERS[kind](path, columns) for kind, path in missing.items()]
        for batch in tables.batches(name, without=without):
            for writer in writers:
                writer.write_table(pa.Table.from_batches([batch]))
        for writer in writers:
            writer.close()
        if kept is not None:
            for path in missing.values():
                kept.keep(path, columns.names)
    return (*(folder / f"{name}.{kind}" for name in names for kind in kinds), *described)
