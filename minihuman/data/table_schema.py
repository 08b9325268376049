"""The tables as a Frictionless data package: types, units, keys and what stands for missing, beside the files.

Sources: Data Package and Table Schema, https://specs.frictionlessdata.io. R, pandas, polars and DuckDB read the files
without it; with it no column's type is guessed.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from minihuman.data.column import Column
from minihuman.data.columns import TABLES

_TYPES = {"text": "string", "key": "string", "whole": "integer", "number": "number", "yes_no": "boolean"}
_SESSION = ("participant", "session")
_EPISODE = (*_SESSION, "episode", "attempt")
KEYS: Mapping[str, tuple[str, ...]] = {  # that no two rows share; tables of what may happen twice at once have none
    "steps": (*_EPISODE, "step"),
    "keys": (*_SESSION, "first_episode", "key"),
    "episodes": _EPISODE,
    "blocks": (*_SESSION, "block"),
    "participants": _SESSION,
    "segments": (*_SESSION, "segment"),
    "plan": (*_SESSION, "episode"),
    "starts": _EPISODE,
}
OF_EPISODES = frozenset({"steps", "presses", "starts", "frames"})  # whose rows belong to a row of ``episodes``


def table_schema(name: str, columns: Iterable[Column]) -> dict[str, Any]:
    """One table's schema."""
    schema: dict[str, Any] = {"fields": [_field(column) for column in columns], "missingValues": [""]}
    if name in KEYS:
        schema["primaryKey"] = list(KEYS[name])
    parent = "episodes" if name in OF_EPISODES else "participants" if name != "participants" else ""
    if parent:
        fields = list(KEYS[parent])
        schema["foreignKeys"] = [{"fields": fields, "reference": {"resource": parent, "fields": fields}}]
    return schema


def package(
    name: str, files: Iterable[tuple[str, Path]], *, without: frozenset[str] = frozenset(), **facts: Any
) -> dict[str, Any]:
    """A data package of table files, each with its table's name; ``facts`` are the package's further properties."""
    return {
        "profile": "tabular-data-package",
        "name": name,
        **facts,
        "resources": [_resource(table, path, without) for table, path in files],
    }


def _resource(table: str, path: Path, without: frozenset[str]) -> dict[str, Any]:
    kind = path.suffix.removeprefix(".")
    columns = [column for column in TABLES[table] if column.name not in without]
    return {
        "name": table,
        "path": path.name,
        "profile": "tabular-data-resource",
        "format": kind,
        "mediatype": "text/csv" if kind == "csv" else "application/vnd.apache.parquet",
        **({"encoding": "utf-8"} if kind == "csv" else {}),
        "schema": table_schema(table, columns),
    }


def _field(column: Column) -> dict[str, Any]:
    field: dict[str, Any] = {"name": column.name, "type": _TYPES[column.kind], "description": column.meaning}
    if column.unit:
        field["unit"] = column.unit
    if column.kind == "yes_no":
        field |= {"trueValues": ["TRUE"], "falseValues": ["FALSE"]}
    return field
