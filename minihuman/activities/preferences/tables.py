"""The table of comparisons of clips."""

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.activities.preferences import rows
from minihuman.activities.preferences.columns import PREFERENCES
from minihuman.activities.preferences.events import Preferred, Side
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.log.model.session_log import SessionLog


def _build_preference_row(event: Preferred, log: SessionLog) -> TableRow | None:
    """Build the row of an answer with its pair's clips; None if the log has no complete comparison for the answer."""
    for comparison in log.comparisons:
        if comparison.preference is event:
            return {
                "part": event.part + 1,
                "pair": event.pair + 1,
                **_describe_side("left", comparison.left),
                **_describe_side("right", comparison.right),
                "answer": event.answer,
                "shown_ns": event.shown_ns or None,
                "answer_ms": comparison.answer_ms if event.shown_ns else None,
                "replays": event.replays,
            }
    return None


def _describe_side(side: Side, clip: EpisodeClip) -> TableRow:
    """Return the columns of one side's clip: its episode, the attempt, and the first and last step that it shows."""
    return {
        f"{side}_episode": clip.episode + 1,
        f"{side}_attempt": clip.attempt,
        f"{side}_first": clip.first,
        f"{side}_last": clip.last,
    }


PREFERENCE_TABLES = (
    ActivityTable(
        "preferences",
        PREFERENCES,
        {Preferred: _build_preference_row},
        topics=(rows.PREFERENCE_CLIP_TOPIC, rows.PREFERENCE_TOPIC),
    ),
)
