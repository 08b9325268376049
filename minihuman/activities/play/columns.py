"""Columns of the tables of blocks of episodes."""

from minihuman.dataset.table_columns import PART_COLUMN, SEGMENT_COLUMN, SESSION_COLUMNS, TIME_COLUMN, TableColumn

POINTS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    TableColumn(
        "episode", "integer", "", "The session's episode, 1 for the first; the first of those that were skipped."
    ),
    TableColumn("points", "number", "", "What it was worth; empty where it was skipped."),
    TableColumn("total", "number", "", "The session's points so far."),
    TableColumn("skipped", "integer", "", "How many episodes were not played; empty for one that was."),
    TableColumn("why", "text", "", "Why: criterion, time or given_up."),
)


SUBGOALS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    TableColumn("episode", "integer", "", "The session's episode, 1 for the first."),
    TableColumn("step", "integer", "", "The step that did it, 1 for the first."),
    TableColumn("clause", "integer", "", "Which clause of the episode's instruction, 1 for the first as it is read."),
    TableColumn("text", "text", "", "What the clause says."),
)


DECISIONS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    TableColumn("block", "text", "", "The block's name."),
    TableColumn("episode", "integer", "", "The episode that it is about; after the block's last one, the next number."),
    TableColumn("design", "text", "", "The adaptive design, as the protocol names it."),
    TableColumn("design_version", "integer", "", "Of the design's rule."),
    TableColumn("options", "text", "", "What it chose of the world's options, JSON."),
    TableColumn("seed", "integer", "", "The seed that it chose for the reset; empty where it left the plan's."),
    TableColumn("stop", "boolean", "", "Whether the block is over."),
    TableColumn("estimates", "text", "", "What the design estimates by then, JSON: a threshold for instance."),
    TableColumn("posterior", "text", "", "Digest of all that the decision follows from, 16 hexadecimal digits."),
)
