"""An answer to a question in SQL, as lines to read or as CSV."""

import io
from collections.abc import Iterator

import pyarrow as pa
import pyarrow.csv

SHOWN = 100  # rows; more are for a file


def as_csv(answer: pa.Table) -> str:
    """Every row, under the columns' names."""
    file = io.BytesIO()
    pa.csv.write_csv(answer, file)
    return file.getvalue().decode()


def as_lines(answer: pa.Table) -> Iterator[str]:
    """The first rows, in columns; what is missing is a dot."""
    rows = [[_said(value) for value in row.values()] for row in answer.slice(0, SHOWN).to_pylist()]
    widths = [max(map(len, column)) for column in zip(answer.column_names, *rows, strict=True)]
    numbers = [pa.types.is_integer(kind) or pa.types.is_floating(kind) for kind in answer.schema.types]
    for row in (answer.column_names, *rows):
        cells = zip(row, widths, numbers, strict=True)
        yield "  ".join(cell.rjust(width) if number else cell.ljust(width) for cell, width, number in cells).rstrip()
    if answer.num_rows > SHOWN:
        yield f"({answer.num_rows} rows, {SHOWN} of them shown; --csv prints all)"


def _said(value: object) -> str:
    return "." if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
