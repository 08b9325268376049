"""Columns of the table of trials."""

from minihuman.dataset.table_columns import BLOCK_COLUMNS, EPISODE_COLUMNS, SESSION_COLUMNS, TableColumn

TRIAL_COLUMNS = (
    *SESSION_COLUMNS,
    *BLOCK_COLUMNS,
    *EPISODE_COLUMNS,
    TableColumn("trial", "integer", "", "The trial's place in its block, 1 for the first."),
    TableColumn("stimulus", "text", "JSON", "The world's options: what was shown; images by their SHA-256."),
    TableColumn("labels", "text", "JSON", "The labels of the stimulus, by column of its table; empty without."),
    TableColumn("correct", "text", "", "The correct response, none where none is; empty where nothing says it."),
    TableColumn("response", "text", "", "The last response, none where the deadline passed; empty without a step."),
    TableColumn("is_correct", "boolean", "", "Whether it was the correct one; empty where nothing says it."),
    TableColumn("response_ms", "number", "ms", "The first response minus the onset of the stimulus; empty without.", 2),
    TableColumn("reward", "number", "", "What the trial earned."),
)
