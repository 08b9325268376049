"""Columns of the table of corrections."""

from minihuman.dataset.table_columns import PART_COLUMN, SEGMENT_COLUMN, SESSION_COLUMNS, TIME_COLUMN, TableColumn

CORRECTIONS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    TableColumn("correction", "integer", "", "The part's correction, 1 for the first."),
    TableColumn("episode", "integer", "", "The episode that is corrected, 1 for the first."),
    TableColumn("attempt", "integer", "", "Which of its attempts."),
    TableColumn("step", "integer", "", "The step after which the correction begins, 0 for the reset."),
    TableColumn("steps", "integer", "", "How many steps were shown."),
    TableColumn(
        "outcome", "text", "", "goal, failure, timeout or ended; stopped where a key or the session's end ended it."
    ),
    TableColumn("actions", "text", "", "The world's actions by number, as a JSON list."),
    TableColumn("key_t_ns", "text", "", "When each one's key went down, session time, as a JSON list."),
)
