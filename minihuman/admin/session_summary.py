"""Summarise a session's files in one row of numbers, without making an object per step.

A finished log of today's format is read at a glance; every other one is read message by message (see ``log_info``).
"""

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

from minihuman.admin.session_index import SessionSummary
from minihuman.errors import LogError
from minihuman.log.names import CHAIN_KEY, SCHEMA_VERSION, STEP
from minihuman.log.paths import find_log_folders, group_sessions, raise_as_log_error
from minihuman.log.salvage.summary_section import all_ended_cleanly, read_summary


def summarize_session(files: Sequence[Path]) -> SessionSummary:
    """Sum up a session's log and segments, in order.

    A finished log is summed up from what was written at its end, if that holds and is enough; others are read through.

    Raises:
        LogError: if one cannot be opened, is no session log, of another schema version or damaged, or holds no plan.
    """
    with raise_as_log_error(files[0]):
        summary = _summarize_finished(files[0]) if len(files) == 1 else None
        if summary is None:
            from minihuman.admin.log_info import summarize_from_messages  # all that reads messages: rarely needed

            summary = summarize_from_messages(files)
        datetime.fromisoformat(summary.started_at)  # metadata have no checksum, and who is due is told from this
        return summary


def _summarize_finished(log: Path) -> SessionSummary | None:
    """Sum up a log from what its segments' ends say; None where one does not, as in logs of earlier versions.

    Also None where all episodes were played and the session ended otherwise: what else was left messages alone say.
    """
    found = read_summary(log)
    if found is None or not found.starts or not len(found.starts) == len(found.facts) == len(found.ends):
        return None
    if found.starts[0].get("schema_version") != str(SCHEMA_VERSION) or "completed" not in found.ends[-1]:
        return None
    first, last = found.starts[0], found.ends[-1]
    reason, planned, completed = last["reason"], int(last["planned"]), int(last["completed"])
    if reason != "complete" and 0 < planned == completed:
        return None
    return SessionSummary(
        study=first["study"],
        participant=first["participant"],
        group=first["group"],
        session=int(first["session"]),
        player=found.facts[0].get("player", "unknown"),
        started_at=first["started_at"],
        segments=len(found.starts),
        clean=all_ended_cleanly(found.starts, found.ends),
        end_reason=reason,
        episodes_planned=planned,
        episodes_completed=completed,
        steps=found.counts[STEP],
        duration_s=sum(int(end.get("lasted_ns", 0)) for end in found.ends) / 1e9,
        complete=reason == "complete",
    )


def find_double_sessions(study: Path) -> Iterator[str]:
    """Name each session that was completed twice: by two servers of an earlier version, which did not know each other.

    Copies of one log are none.
    """
    for folder, names in find_log_folders(study):
        logs = [log for log, files in group_sessions(folder, names).items() if log in files]
        complete: dict[tuple[str, int], dict[str, Path]] = {}  # by how the log ends
        for log in logs if len(logs) > 1 else ():
            try:
                found, its = read_summary(log), summarize_session([log])
            except LogError:  # named elsewhere
                continue
            if found is not None and its.complete:
                ends = complete.setdefault((its.participant, its.session), {})
                ends.setdefault(found.ends[-1].get(CHAIN_KEY, its.started_at), log)
        for (participant, session), ends in complete.items():
            if len(ends) > 1:
                paths = ", ".join(str(log) for log in ends.values())
                yield f"{participant} completed session {session} {len(ends)} times: {paths}; keep one in the study"
