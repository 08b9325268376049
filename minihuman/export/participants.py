"""What the laboratory knows of people beside their play: ``participants.csv`` in the study's folder."""

import csv
from collections.abc import Callable
from pathlib import Path

from minihuman.errors import ExportError
from minihuman.study.about import About, Kind, ParticipantColumn

FILE_NAME = "participants.csv"


def read_participants(source: Path, about: About) -> dict[str, dict[str, str]]:
    """The columns that the protocol names, by participant; nothing where there is no such file.

    Raises:
        ExportError: if the file has no column of codes, a column that the protocol names is missing, a participant is
            there twice or a value is not what the protocol says.
    """
    folder = source if source.is_dir() else source.parent
    path = folder / FILE_NAME
    if not path.is_file() or not about.participants:
        return {}
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = list(csv.DictReader(file))
    named = {column.name for column in about.participants}
    missing = sorted({"participant", *named} - set(rows[0] if rows else {"participant", *named}))
    if missing:
        raise ExportError(f"{path} has no column {missing[0]!r}; its first line names the columns")
    found: dict[str, dict[str, str]] = {}
    for line, row in enumerate(rows, 2):
        code = row["participant"]
        if code in found:
            raise ExportError(f"{path}:{line}: {code!r} is there twice; leave one line")
        for column in about.participants:
            _check(column, row[column.name], f"{path}:{line}")
        found[code] = {name: row[name] for name in named}
    return found


def _check(column: ParticipantColumn, value: str, where: str) -> None:
    """Refuse a value that is not what the protocol says; nothing at all is always one."""
    if not value:
        return
    if column.levels and value not in column.levels:
        raise ExportError(f"{where}: {column.name} is {value!r}; use {', '.join(column.levels)}")
    readers: dict[Kind, Callable[[str], object]] = {"text": str, "whole": int, "number": float, "yes_no": _yes_no}
    try:
        readers[column.kind](value)
    except ValueError:
        raise ExportError(f"{where}: {column.name} is {value!r}, which is not of kind {column.kind!r}") from None


def _yes_no(value: str) -> bool:
    if value.lower() not in ("true", "false"):
        raise ValueError(value)
    return value.lower() == "true"
