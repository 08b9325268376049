"""All tables: those of every session and those of the installed activity kinds.

This module has the data dictionary, the tables' primary keys, the names of partition files, and the description of the
tables as a Frictionless data package, so that no reader has to guess a type (R, pandas, polars and DuckDB can also read
the files without it). Sources: Data Package and Table Schema, https://specs.frictionlessdata.io. It does not import
Arrow, because that takes longer than many commands.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from minihuman.dataset.activity_tables import PERSON_TABLE, ActivityTable, list_activity_tables
from minihuman.dataset.column_aliases import COLUMN_ALIASES
from minihuman.dataset.episode_columns import EpisodeColumn, list_episode_columns
from minihuman.dataset.session_columns import SESSION_TABLES
from minihuman.dataset.table_columns import TableColumn, is_time
from minihuman.dataset.wide_integers import WIDE_INTEGERS
from minihuman.storage.outside_names import explain_refused_name


class _TableCatalogue(Mapping[str, tuple[TableColumn, ...]]):
    """The columns of each table by table name; activity tables are loaded on first access."""

    def __getitem__(self, name: str) -> tuple[TableColumn, ...]:
        return list_tables().columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(list_tables().columns)

    def __len__(self) -> int:
        return len(list_tables().columns)


@dataclass(frozen=True, slots=True, eq=False)
class TableSet:
    """The columns of each table, given the installed plug-ins."""

    columns: Mapping[str, tuple[TableColumn, ...]]


def list_tables() -> TableSet:
    """Return the set of tables; the same object as long as the same plug-ins are installed."""
    return _gather_columns(list_activity_tables(), list_episode_columns())


@cache
def _gather_columns(tables: tuple[ActivityTable, ...], plugin_columns: tuple[EpisodeColumn, ...]) -> TableSet:
    """Return the tables of every session with plug-in columns in ``episodes``, and the tables of activity kinds."""
    episodes = (*SESSION_TABLES["episodes"], *(column.column for column in plugin_columns))
    return TableSet(SESSION_TABLES | {"episodes": episodes} | {table.name: table.columns for table in tables})


TABLES: Mapping[str, tuple[TableColumn, ...]] = _TableCatalogue()
"""The tables of every session first, with the columns of plug-ins, then those that kinds of activity add."""

TABLE_VERSION = "1.0"
"""The version of the tables' columns: the first number changes where a column is removed or means something else."""

EVERY_MOMENT = frozenset({"steps", "presses", "other_presses", "frames", "samples"})
"""The tables with a row per step, key press, picture or sample."""


def build_data_dictionary(*, without: frozenset[str] = frozenset()) -> dict[str, dict[str, dict[str, str]]]:
    """Return the data dictionary: by table and column, type, unit and meaning. Columns in ``without`` are omitted."""
    descriptions = {}
    for table, columns in TABLES.items():
        described_columns = [column for column in columns if column.name not in without]
        descriptions[table] = describe_columns(described_columns)
    return descriptions


def describe_columns(columns: Iterable[TableColumn]) -> dict[str, dict[str, str]]:
    """Return the entries of columns in the data dictionary, by column name."""
    return {
        column.name: {
            "type": column.kind,
            "unit": column.unit,
            "meaning": column.meaning,
            **_list_rare_entries(column),
        }
        for column in columns
    }


def _list_rare_entries(column: TableColumn) -> dict[str, str]:
    """Return the entries of the data dictionary that only some columns have; empty entries are omitted.

    These are a category's levels, whether integers may be too large for a double, the number of the definition of a
    quantity with several definitions, and the column's name in earlier versions.
    """
    earlier_name = next((old for old, current in COLUMN_ALIASES.items() if current == column.name), "")
    levels = "; ".join(f"{level}: {meaning}" for level, meaning in column.levels)
    exceeds_double = "true" if column.name in WIDE_INTEGERS else ""
    entries = {
        "levels": levels,
        "exceeds_double": exceeds_double,
        "definition": str(column.definition or ""),
        "earlier_name": earlier_name,
    }
    return {name: text for name, text in entries.items() if text}


_TYPES = {"text": "string", "key": "string", "integer": "integer", "number": "number", "boolean": "boolean"}


_SESSION = ("participant", "session")


_EPISODE = (*_SESSION, "episode", "attempt")


_PRIMARY_KEYS: Mapping[
    str, tuple[str, ...]
] = {  # columns that identify a row; tables of events, several of which can happen at the same time, have none
    "steps": (*_EPISODE, "step"),
    "keys": (*_SESSION, "first_episode", "key"),
    "episodes": _EPISODE,
    "blocks": (*_SESSION, "block"),
    "participants": _SESSION,
    "segments": (*_SESSION, "segment"),
    "plan": (*_SESSION, "episode"),
    "starts": _EPISODE,
}


_PARTITION = re.compile(r"(\w+)/study=([^/]+)/participant=([^/]+)/ses-(\d{2,4})-([0-9a-f]{16})\.parquet", re.ASCII)


@dataclass(frozen=True, slots=True)
class TablePartition:
    """One session's rows of one table, in a Parquet file whose name includes a digest of the rows."""

    table: str
    study: str
    participant: str
    session: int
    digest: str  # of the rows, the table's columns and the selection; 16 hexadecimal digits

    @property
    def name(self) -> str:
        """Return the file's name in a folder or a remote store, following the layout of Hive partitions."""
        return (
            f"{self.table}/study={self.study}/participant={self.participant}/"
            f"ses-{self.session:02d}-{self.digest}.parquet"
        )

    @classmethod
    def parse(cls, name: str) -> "TablePartition | None":
        """Parse a file name from any source; return None if it is not the name of a partition."""
        match = _PARTITION.fullmatch(name)
        if match is None:
            return None
        table, study, participant, session, digest = match.groups()
        if any(explain_refused_name(part) for part in (table, study, participant)):
            return None
        return cls(table, study, participant, int(session), digest)

    @property
    def of_session(self) -> tuple[str, str, int]:
        """Return the study, participant and session; a newer partition replaces those that share all three."""
        return self.study, self.participant, self.session


_EPISODE_TABLES = frozenset({"steps", "presses", "starts", "frames"})


def _find_episode_tables() -> set[str]:
    """Return the names of the activity kinds' tables whose rows belong to episodes."""
    return {table.name for table in list_activity_tables() if table.episode_row is not None}


def is_episode_table(name: str) -> bool:
    """Return whether each row of a table belongs to a row of ``episodes``."""
    return name in _EPISODE_TABLES or name in _find_episode_tables()


def find_primary_key(name: str) -> tuple[str, ...]:
    """Return the columns of a table's primary key; empty for a table whose events can coincide."""
    if name in _find_episode_tables():
        return _EPISODE
    return _PRIMARY_KEYS.get(name, ())


def build_table_schema(name: str, columns: Iterable[TableColumn]) -> dict[str, Any]:
    """Build the Frictionless schema of one table; its foreign key refers to the table of episodes or participants."""
    schema: dict[str, Any] = {"fields": [_describe_field(column) for column in columns], "missingValues": [""]}
    if key := find_primary_key(name):
        schema["primaryKey"] = list(key)
    if name != "participants":
        parent = "episodes" if is_episode_table(name) else "participants"
        fields = list(_PRIMARY_KEYS[parent])
        schema["foreignKeys"] = [{"fields": fields, "reference": {"resource": parent, "fields": fields}}]
    return schema


def build_data_package(
    name: str,
    files: Iterable[tuple[str, Path]],
    *,
    without: frozenset[str] = frozenset(),
    infos: Mapping[str, Mapping[str, TableColumn]] = MappingProxyType({}),
    **facts: Any,
) -> dict[str, Any]:
    """Describe table files as a Frictionless data package.

    Args:
        name: the package's name.
        files: the table's name and the path of each file.
        without: the columns that the files do not have.
        infos: per table, the columns that its file has for keys of JSON columns.
        facts: further properties of the package.
    """
    return {
        "profile": "tabular-data-package",
        "name": name,
        "table_version": TABLE_VERSION,
        **facts,
        "resources": [_build_resource(table, path, without, infos.get(table, {})) for table, path in files],
    }


def add_person_resource(package: dict[str, Any], path: Path, columns: Sequence[TableColumn]) -> None:
    """Add the person table's file to a data package, and make the table of participants refer to it.

    Args:
        package: the data package, which this function changes.
        path: the path of the person table's file.
        columns: the columns of the person table.
    """
    keys = ["study", "participant"]
    for resource in package["resources"]:
        if resource["name"] == "participants":
            resource["schema"]["foreignKeys"] = [
                {"fields": keys, "reference": {"resource": PERSON_TABLE, "fields": keys}}
            ]
    schema = {"fields": [_describe_field(column) for column in columns], "missingValues": [""], "primaryKey": keys}
    package["resources"].append(_describe_file(PERSON_TABLE, path) | {"schema": schema})


def _describe_file(table: str, path: Path) -> dict[str, Any]:
    """Describe a table's file as a Frictionless resource without its schema."""
    resource = {"name": table, "path": path.name, "profile": "tabular-data-resource"}
    if path.suffix == ".csv":
        return resource | {"format": "csv", "mediatype": "text/csv", "encoding": "utf-8"}
    return resource | {"format": path.suffix.removeprefix("."), "mediatype": "application/vnd.apache.parquet"}


def _build_resource(
    table: str, path: Path, without: frozenset[str], infos: Mapping[str, TableColumn]
) -> dict[str, Any]:
    """Build the Frictionless resource of a table's file, without columns in ``without``, with those in ``infos``.

    ``infos`` has the columns for the keys of the table's JSON column, by key.
    """
    columns = [column for column in TABLES[table] if column.name not in without]
    columns += infos.values()
    return _describe_file(table, path) | {"schema": build_table_schema(table, columns)}


def _describe_field(column: TableColumn) -> dict[str, Any]:
    """Return the field descriptor of a column in a Frictionless schema."""
    field: dict[str, Any] = {"name": column.name, "type": _TYPES[column.kind], "description": column.meaning}
    if column.unit:
        field["unit"] = column.unit
    if is_time(column):
        field["type"] = "datetime"
    if column.levels:
        field["constraints"] = {"enum": [level for level, _ in column.levels]}
    if column.kind == "boolean":
        field |= {"trueValues": ["TRUE"], "falseValues": ["FALSE"]}
    return field
