"""Columns of the table of episodes that plug-ins add: the entry-point group `minihuman.columns`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from minihuman.dataset.table_columns import EPISODES, TableColumn
from minihuman.errors import QueryError
from minihuman.plugins import list_plugin_names, load_plugin, remember_by_name

if TYPE_CHECKING:
    from minihuman.log.model.session_log import EpisodeLog

COLUMN_GROUP = "minihuman.columns"


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeColumn:
    """A column of the table ``episodes``.

    Args:
        column: its name, type, unit and meaning; it is in the data dictionary, in SQL and in files as the others are.
        compute: its value for an episode; None where there is none. It sees the log alone, so that the same log gives
            the same value.
    """

    column: TableColumn
    compute: Callable[["EpisodeLog"], Any]


def list_episode_columns() -> tuple[EpisodeColumn, ...]:
    """List the installed columns, in the order of their names.

    Raises:
        QueryError: if one cannot be loaded, is no `EpisodeColumn`, or has a name that the table has already.
    """
    return tuple(_load_column(name) for name in list_plugin_names(COLUMN_GROUP))


@remember_by_name
def _load_column(name: str) -> EpisodeColumn:
    column = load_plugin(COLUMN_GROUP, name, QueryError, noun="column")
    if not isinstance(column, EpisodeColumn):
        raise QueryError(f"column {name!r} is of type {type(column).__name__}; register a minihuman.ext.EpisodeColumn")
    if column.column.name != name:
        raise QueryError(f"the entry point {name!r} is a column that calls itself {column.column.name!r}; rename one")
    if name in {own.name for own in EPISODES}:
        raise QueryError(f"column {name!r} is in the table episodes already; rename it")
    return column


def compute_episode_columns(episode: "EpisodeLog") -> dict[str, Any]:
    """Compute the installed columns for an episode."""
    return {column.column.name: column.compute(episode) for column in list_episode_columns()}
