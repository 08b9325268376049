"""The protocols that come with the package: templates to copy, and examples of what a study's tables contain."""

import tomllib
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from minihuman.admin.protocol_file import find_shipped_protocol, list_named_worlds, read_protocol
from minihuman.experiment.protocol.model import BlockSpec
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.trust import list_foreign_modules

_USUAL_KIND = next(field.default for field in msgspec.structs.fields(BlockSpec) if field.name == "kind")
_KNOWN_PROTOCOL = "demo"  # the name of a protocol in the folder that has all of them


@dataclass(frozen=True, slots=True)
class ShippedStudy:
    """A protocol that comes with the package."""

    name: str  # "trials/stroop", "examples/demo"
    path: Path
    summary: str  # the comment at the top of the file
    tree: dict[str, Any]
    modules: tuple[Path, ...]  # the Python files beside it that have its worlds

    def read(self) -> Protocol:
        """Read the protocol; with Python files, only decode it, as the user must first read and trust these.

        Raises:
            ProtocolError: if it is not valid.
        """
        if self.modules:
            return decode_protocol(self.path.read_bytes(), str(self.path))
        return read_protocol(self.path)

    def read_files(self) -> dict[str, bytes]:
        """Read the files that are copied with the protocol, by name.

        Raises:
            ProtocolError: if the protocol is not valid.
            OSError: if a file cannot be read.
        """
        named = {name: (self.path.parent / name).read_bytes() for name in self.read().files}
        return named | {path.name: path.read_bytes() for path in self.modules}


@cache
def list_shipped_studies() -> tuple[ShippedStudy, ...]:
    """Return the protocols that come with the package, in the order of their paths."""
    folder = find_shipped_protocol(_KNOWN_PROTOCOL).parent
    studies = []
    for path in sorted(folder.rglob("*.toml")):
        text = path.read_text(encoding="utf-8")
        tree = tomllib.loads(text)
        name = path.relative_to(folder).with_suffix("").as_posix()
        if "/" not in name:
            name = f"examples/{name}"
        studies.append(ShippedStudy(name, path, _read_summary(text), tree, _find_modules(tree, path.parent)))
    return tuple(studies)


def _find_modules(tree: dict[str, Any], folder: Path) -> tuple[Path, ...]:
    """Return the Python files of a folder that have worlds of a protocol; ``tree`` has the protocol's values."""
    modules = list_foreign_modules(world for world, _ in list_named_worlds(tree))
    paths = (folder / f"{module}.py" for module in sorted(modules))
    return tuple(path for path in paths if path.is_file())


@cache
def list_used_fields(table: str, kind: str = "") -> frozenset[str]:
    """Return the names of the fields that shipped protocols use in a table, whose path has no numbers.

    Args:
        table: the table's path: "blocks.stimuli".
        kind: counts only tables of this kind; "" counts all.
    """
    fields: set[str] = set()
    for row in _list_rows(table):
        if not kind or row.get("kind", _USUAL_KIND) == kind:
            fields |= row.keys()
    return frozenset(fields)


def find_example(table: str, kind: str) -> dict[str, Any] | None:
    """Return a copy of the shortest table of a kind in the shipped protocols; None if there is none.

    Tables whose text contains "file" are left out, as a new part cannot name files that it does not have.

    Args:
        table: the table's path without numbers: "blocks".
        kind: the kind of the table.
    """
    rows = [row for row in _list_rows(table) if row.get("kind", _USUAL_KIND) == kind and "file" not in str(row)]
    if not rows:
        return None
    return deepcopy(min(rows, key=lambda row: len(str(row))))


def _list_rows(table: str) -> Iterator[dict[str, Any]]:
    """Yield each table at a path without numbers ("blocks.stimuli") in any shipped protocol."""
    for study in list_shipped_studies():
        rows: list[Any] = [study.tree]
        for step in table.split("."):
            tables = [row[step] for row in rows if isinstance(row, dict) and step in row]
            rows = []
            for table_or_array in tables:
                rows += table_or_array if isinstance(table_or_array, list) else [table_or_array]
        yield from (row for row in rows if isinstance(row, dict))


def _read_summary(text: str) -> str:
    """Return the comment at the top of a file's text as one paragraph; "" if the text begins with no comment."""
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        if not line.startswith("#:"):  # a directive to editors: the file's schema
            lines.append(line.lstrip("# ").rstrip())
    return " ".join(lines)
