"""Tables that an activity kind adds to the tables of every session: how to declare one, and which are installed."""

import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minihuman.dataset.episode_columns import list_episode_columns
from minihuman.dataset.session_columns import SESSION_TABLES
from minihuman.dataset.table_columns import TableColumn
from minihuman.errors import ProtocolError, QueryError
from minihuman.experiment.machine.activity import GROUP, ActivityKind, find_kind, list_built_in_kinds
from minihuman.plugins import list_plugin_names

if TYPE_CHECKING:
    from minihuman.log.model.session_log import EpisodeLog, SessionLog

TableRow = dict[str, Any]  # by column
PERSON_TABLE = "people"  # the one table that does not come from logs; ``person_table`` builds it
_TABLE_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, slots=True, eq=False)
class ActivityTable:
    """A table whose rows an activity kind builds from its events, the episodes of its blocks, or a whole session.

    Args:
        name: the table's name in SQL and in files: lower-case letters, digits and underscores.
        columns: all columns of the table. A row built from an event also receives the `SESSION_COLUMNS`, the segment
            and ``t_ns``; a row built from an episode receives the columns that identify the episode.
        event_rows: per event class, the function that builds a row from an event; it returns None for an event that has
            no row.
        episode_row: the function that builds a row from an episode; it returns None for an episode that has no row.
        session_rows: the function that yields the rows of a whole session, each with its segment and ``t_ns``; for rows
            that no single event or episode has.
        topics: the log topics whose contents the table holds.
    """

    name: str
    columns: tuple[TableColumn, ...]
    event_rows: Mapping[type[Any], Callable[[Any, "SessionLog"], TableRow | None]] = field(default_factory=dict)
    episode_row: Callable[["EpisodeLog"], TableRow | None] | None = None
    session_rows: Callable[["SessionLog"], Iterable[TableRow]] | None = None
    topics: tuple[str, ...] = ()


def list_activity_tables() -> tuple[ActivityTable, ...]:
    """List the tables of every installed activity kind, in the order of the kinds' names.

    Raises:
        QueryError: if two tables share a name, or if a name is that of a table that every session has, or is not made
            of lower-case letters, digits and underscores.
    """
    built_in = list_built_in_kinds()
    plugin_kinds = tuple(name for name in list_plugin_names(GROUP) if name not in built_in)
    return _load_tables((*_find_built_in_kinds(built_in), *_find_kinds(plugin_kinds)))


@cache
def _find_built_in_kinds(names: tuple[str, ...]) -> tuple[ActivityKind, ...]:
    return tuple(_find_kinds(names))


def _find_kinds(names: Iterable[str]) -> Iterator[ActivityKind]:
    """Yield the activity kinds that can be loaded here; a broken kind does not hide the tables of the others."""
    for name in names:
        with suppress(ProtocolError):
            yield find_kind(name)


@cache
def _load_tables(kinds: tuple[ActivityKind, ...]) -> tuple[ActivityTable, ...]:
    """Load the tables of the given kinds of activity; raise QueryError for a name that is invalid or used twice."""
    owners: dict[str, tuple[ActivityTable, str]] = {}
    for kind in kinds:
        for table in _load_tables_of(kind):
            _check_table_name(kind, table)
            first_table, owner = owners.setdefault(table.name, (table, kind.name))
            if first_table is not table:
                raise QueryError(f"activities {owner!r} and {kind.name!r} both have a table {table.name!r}; rename one")
    return tuple(table for table, _ in owners.values())


def _load_tables_of(kind: ActivityKind) -> Iterable[ActivityTable]:
    """Import the tables that a kind of activity declares as "module:attribute"; an empty tuple if it declares none."""
    if not kind.tables:
        return ()
    module, _, attribute = kind.tables.partition(":")
    tables: Iterable[ActivityTable] = getattr(import_module(module), attribute)
    return tables


def _check_table_name(kind: ActivityKind, table: ActivityTable) -> None:
    """Raise QueryError if a table has the name of a table that every session has, or a name that SQL must quote."""
    if table.name in (*SESSION_TABLES, PERSON_TABLE):
        raise QueryError(f"activity {kind.name!r} has a table {table.name!r}, as every session has; rename it")
    if not _TABLE_NAME.fullmatch(table.name):
        raise QueryError(f"activity {kind.name!r} has a table {table.name!r}; use a to z, 0 to 9 and _")


def list_table_sources() -> tuple[Path, ...]:
    """List the source files of the functions by which activity kinds and plug-in columns build table rows.

    A table cache is stale if it was filled by another version of these files.
    """
    modules = {kind.tables.partition(":")[0] for kind in _find_kinds(list_plugin_names(GROUP)) if kind.tables}
    for table in list_activity_tables():
        modules |= {build_row.__module__ for build_row in table.event_rows.values()}
        if table.episode_row:
            modules.add(table.episode_row.__module__)
        if table.session_rows:
            modules.add(table.session_rows.__module__)
    modules |= {column.compute.__module__ for column in list_episode_columns()}
    files = {sys.modules[name].__file__ for name in modules if name in sys.modules}
    return tuple(sorted(Path(file) for file in files if file))


def list_tables_of_topics() -> dict[str, tuple[str, ...]]:
    """Return, for each log topic, the names of the tables that hold its contents."""
    tables: dict[str, list[str]] = defaultdict(list)
    for table in list_activity_tables():
        for topic in table.topics:
            tables[topic].append(table.name)
    return {topic: tuple(names) for topic, names in tables.items()}
