"""Columns of the table of comparisons."""

from minihuman.dataset.table_columns import PART_COLUMN, SEGMENT_COLUMN, SESSION_COLUMNS, TIME_COLUMN, TableColumn

PREFERENCES = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    TableColumn("pair", "integer", "", "The pair, 1 for the first."),
    TableColumn("left_episode", "integer", "", "The episode that the left stretch is of, 1 for the first."),
    TableColumn("left_attempt", "integer", "", "Which of its attempts."),
    TableColumn("left_first", "integer", "", "The step whose picture came first, 0 for the reset."),
    TableColumn("left_last", "integer", "", "The step whose picture came last."),
    TableColumn("right_episode", "integer", "", "The same of the right stretch."),
    TableColumn("right_attempt", "integer", "", "Which of its attempts."),
    TableColumn("right_first", "integer", "", "The step whose picture came first, 0 for the reset."),
    TableColumn("right_last", "integer", "", "The step whose picture came last."),
    TableColumn("answer", "text", "", "Which was said to be better: left, right, equal or cannot_tell."),
    TableColumn("shown_ns", "integer", "ns", "When the pair's first pictures were on the display, session time."),
    TableColumn("answer_ms", "number", "ms", "From then to the key."),
    TableColumn("replays", "integer", "", "How often the pair was asked for again."),
)
