"""List the participants who are due or overdue for a further session, or have an unfinished one.

The list is computed from the logs and the protocol in them. Dates are calendar days in the participant's time zone, or
in UTC for logs that do not record the UTC offset.
"""

import re
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Literal

import msgspec

from minihuman.admin.enrolment_entries import SlotTaken, list_replaced, read_enrolled, read_enrolment_log
from minihuman.admin.next_session import find_local_date, find_start_date
from minihuman.admin.session_index import SessionRow, read_session_index
from minihuman.errors import LogError
from minihuman.experiment.machine.events import FINAL_END_REASONS
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.storage.system import wall_time

_SESSION_FOLDER = re.compile(r"([^/]+)/ses-(\d+)")
DueState = Literal["due", "later", "overdue", "unfinished", "unreadable", "never came"]
_STATES: dict[DueState, tuple[str, str]] = {  # a description of the expected session, and a hint
    "due": ("due now{until}", ""),
    "later": ("due from {0.earliest}{until}", ""),
    "overdue": ("was due until {0.latest}", "; if they do not come back: minihuman replace {0.participant}"),
    "unfinished": (
        "was interrupted and can be resumed",
        "; if they do not come back: minihuman replace {0.participant}",
    ),
    "unreadable": ("has a log that cannot be read", ": see minihuman status, and minihuman recover"),
    "never came": ("has a slot and never came", "; to offer it again: minihuman replace {0.participant}"),
}


class DueSession(msgspec.Struct, frozen=True):
    """A session that a participant is expected to play; dates are calendar days in the participant's time zone."""

    participant: str
    group: str
    session: int  # the number of the session that is due, or unfinished
    state: DueState
    earliest: date | None = None
    latest: date | None = None

    def line(self) -> str:
        """Return the session as one line of a table, with the command that resolves the situation."""
        hint = _STATES[self.state][1].format(self)
        return f"{self.participant:12} {self.group:16} {self.session:7}  {self.words()}{hint}"

    def words(self) -> str:
        """Return a description of the session that is expected and when, such as "due now until 2026-03-01"."""
        until = f" until {self.latest}" if self.latest else ""
        return _STATES[self.state][0].format(self, until=until)


@dataclass(slots=True)
class _LatestSession:
    """The latest session of a participant that can be read."""

    row: SessionRow
    session: int
    is_ended: bool  # complete, or ended in another way that is final


def list_due_sessions(study_dir: Path, now: datetime | None = None) -> tuple[DueSession, ...]:
    """List every participant who is expected to play or finish a session, in the order of enrolment.

    Args:
        study_dir: the study's folder.
        now: the time that determines "today" in each participant's time zone; None for the current time.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the enrolment log cannot be read.
        ProtocolError: if the protocol in the logs cannot be decoded.
    """
    latest_sessions, unreadable = _find_latest_sessions(study_dir)
    replaced = list_replaced(read_enrolment_log(study_dir))
    protocols: dict[str, Protocol] = {}
    due_sessions: list[DueSession] = []
    for slot in read_enrolled(study_dir):
        if slot.participant in replaced:
            continue
        last = latest_sessions.get(slot.participant)
        last_readable = 0 if last is None else last.session
        last_unreadable = unreadable.get(slot.participant, 0)
        if last_unreadable > last_readable:
            due_sessions.append(DueSession(slot.participant, slot.group, last_unreadable, "unreadable"))
        elif last is None:
            due_sessions.append(DueSession(slot.participant, slot.group, 1, "never came"))
        elif not last.is_ended:
            due_sessions.append(DueSession(slot.participant, slot.group, last.session, "unfinished"))
        else:
            due_sessions += _list_due_after(last, slot, protocols, now)
    return tuple(due_sessions)


def _list_due_after(
    last: _LatestSession, slot: SlotTaken, protocols: dict[str, Protocol], now: datetime | None
) -> list[DueSession]:
    """Return a list with the session that follows a participant's latest one; it is empty if there is none.

    If the log of the latest session cannot be read, that session is in the list, as unreadable.

    Args:
        last: the participant's latest session, which has ended.
        slot: the participant's slot.
        protocols: the protocols decoded so far, by SHA-256; that of the session is added.
        now: the time that determines "today"; None for the current time.
    """
    try:
        log = read_log(last.row.path)
        protocol = _decode_protocol_once(log.plan, protocols)
    except LogError:  # the damage is in a part of the log that the session index does not read
        return [DueSession(slot.participant, slot.group, last.session, "unreadable")]
    return _find_next_session(last, log, protocol, find_local_date(now or wall_time(), log))


def _find_latest_sessions(study_dir: Path) -> tuple[dict[str, _LatestSession], dict[str, int]]:
    """Return each participant's latest readable session, and the number of their latest unreadable one, by code.

    The participant and number of an unreadable session are taken from the names of its folders.
    """
    latest_sessions: dict[str, _LatestSession] = {}
    unreadable: dict[str, int] = {}
    for row in read_session_index(study_dir):
        summary = row.summary
        if summary is None:
            participant_and_session_folders = row.path.parts[-3:-1]
            match = _SESSION_FOLDER.fullmatch("/".join(participant_and_session_folders))
            if match:
                participant = match[1]
                session = int(match[2])
                unreadable[participant] = max(session, unreadable.get(participant, 0))
            continue
        latest = latest_sessions.get(summary.participant)
        if latest is None or latest.session <= summary.session:
            is_ended = summary.complete or summary.end_reason in FINAL_END_REASONS
            latest_sessions[summary.participant] = _LatestSession(row, summary.session, is_ended)
    return latest_sessions, unreadable


def _decode_protocol_once(plan: SessionPlan, protocols: dict[str, Protocol]) -> Protocol:
    """Return the protocol of a session; decode it and add it to ``protocols``, by SHA-256, if it is not there yet."""
    if plan.protocol_sha256 not in protocols:
        protocols[plan.protocol_sha256] = decode_logged_protocol(plan.protocol_toml, f"the protocol of {plan.study}")
    return protocols[plan.protocol_sha256]


def _find_next_session(last: _LatestSession, log: SessionLog, protocol: Protocol, today: date) -> list[DueSession]:
    """Return a list with the session that the protocol plans after a participant's latest one.

    It is empty if no session is planned, or the participant was screened out.

    Args:
        last: the participant's latest session, which has ended.
        log: the log of that session.
        protocol: the protocol in that log.
        today: the calendar day in the participant's time zone.
    """
    assert last.row.summary is not None
    if last.session >= len(protocol.sessions) or last.row.summary.end_reason == "screened_out":
        return []
    participant = log.plan.participant.id
    group = log.plan.participant.group
    days = protocol.sessions[last.session].days_after_previous
    if days is None:
        return [DueSession(participant, group, last.session + 1, "due")]
    earliest, latest = (find_start_date(log) + timedelta(days=count) for count in days)
    state = _find_state(today, earliest, latest)
    return [DueSession(participant, group, last.session + 1, state, earliest, latest)]


def _find_state(today: date, earliest: date, latest: date) -> DueState:
    if today < earliest:
        return "later"
    if today > latest:
        return "overdue"
    return "due"
