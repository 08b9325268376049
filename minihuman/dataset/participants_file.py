"""Read a laboratory's `participants.csv`, which holds what the sessions do not: age, handedness and the like.

The protocol says which of its columns are read, and what may stand in them. The file is read as spreadsheets write it:
as UTF-8, as UTF-16 or in the Windows encoding of Western Europe, with commas, semicolons or tabs. This module knows no
tables and no sessions.
"""

import codecs
import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from minihuman.dataset.study_facts import find_study_folder
from minihuman.errors import MinihumanError
from minihuman.experiment.protocol.specs import ColumnType, ParticipantColumnSpec

FILE_NAME = "participants.csv"
CODE_COLUMN = "participant"
PersonValue = str | int | float | bool | None  # None: missing
_WAY_OUT = 'in a spreadsheet, save the file as "CSV UTF-8"'
_DELIMITERS = (",", ";", "\t")  # semicolons where the decimal mark is a comma; tabs in Excel's "Unicode Text"
_MISSING = frozenset({"", "NA", "N/A", "n/a", "NaN", "nan", "."})  # as R, pandas, SPSS and BIDS write a missing value
_INTEGER = re.compile(r"[+-]?[0-9]+(\.0+)?")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_MAX_INTEGER = 2**63 - 1


class ParticipantsFileError(MinihumanError, ValueError):
    """A laboratory's `participants.csv` cannot be read, or does not fit the protocol."""


@dataclass(frozen=True, slots=True)
class ParticipantsFile:
    """The declared columns of a `participants.csv`, by participant code, and notes about how it was read."""

    rows: Mapping[str, Mapping[str, PersonValue]]
    notes: tuple[str, ...] = ()


def find_participants_file(source: Path) -> Path:
    """Return the path of `participants.csv`, which need not exist, in the folder of the study that ``source`` is in."""
    return find_study_folder(source) / FILE_NAME


def read_participants_file(source: Path, columns: Sequence[ParticipantColumnSpec]) -> ParticipantsFile:
    """Read the declared columns of a study's `participants.csv`; without a file or such columns, there are no rows.

    Other columns of the file are ignored, because they may hold names or addresses.

    Raises:
        ParticipantsFileError: if the file cannot be read, has no column of codes, lacks a declared column, lists a
            participant twice, or has a value that the protocol does not allow.
    """
    path = find_participants_file(source)
    if not columns or not path.is_file():
        return ParticipantsFile({})
    text, notes = _decode(path)
    delimiter = _find_delimiter(text)
    rows_by_code: dict[str, dict[str, PersonValue]] = {}
    for line, cells in _read_lines(path, text, delimiter, [column.name for column in columns]):
        code = cells[CODE_COLUMN]
        if code in rows_by_code:
            raise ParticipantsFileError(f"{path}:{line}: {code!r} appears twice; keep one of the lines")
        rows_by_code[code] = {
            column.name: _parse_cell(column, cells[column.name], f"{path}:{line}", delimiter) for column in columns
        }
    return ParticipantsFile(rows_by_code, notes)


def names_participant(study_dir: Path, code: str) -> bool:
    """Return whether a study's `participants.csv` has a cell with a participant's code, whatever the file's encoding.

    Return False if the study has no such file.
    """
    path = find_participants_file(study_dir)
    if not path.is_file():
        return False
    without_zeros = path.read_bytes().replace(b"\0", b"")  # UTF-16 writes the ASCII letters of a code with zero bytes
    return code in re.split(r'[\s,;"]+', without_zeros.decode("latin-1"))


def _decode(path: Path) -> tuple[str, tuple[str, ...]]:
    """Return the file's text, and a note if its encoding had to be assumed.

    Raises:
        ParticipantsFileError: if the text cannot be decoded.
    """
    content = path.read_bytes()
    encoding = "utf-8-sig"
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif b"\0" in content:
        raise ParticipantsFileError(f"{path} is no text in UTF-8: byte {content.index(0)} is zero; {_WAY_OUT}")
    try:
        return content.decode(encoding), ()
    except UnicodeDecodeError as error:
        if encoding == "utf-16":
            raise ParticipantsFileError(f"{path}: byte {error.start} is not valid UTF-16; {_WAY_OUT}") from None
    try:
        text = content.decode("cp1252")
    except UnicodeDecodeError as error:
        raise ParticipantsFileError(f"{path}: byte {error.start} is not valid UTF-8; {_WAY_OUT}") from None
    word = next(word for word in re.split(r"[\s,;]+", text) if not word.isascii())
    note = f"{path.name} is not in UTF-8 and was read as Windows-1252, with words such as {word!r}; if that is wrong, "
    return text, (note + _WAY_OUT,)


def _find_delimiter(text: str) -> str:
    """Return the delimiter by which the first line has the column of codes; a comma if none does."""
    first_line = text.partition("\n")[0].rstrip("\r")
    for delimiter in _DELIMITERS:
        if CODE_COLUMN in _split_head(first_line, delimiter):
            return delimiter
    return ","


def _split_head(line: str, delimiter: str) -> list[str]:
    heads = next(csv.reader([line], delimiter=delimiter), [])
    return [head.strip() for head in heads]


def _read_lines(
    path: Path, text: str, delimiter: str, columns: Sequence[str]
) -> Iterator[tuple[int, Mapping[str, str]]]:
    """Yield the number and the cells, by column name, of each line that is not blank; missing cells are empty.

    Spaces around names and cells are removed.

    Raises:
        ParticipantsFileError: if the column of codes or one of ``columns`` is missing or named twice, if a line has
            more cells than there are columns, or if the text is not valid CSV.
    """
    reader = csv.reader(text.splitlines(keepends=True), delimiter=delimiter)
    try:
        heads = [head.strip() for head in next(reader, [])]
        _check_heads(path, heads, columns)
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) > len(heads):
                raise ParticipantsFileError(
                    f"{path}:{reader.line_num}: there are {len(cells)} cells under {len(heads)} columns; put a text "
                    f"with {delimiter!r} in quotation marks"
                )
            cells += [""] * (len(heads) - len(cells))
            yield reader.line_num, dict(zip(heads, map(str.strip, cells), strict=True))
    except csv.Error as error:
        raise ParticipantsFileError(f"{path}:{reader.line_num}: cannot be read: {error}; {_WAY_OUT}") from None


def _check_heads(path: Path, heads: Sequence[str], columns: Sequence[str]) -> None:
    """Raise ParticipantsFileError if the column of codes or one of ``columns`` is missing or appears twice."""
    missing = sorted({CODE_COLUMN, *columns}.difference(heads))
    if missing:
        raise ParticipantsFileError(
            f"{path} has no column {missing[0]!r}; add it to the first line, which names the columns"
        )
    doubled = next((head for head in (CODE_COLUMN, *columns) if heads.count(head) > 1), "")
    if doubled:
        raise ParticipantsFileError(f"{path} has two columns {doubled!r}; remove or rename one of them")


def _parse_cell(column: ParticipantColumnSpec, cell: str, location: str, delimiter: str) -> PersonValue:
    """Convert a cell to its column's type; return None for a missing value.

    In a column of free texts, only an empty cell is missing. In other columns, so are words such as "NA".

    Args:
        column: the column as the protocol declares it.
        cell: the text of the cell.
        location: the file and the line, with which an error message begins.
        delimiter: the file's delimiter; beside semicolons, a comma is the decimal mark.

    Raises:
        ParticipantsFileError: if the protocol does not allow the value.
    """
    is_free_text = column.type == "text" and not column.levels
    if not cell or (cell in _MISSING and not is_free_text and cell not in column.levels):
        return None
    if column.levels and cell not in column.levels:
        raise ParticipantsFileError(f"{location}: {column.name} is {cell!r}; use one of {', '.join(column.levels)}")
    if delimiter == ";" and column.type == "number":
        cell = cell.replace(",", ".")
    parsed = _PARSERS[column.type](cell)
    if parsed is None:
        raise ParticipantsFileError(f"{location}: {column.name} is {cell!r}; use a value of type {column.type}")
    return parsed


def _parse_integer(cell: str) -> int | None:
    """Parse an integer of at most 64 bits, such as "12" or "12.0"; return None for any other text."""
    if not _INTEGER.fullmatch(cell):
        return None
    number = int(cell.partition(".")[0])
    if abs(number) > _MAX_INTEGER:
        return None
    return number


def _parse_number(cell: str) -> float | None:
    """Parse a decimal number; return None for any other text."""
    if not _NUMBER.fullmatch(cell):
        return None
    return float(cell)


def _parse_boolean(cell: str) -> bool | None:
    """Parse "true" or "false" in any case; return None for any other text."""
    return {"true": True, "false": False}.get(cell.lower())


_PARSERS: Mapping[ColumnType, Callable[[str], PersonValue]] = {
    "text": str,
    "integer": _parse_integer,
    "number": _parse_number,
    "boolean": _parse_boolean,
}
