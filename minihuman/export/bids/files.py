"""BIDS's files: tab-separated tables, JSON beside them, and names made of labels."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from minihuman.errors import ExportError

MISSING = "n/a"


def label(text: str) -> str:
    """A label: letters and digits only, as BIDS has them."""
    return re.sub(r"[^A-Za-z0-9]", "", text)


def subject(participant: str, known: dict[str, str]) -> str:
    """A participant's label, "sub-07"; ``known`` keeps whose each is.

    Raises:
        ExportError: if another participant's code makes the same label.
    """
    name = "sub-" + label(participant.removeprefix("sub-"))
    if known.setdefault(name, participant) != participant:
        raise ExportError(f"participants {known[name]!r} and {participant!r} are both {name} in BIDS; rename one")
    return name


def write_tsv(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]], *, header: bool = True) -> Path:
    """Write a table; what is missing is "n/a"."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["\t".join(columns)] if header else []
    lines += ["\t".join(_cell(row.get(column)) for column in columns) for row in rows]
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return path


def write_json(path: Path, value: Mapping[str, Any]) -> Path:
    """Write what has a value; None, "" and empty lists are left out."""
    path.parent.mkdir(parents=True, exist_ok=True)
    said = {name: part for name, part in value.items() if part not in (None, "", [], {})}
    path.write_text(json.dumps(said, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def _cell(value: Any) -> str:
    if value is None or value == "" or value != value:
        return MISSING
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.9f}".rstrip("0").rstrip(".") if abs(value) < 1e9 else repr(value)
    return re.sub(r"[\t\r\n]+", " ", str(value)) or MISSING
