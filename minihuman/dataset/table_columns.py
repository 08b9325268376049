"""What a column of a table is, and the columns that several tables share.

The data dictionary is made from name, type, unit and meaning. The columns of each table are in `session_columns` and
`measure_columns`, and those of an activity kind's tables in the module ``columns`` of its folder. None of these imports
Arrow, because that takes longer than many commands.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from minihuman.moved import forward_names

TableColumnType = Literal[
    "text", "key", "integer", "number", "boolean"
]  # a key is a text, so named that no reader parses a number


@dataclass(frozen=True, slots=True)
class TableColumn:
    """A table column; the unit is "" for words, counts and dimensionless numbers."""

    name: str
    kind: TableColumnType
    unit: str
    meaning: str
    definition: int = 0  # of a quantity that is defined in several ways, which one it is; 0: there is one
    levels: tuple[tuple[str, str], ...] = field(default=(), repr=False)  # each value of a category, and its meaning


def is_time(column: TableColumn) -> bool:
    """Return whether a column holds times of the wall clock, which the tables keep as ISO 8601 texts in UTC."""
    return column.kind == "text" and column.unit == "UTC"


def table_key_name(key: str) -> str:
    """Return a physical key's name in the tables: "key_1", "key_q"; longer names, such as "enter", are unchanged.

    Most readers would take a column of "1" and "2" for numbers, and some would take "t" and "f" for booleans.
    """
    return f"key_{key}" if len(key) == 1 else key


SESSION_COLUMNS = (
    TableColumn("study", "text", "", "The study's name in the protocol."),
    TableColumn(
        "version", "text", "", "The protocol's version and the start of its SHA-256: other bytes, another version."
    ),
    TableColumn("participant", "text", "", "The participant's code."),
    TableColumn("group", "text", "", "The group the participant was allocated to."),
    TableColumn("session", "integer", "", "The participant's session, 1 for the first."),
)


EPISODE_COLUMNS = (
    TableColumn("segment", "integer", "", "The session's segment: 1, and one more after each resume."),
    TableColumn(
        "episode", "integer", "", "The session's episode, 1 for the first, as on the screen and in the figures."
    ),
    TableColumn("attempt", "integer", "", "1, or more where an interrupted episode was begun again."),
)


BLOCK_COLUMNS = (TableColumn("block", "text", "", "The block's name in the protocol."),)


EXCLUDED_COLUMN = TableColumn(
    "exclusion_reason", "text", "", "Why the statistics exclude this row; empty if they include it."
)


SEGMENT_COLUMN = (
    TableColumn("segment", "integer", "", "The session's segment, 1 for the first; one more after each resume."),
)

TIME_COLUMN = TableColumn("t_ns", "integer", "ns", "Session time: since the session's first segment began.")


UNIT_COLUMN = TableColumn("unit", "text", "", "The unit of places: cell or m; empty where the world has no map.")
EPISODE_KEY = (*SESSION_COLUMNS, *BLOCK_COLUMNS, *EPISODE_COLUMNS)

PART_COLUMN = TableColumn("part", "integer", "", "The session's part, 1 for the first.")

EPISODE_COLUMN = TableColumn("episode", "integer", "", "The session's episode, 1 for the first.")


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
