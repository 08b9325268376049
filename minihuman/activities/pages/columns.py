"""Columns of the table of pages."""

from minihuman.dataset.table_columns import PART_COLUMN, SEGMENT_COLUMN, SESSION_COLUMNS, TIME_COLUMN, TableColumn

PAGES = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    TableColumn("name", "text", "", "The part's name in the protocol."),
    TableColumn("page", "integer", "", "The page that was shown, 1 for the first."),
    TableColumn("pages", "integer", "", "How many the text has."),
    TableColumn("submit_ns", "integer", "ns", "When it was handed to the display, session time."),
    TableColumn("flip_ns", "integer", "ns", "When it was there, session time."),
)
