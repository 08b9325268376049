"""Stimulus tables: reading CSV as spreadsheets write it, and telling labels from options.

A row of a table is one trial. A column is either an option of the world (what is shown, which response is correct) or a
label, which names the kind of trial and which the world never receives.
"""

import csv
import inspect
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import Any

import msgspec

from minihuman.activities.trials.plan import StimuliSpec
from minihuman.errors import ProtocolError
from minihuman.worlds.catalogue import TRIAL_WORLDS

IMAGE = "image"  # the column of image files beside the protocol
COUNT = "times"  # the column of how often a row is presented
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_DECIMAL_COMMA = re.compile(r"-?\d+,\d+")
_TEXT_OPTIONS = frozenset({"text", "left", "right"})  # columns in which "3,5" is a text, not a number

Row = dict[str, Any]


class TableRow(msgspec.Struct, frozen=True):
    """A table row as written, with its position in the file."""

    place: str  # "words.csv:3", "rows[2]"
    cells: Row


def read_table(spec: StimuliSpec, files: Mapping[str, bytes]) -> list[TableRow]:
    """Read the rows of a table as written.

    Raises:
        ProtocolError: if the file is missing or not a valid table; the message names the row.
    """
    if not spec.file:
        return [TableRow(f"rows[{index}]", dict(cells)) for index, cells in enumerate(spec.rows)]
    if spec.file not in files:
        raise ProtocolError(f"the stimulus file {spec.file!r} is not in the protocol's folder; copy it there")
    return list(_read_csv(files[spec.file], spec.file))


def list_images(rows: Sequence[TableRow]) -> list[str]:
    """Return the image files that a table's rows name, each once, in the order of the rows."""
    return list(dict.fromkeys(str(row.cells[IMAGE]) for row in rows if row.cells.get(IMAGE)))


def is_label(column: str, world: str, labels: Sequence[str]) -> bool:
    """Return whether a column is a label: the protocol names it as one, or the world has no option of that name.

    The options of a world from another package are unknown, so there only the protocol decides.
    """
    if column in (IMAGE, COUNT):
        return False
    options = find_option_names(world)
    return column in labels or (options is not None and not options.has(column))


class OptionNames(msgspec.Struct, frozen=True):
    """The names of the options that a world accepts, and the prefixes of such names."""

    names: tuple[str, ...]
    prefix: str = ""

    def has(self, name: str) -> bool:
        """Return whether the world accepts an option of that name."""
        return name in self.names or bool(self.prefix and name.startswith(self.prefix))


@cache
def find_option_names(world: str) -> OptionNames | None:
    """Return the option names of one of this package's trial worlds; None for any other world."""
    if world not in TRIAL_WORLDS:
        return None
    module, _, name = TRIAL_WORLDS[world].partition(":")
    world_class = getattr(import_module(module), name)
    parameters = inspect.signature(world_class).parameters.values()
    names = tuple(parameter.name for parameter in parameters if parameter.kind is parameter.KEYWORD_ONLY)
    has_open_options = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
    return OptionNames(names, world_class.option_prefix if has_open_options else "")


def clean_label(cell: Any) -> Any:
    """Return a label without surrounding spaces, which a spreadsheet does not show."""
    if isinstance(cell, str):
        return cell.strip()
    return cell


def _read_csv(content: bytes, name: str) -> Iterator[TableRow]:
    """Yield the rows of a CSV file, each with its position; ``name`` is the file's name in messages.

    A first line such as "sep=;" states the separator; otherwise the header shows it.
    """
    text = _decode(content, name)
    first_line, _, remaining_text = text.partition("\n")
    stated_separator = re.fullmatch(r"sep=(.)\r?", first_line, re.IGNORECASE)  # a line that Excel reads and writes
    if stated_separator:
        separator = stated_separator[1]
        text = remaining_text
        n_skipped = 1
    else:
        separator = _find_separator(text, name)
        n_skipped = 0
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        header = next(reader, [])
        columns = _read_header(header, name, 1 + n_skipped)
        previous_line = reader.line_num
        for cells in reader:
            place = f"{name}:{previous_line + 1 + n_skipped}"  # a row can span several lines; this is its first
            previous_line = reader.line_num
            if cells:
                yield TableRow(place, _read_row(cells, columns, place, separator))
    except csv.Error as error:
        raise ProtocolError(
            f"{name}:{reader.line_num + n_skipped}: this row is not CSV ({error}); save the table as 'CSV UTF-8'"
        ) from error


def _decode(content: bytes, name: str) -> str:
    """Decode a table in UTF-8, with or without a byte-order mark, or in UTF-16 with one.

    Raises:
        ProtocolError: if the table is in another encoding or has a zero byte; the message names the row.
    """
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    else:
        encoding = "utf-8-sig"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise ProtocolError(
            f"{name}:{row}: this row is not in UTF-8 (byte 0x{content[error.start]:02X}, "
            f"{content[error.start : error.start + 1].decode('cp1252', 'replace')!r} in Windows' own encoding); save "
            "the table as 'CSV UTF-8'"
        ) from error
    if "\0" in text:
        row = text.count("\n", 0, text.index("\0")) + 1
        raise ProtocolError(f"{name}:{row}: this row holds a zero byte; save the table as 'CSV UTF-8'")
    return text


def _find_separator(text: str, name: str) -> str:
    """Return the cell separator that occurs most in the header outside quotes; a comma if none occurs.

    Raises:
        ProtocolError: if two separators occur most, and equally often.
    """
    header = re.sub(r'"[^"]*"', "", text.partition("\n")[0])
    counts = {separator: header.count(separator) for separator in _SEPARATORS}
    highest_count = max(counts.values())
    candidates = [separator for separator, count in counts.items() if count == highest_count]
    if highest_count and len(candidates) > 1:
        separators = " and ".join(_SEPARATORS[separator] for separator in candidates)
        raise ProtocolError(f"{name}:1: the header has {separators}; use one of them between cells")
    return candidates[0]


def _read_header(header: Sequence[str], name: str, row: int) -> list[str]:
    """Return the column names of a header, which is row ``row``, without the empty cells that a spreadsheet appends.

    Raises:
        ProtocolError: if there is no column, or a column has no name or the name of another.
    """
    columns = list(header)
    while columns and not columns[-1].strip():
        columns.pop()
    for number, column in enumerate(columns, 1):
        if not column.strip():
            raise ProtocolError(f"{name}:{row}: column {number} has no name; give it one, or delete it")
        if column in columns[: number - 1]:
            raise ProtocolError(f"{name}:{row}: column {number} is {column!r} again; rename or delete it")
    if not columns:
        raise ProtocolError(f"{name}:{row}: there is no header; begin with a row of the columns' names")
    return columns


def _read_row(cells: Sequence[str], columns: Sequence[str], place: str, separator: str) -> Row:
    """Return a row's cells by column, without the empty ones; raise `ProtocolError` unless each column has a cell."""
    surplus = cells[len(columns) :]
    if len(cells) < len(columns) or any(cell.strip() for cell in surplus):
        raise ProtocolError(
            f"{place}: this row has more or fewer cells than the header ({len(cells)}, not {len(columns)}); give it "
            "one cell per column"
        )
    return {
        column: _read_cell(cell, decimal_comma=separator != "," and column not in _TEXT_OPTIONS)
        for column, cell in zip(columns, cells, strict=False)
        if cell != ""
    }


def _read_cell(cell: str, *, decimal_comma: bool) -> str | int | float:
    """Return a cell as a number if it is written in plain form, else as text: "007", "1_0" and "nan" are texts.

    ``decimal_comma`` says that "3,5" is a number.
    """
    if decimal_comma and _DECIMAL_COMMA.fullmatch(cell):
        return float(cell.replace(",", "."))
    for kind in (int, float):
        try:
            number = kind(cell)
        except ValueError:
            continue
        if str(number) == cell and math.isfinite(number):
            return number
    return cell
