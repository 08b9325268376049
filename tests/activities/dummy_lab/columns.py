from minihuman.dataset.table_columns import PART_COLUMN, SEGMENT_COLUMN, SESSION_COLUMNS, TIME_COLUMN
from minihuman.ext import EpisodeColumn, TableColumn

TAPS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    TableColumn("tap", "integer", "", "The tap, 1 for the first."),
)
HESITATION = EpisodeColumn(
    TableColumn("hesitation_ms", "number", "ms", "From the reset to the first step; empty without a step."),
    lambda episode: (episode.t_ns[1] - episode.t_ns[0]) / 1e6 if len(episode.t_ns) > 1 else None,
)
