"""What a session's files hold, in one row of numbers, without making an object of every step."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from minihuman.lab.summary import Summary
from minihuman.log.names import SCHEMA_VERSION, STEP
from minihuman.log.read.glance import all_clean, glance
from minihuman.log.read.guard import guarded


def summarise(files: Sequence[Path]) -> Summary:
    """Sum up a session's log and segments, in order.

    A finished log is summed up from what was written at its end, if that holds and is enough; others are read through.

    Raises:
        LogError: if one cannot be opened, is no session log, of another schema version or damaged, or holds no plan.
    """
    with guarded(files[0]):
        summary = _at_a_glance(files[0]) if len(files) == 1 else None
        if summary is None:
            from minihuman.lab.read_through import read_through  # all that reads messages: rarely needed

            summary = read_through(files)
        datetime.fromisoformat(summary.started_at)  # metadata have no checksum, and who is due is told from this
        return summary


def _at_a_glance(log: Path) -> Summary | None:
    """Sum up a log from what its segments' ends say; None where one does not, as in logs of earlier versions.

    Also None where all episodes were played and the session ended otherwise: what else was left messages alone say.
    """
    found = glance(log)
    if found is None or not found.starts or not len(found.starts) == len(found.facts) == len(found.ends):
        return None
    if found.starts[0].get("schema_version") != str(SCHEMA_VERSION) or "completed" not in found.ends[-1]:
        return None
    first, last = found.starts[0], found.ends[-1]
    reason, planned, completed = last["reason"], int(last["planned"]), int(last["completed"])
    if reason != "complete" and 0 < planned == completed:
        return None
    return Summary(
        study=first["study"],
        participant=first["participant"],
        group=first["group"],
        session=int(first["session"]),
        player=found.facts[0].get("player", "unknown"),
        started_at=first["started_at"],
        segments=len(found.starts),
        clean=all_clean(found.starts, found.ends),
        end_reason=reason,
        episodes_planned=planned,
        episodes_completed=completed,
        steps=found.counts[STEP],
        duration_s=sum(int(end.get("lasted_ns", 0)) for end in found.ends) / 1e9,
        complete=reason == "complete",
    )
