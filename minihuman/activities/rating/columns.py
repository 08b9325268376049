"""Columns of the tables of rated blocks."""

from minihuman.dataset.table_columns import EPISODE_COLUMN, SEGMENT_COLUMN, SESSION_COLUMNS, TIME_COLUMN, TableColumn

RATINGS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    EPISODE_COLUMN,
    TableColumn("step", "integer", "", "The world's step when the press was taken, which it need not be about."),
    TableColumn("value", "number", "", "1 good, -1 bad."),
    TableColumn(
        "pressed_ns", "integer", "ns", "When the key went down, session time; what was seen when is in frames."
    ),
)
