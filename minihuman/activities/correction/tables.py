"""The table of corrections."""

import json

from minihuman.activities.correction import rows
from minihuman.activities.correction.columns import CORRECTIONS
from minihuman.activities.correction.events import CorrectionBegun
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.log.model.session_log import SessionLog


def _build_correction_row(event: CorrectionBegun, log: SessionLog) -> TableRow | None:
    """Build the row of a correction, found by its part and the time at which it began; None if the log lacks it."""
    for record in log.corrections:
        if record.part == event.part and record.t_ns[0] == event.t_ns:
            return {
                "part": event.part + 1,
                "correction": event.correction + 1,
                "episode": event.episode + 1,
                "attempt": event.attempt,
                "step": event.step,
                "steps": len(record.actions),
                "outcome": record.outcome,
                "actions": json.dumps(record.actions.tolist()),
                "key_t_ns": json.dumps(record.key_t_ns.tolist()),
            }
    return None


CORRECTION_TABLES = (
    ActivityTable(
        "corrections",
        CORRECTIONS,
        {CorrectionBegun: _build_correction_row},
        topics=(
            rows.CORRECTION_EPISODE_TOPIC,
            rows.CORRECTION_TOPIC,
            rows.CORRECTION_STEP_TOPIC,
            rows.CORRECTION_END_TOPIC,
        ),
    ),
)
