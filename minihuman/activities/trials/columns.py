"""Columns of the tables of trials, of what they showed, and of their responses."""

from minihuman.dataset.table_columns import (
    BLOCK_COLUMNS,
    EPISODE_COLUMNS,
    PART_COLUMN,
    SEGMENT_COLUMN,
    SESSION_COLUMNS,
    TIME_COLUMN,
    TableColumn,
)

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
_EPISODE_AND_ATTEMPT = EPISODE_COLUMNS[1:]  # the segment stands before
STIMULUS_COLUMNS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    *_EPISODE_AND_ATTEMPT,
    TableColumn("picture", "integer", "", "The picture of the trial, 1 for the first."),
    TableColumn("stimuli", "text", "JSON", "The names of the stimuli in it, the front one last."),
    TableColumn("due_ns", "integer", "ns", "When it was to be on the display, session time; empty: at once."),
    TableColumn("flip_ns", "integer", "ns", "When it was on the display, session time."),
    TableColumn("late_ms", "number", "ms", "By how much that was later; empty where it was due at once.", 2),
)
SOUND_COLUMNS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    *_EPISODE_AND_ATTEMPT,
    TableColumn("sound", "text", "", "The name of the sound."),
    TableColumn(
        "due_ns", "integer", "ns", "When it was to begin: so long after the first picture's flip, session time."
    ),
    TableColumn(
        "scheduled_ns", "integer", "ns", "For when the device was told to begin it, session time; empty: as onset_ns."
    ),
    TableColumn(
        "onset_ns",
        "integer",
        "ns",
        "When it began, as the device says, session time; empty where it had not by the end of its trial.",
    ),
    TableColumn(
        "late_ms", "number", "ms", "By how much that was later than due_ns; below 0: earlier; empty as onset_ns.", 2
    ),
    TableColumn(
        "uncertainty_ms",
        "number",
        "ms",
        "Below which 99 % of the errors of onset_ns are, but for a constant delay of the device.",
        2,
    ),
)
RESPONSE_COLUMNS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    *_EPISODE_AND_ATTEMPT,
    TableColumn("number", "integer", "", "Which response of the trial, 1 for the first."),
    TableColumn("key", "key", "", "The physical key."),
    TableColumn("pressed_ns", "integer", "ns", "When it went down, session time."),
    TableColumn("response_ms", "number", "ms", "That minus the onset of the trial's target.", 2),
)
