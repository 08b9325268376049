"""The files beside a protocol: pictures, sounds, and tables of stimuli, which a spreadsheet's cells are pasted into.

A file's name comes from a page, so it is never a path: it names a file in the protocol's folder, with the suffix of a
kind that a study shows or reads. Programs and protocols are not among these kinds.
"""

import csv
import hashlib
import io
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from minihuman.admin.protocol_file import MAX_PICTURE_BYTES, MAX_PROTOCOL_BYTES
from minihuman.builder.edit_errors import EditRefusedError
from minihuman.builder.messages import EditRefusal, Media, MediaFile, StimulusTable, TableRequest
from minihuman.storage.durable_files import replace_durably
from minihuman.storage.outside_names import OutsideNameError, require_name

MEDIA_TYPES = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".webp": "image/webp",
    ".wav": "audio/wav",
    ".mp3": "audio/mpeg",
    ".ogg": "audio/ogg",
    ".flac": "audio/flac",
    ".csv": "text/csv",
    ".tsv": "text/tab-separated-values",
}
MAX_MEDIA_BYTES = MAX_PICTURE_BYTES
MAX_FILES = 1000  # that are listed
_SEPARATORS = (",", ";", "\t")  # of a table's first line, the more frequent first


class MediaFolder:
    """The files in the folder of a protocol.

    Args:
        folder: the folder.
        tree: the protocol's values, which say where a file is used.
    """

    def __init__(self, folder: Path, tree: dict[str, Any]) -> None:
        self._folder = folder.resolve()
        self._tree = tree

    def list_files(self) -> Media:
        """List the files of the kinds that a study shows or reads, with the fields that name them."""
        uses: dict[str, list[list[str | int]]] = {}
        for field, text in _yield_texts(self._tree):
            uses.setdefault(text, []).append(field)
        files = []
        for path in islice(self._find_files(), MAX_FILES):
            name = path.relative_to(self._folder).as_posix()
            files.append(MediaFile(name, path.stat().st_size, MEDIA_TYPES[path.suffix.lower()], uses.get(name, [])))
        return Media(files)

    def read(self, name: str) -> tuple[bytes, str]:
        """Return the content and the media type of a file.

        Raises:
            EditRefusedError: if there is no such file.
        """
        path = self._find_file(name)
        return path.read_bytes(), MEDIA_TYPES[path.suffix.lower()]

    def write(self, name: str, content: bytes, *, replace: bool = False) -> Media:
        """Write a file into the folder, and return the list of all files in it.

        Raises:
            EditRefusedError: if the name is not valid, or a file with other content has it and is not to be replaced.
            OSError: if the file cannot be written.
        """
        path = self._find_target(name)
        if path.exists() and not replace and path.read_bytes() != content:
            raise EditRefusedError(
                EditRefusal("exists", f"there is another {name} already; replace it, or rename the file")
            )
        with replace_durably(path, mode=0o644) as file:
            file.write(content)
        return self.list_files()

    def read_table(self, name: str) -> StimulusTable:
        """Read a table of stimuli.

        Raises:
            EditRefusedError: if there is no such table, or it is not CSV.
        """
        content, _ = self.read(name)
        rows, _ = _parse_table(content, name)
        columns, *stimuli = rows or [[]]
        return StimulusTable(name, hashlib.sha256(content).hexdigest(), columns, [row for row in stimuli if row])

    def write_table(self, request: TableRequest) -> StimulusTable:
        """Write a table of stimuli unless its cells are the same, and return it as the file has it then.

        Raises:
            EditRefusedError: if the file's name is not valid, the file has changed since it was read or is not CSV, or
                the rows do not fit the columns.
            OSError: if the file cannot be written.
        """
        path = self._find_target(request.name)
        old = path.read_bytes() if path.exists() else b""
        version = hashlib.sha256(old).hexdigest() if path.exists() else ""
        if version != request.version:
            message = (
                f"{request.name} was changed elsewhere in the meantime; look at it as it is now, and edit it again"
            )
            raise EditRefusedError(EditRefusal("conflict", message))
        separator = "\t" if path.suffix.lower() == ".tsv" else ","
        if old:
            _, separator = _parse_table(old, request.name)
        columns, rows = request.columns, request.rows
        if request.pasted:
            columns, *rows = _parse_pasted(request.pasted)
        content = _format_table(request.name, columns, rows, separator)
        if not old or _parse_table(content, request.name)[0] != _parse_table(old, request.name)[0]:
            self.write(request.name, content, replace=True)
        return self.read_table(request.name)

    def _find_files(self) -> Iterator[Path]:
        """Yield the files of `MEDIA_TYPES` in the folder and in the folders directly in it, without hidden ones."""
        for pattern in ("*", "*/*"):
            for path in sorted(self._folder.glob(pattern)):
                is_hidden = any(part.startswith(".") for part in path.relative_to(self._folder).parts)
                if path.suffix.lower() in MEDIA_TYPES and path.is_file() and not is_hidden:
                    yield path

    def _find_file(self, name: str) -> Path:
        """Return the path of an existing file.

        Raises:
            EditRefusedError: if there is no such file in the folder, or its kind is none that a study has.
        """
        try:
            path = (self._folder / name).resolve()
            is_inside = path.is_relative_to(self._folder) and path.suffix.lower() in MEDIA_TYPES and path.is_file()
        except (OSError, ValueError):
            is_inside = False
        if not is_inside:
            raise EditRefusedError(EditRefusal("not_there", f"there is no file {name!r} beside the protocol"))
        return path

    def _find_target(self, name: str) -> Path:
        """Return the path of a file that may be written: an existing one, or a new one directly in the folder.

        Raises:
            EditRefusedError: if the name is not valid, or the kind of file is none that a study has.
        """
        path = (self._folder / name).resolve()
        if path.is_file() and path.is_relative_to(self._folder) and path.suffix.lower() in MEDIA_TYPES:
            return path
        try:
            require_name(name, "the file")
        except OutsideNameError as error:
            raise EditRefusedError(EditRefusal("not_valid", str(error))) from error
        if path.suffix.lower() not in MEDIA_TYPES:
            kinds = ", ".join(MEDIA_TYPES)
            raise EditRefusedError(
                EditRefusal("not_valid", f"{name!r} is none of the kinds of file of a study: {kinds}")
            )
        return self._folder / name


def _yield_texts(content: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[list[str | int], str]]:
    """Yield the path of each text in a value of a protocol, and the text; ``path`` is the path of the value."""
    if isinstance(content, str):
        yield list(path), content
    elif isinstance(content, dict):
        for key, member in content.items():
            yield from _yield_texts(member, (*path, key))
    elif isinstance(content, list):
        for number, element in enumerate(content):
            yield from _yield_texts(element, (*path, number))


def _parse_table(content: bytes, name: str) -> tuple[list[list[str]], str]:
    """Return the rows of a CSV file, the first one with the columns' names, and the separator of its cells.

    ``name`` is the file's name, for the text of an error.

    Raises:
        EditRefusedError: if the file is not CSV.
    """
    encoding = "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = content.decode(encoding)
        first_line, _, further_lines = text.partition("\n")
        separator = max(_SEPARATORS, key=first_line.count)
        if first_line.lower().startswith("sep="):  # a line that declares the separator for Excel
            separator = first_line[4:5]
            text = further_lines
        return list(csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)), separator
    except (UnicodeDecodeError, csv.Error, TypeError) as error:
        message = f"{name} is not a table ({error}); save it as 'CSV UTF-8'"
        raise EditRefusedError(EditRefusal("not_valid", message)) from error


def _parse_pasted(text: str) -> list[list[str]]:
    """Return the rows of cells that were copied from a spreadsheet, or of lines of CSV, without empty rows.

    Raises:
        EditRefusedError: if no row has a text.
    """
    separator = max(("\t", ",", ";"), key=text.partition("\n")[0].count)
    rows = [row for row in csv.reader(io.StringIO(text, newline=""), delimiter=separator) if any(map(str.strip, row))]
    if not rows:
        raise EditRefusedError(EditRefusal("not_valid", "nothing was pasted; copy the cells with the columns' names"))
    return [[cell.strip() for cell in row] for row in rows]


def _format_table(name: str, columns: Sequence[str], rows: Sequence[Sequence[str]], separator: str) -> bytes:
    """Return a table as CSV in UTF-8; missing cells at the end of a row are empty.

    ``name`` is the file's name, for the text of an error.

    Raises:
        EditRefusedError: if the columns' names are not distinct texts, a row is too long, or the table is too large.
    """
    if not all(columns) or len(set(columns)) < len(columns) or not columns:
        raise EditRefusedError(
            EditRefusal("not_valid", f"the columns of {name} are {', '.join(columns)}; give each a name")
        )
    for number, row in enumerate(rows, 1):
        if len(row) > len(columns):
            message = f"row {number} of {name} has {len(row)} cells for {len(columns)} columns; remove the others"
            raise EditRefusedError(EditRefusal("not_valid", message))
    padded = [[*row, *[""] * (len(columns) - len(row))] for row in rows]
    text = io.StringIO(newline="")
    csv.writer(text, delimiter=separator, lineterminator="\n").writerows([columns, *padded])
    content = text.getvalue().encode()
    if len(content) > MAX_PROTOCOL_BYTES:
        message = f"{name} would have {len(content)} bytes; a table has {MAX_PROTOCOL_BYTES} at most"
        raise EditRefusedError(EditRefusal("not_valid", message))
    return content
