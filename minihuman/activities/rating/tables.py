"""Tables of rated blocks: the ratings, and the tables of every agent block."""

from minihuman.activities.agent_blocks.tables import AGENT_TABLES
from minihuman.activities.rating.columns import RATINGS
from minihuman.activities.rating.events import Rated
from minihuman.activities.rating.rows import RATING_TOPIC
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.log.model.session_log import SessionLog


def _build_rating_row(event: Rated, log: SessionLog) -> TableRow:
    return {
        "episode": event.episode + 1,
        "step": event.step,
        "value": event.value,
        "pressed_ns": event.pressed_ns,
    }


RATING_TABLES = (
    *AGENT_TABLES,
    ActivityTable("ratings", RATINGS, {Rated: _build_rating_row}, topics=(RATING_TOPIC,)),
)
