"""Columns that plug-ins add to the table of episodes: the entry-point group `minihuman.columns`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from minihuman.dataset.measure_columns import EPISODES
from minihuman.dataset.table_columns import TableColumn
from minihuman.errors import QueryError
from minihuman.plugins import list_plugin_names, load_plugin, remember_by_name

if TYPE_CHECKING:
    from minihuman.log.model.session_log import EpisodeLog

COLUMN_GROUP = "minihuman.columns"


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeColumn:
    """A column of the table ``episodes``.

    Args:
        column: the column's name, type, unit and meaning. Like any other column, it appears in the data dictionary, in
            SQL and in files.
        compute: the function that returns the column's value for an episode, or None if there is none. It receives only
            the log, so that the same log always gives the same value.
    """

    column: TableColumn
    compute: Callable[["EpisodeLog"], Any]


def list_episode_columns() -> tuple[EpisodeColumn, ...]:
    """List the installed columns, in the order of their names.

    Raises:
        QueryError: if a column cannot be loaded, is not an `EpisodeColumn`, has another name than its entry point, or
            has the name of a built-in column.
    """
    return tuple(_load_column(name) for name in list_plugin_names(COLUMN_GROUP))


@remember_by_name
def _load_column(name: str) -> EpisodeColumn:
    """Load the column of an entry point; raise QueryError if it is not usable, as ``list_episode_columns`` says."""
    column = load_plugin(COLUMN_GROUP, name, QueryError, noun="column")
    if not isinstance(column, EpisodeColumn):
        raise QueryError(f"column {name!r} is of type {type(column).__name__}; register a minihuman.ext.EpisodeColumn")
    if column.column.name != name:
        raise QueryError(f"the entry point {name!r} is a column that calls itself {column.column.name!r}; rename one")
    if name in {built_in.name for built_in in EPISODES}:
        raise QueryError(f"column {name!r} is in the table episodes already; rename it")
    return column


def compute_episode_columns(episode: "EpisodeLog") -> dict[str, Any]:
    """Return the values of the installed columns for an episode, by column name."""
    return {column.column.name: column.compute(episode) for column in list_episode_columns()}
