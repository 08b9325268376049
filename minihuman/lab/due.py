"""Who is due for a further session, who is late, and who broke one off: from the logs and the protocol in them."""

import re
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Literal

import msgspec

from minihuman.errors import LogError
from minihuman.lab.register_lines import read_lines, read_register, replaced_by_others
from minihuman.lab.session_table import SessionRow, sessions
from minihuman.log.read.open_log import open_log
from minihuman.study.events import SETTLED
from minihuman.study.protocol import Protocol, decode_logged

_SESSION_FOLDER = re.compile(r"([^/]+)/ses-(\d+)")
State = Literal["due", "later", "overdue", "unfinished", "unreadable", "never came"]


class Due(msgspec.Struct, frozen=True):
    """What is expected of a participant; dates are days of the calendar in UTC."""

    participant: str
    group: str
    session: int  # that is to come, or to be finished
    state: State
    earliest: date | None = None
    latest: date | None = None

    def line(self) -> str:
        """Say so, and how it goes on."""
        return f"{self.participant:12} {self.group:16} {self.session:7}  {self._words()}"

    def _words(self) -> str:
        again = f"minihuman replace {self.participant}"
        until = f" until {self.latest}" if self.latest else ""
        match self.state:
            case "due":
                return f"due now{until}"
            case "later":
                return f"due from {self.earliest}{until}"
            case "overdue":
                return f"was due until {self.latest}; if they do not come back: {again}"
            case "unfinished":
                return f"was broken off and can be gone on with; if they do not come back: {again}"
            case "unreadable":
                return "has a log that cannot be read: see minihuman status, and minihuman recover"
            case "never came":
                return f"has a slot and never came; to offer it again: {again}"


@dataclass(slots=True)
class _Seen:
    """The furthest session of a participant."""

    row: SessionRow
    session: int
    complete: bool
    started: date


def due(study_dir: Path, today: date) -> tuple[Due, ...]:
    """Everybody of whom a further session is expected, or the rest of one, in order of enrolment.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the register cannot be read.
        ProtocolError: if the protocol in the logs cannot be understood.
    """
    seen, unreadable = _furthest(study_dir)
    replaced = replaced_by_others(read_lines(study_dir))
    protocols: dict[str, Protocol] = {}
    found = []
    for slot in read_register(study_dir):
        if slot.participant in replaced:
            continue
        last = seen.get(slot.participant)
        if (session := unreadable.get(slot.participant, 0)) > (0 if last is None else last.session):
            found.append(Due(slot.participant, slot.group, session, "unreadable"))
        elif last is None:
            found.append(Due(slot.participant, slot.group, 1, "never came"))
        elif not last.complete:
            found.append(Due(slot.participant, slot.group, last.session, "unfinished"))
        else:
            try:
                protocol = _protocol(last.row, protocols)
            except LogError:  # damaged where a glance does not look
                found.append(Due(slot.participant, slot.group, last.session, "unreadable"))
            else:
                found += _next(slot.participant, slot.group, last, protocol, today)
    return tuple(found)


def _furthest(study_dir: Path) -> tuple[dict[str, _Seen], dict[str, int]]:
    """Everybody's furthest session, and the furthest that cannot be read, by whose folder its log is in."""
    seen: dict[str, _Seen] = {}
    unreadable: dict[str, int] = {}
    for row in sessions(study_dir):
        found = row.summary
        if found is None:
            if in_place := _SESSION_FOLDER.fullmatch("/".join(row.path.parts[-3:-1])):
                participant, session = in_place[1], int(in_place[2])
                unreadable[participant] = max(session, unreadable.get(participant, 0))
            continue
        if found.participant in seen and seen[found.participant].session > found.session:
            continue
        whole = found.complete or found.end_reason in SETTLED
        started = datetime.fromisoformat(found.started_at).date()
        seen[found.participant] = _Seen(row, found.session, whole, started)
    return seen, unreadable


def _protocol(row: SessionRow, known: dict[str, Protocol]) -> Protocol:
    """The protocol that a session was played by, read once."""
    plan = open_log(row.path).plan
    if plan.protocol_sha256 not in known:
        known[plan.protocol_sha256] = decode_logged(plan.protocol_toml, f"the protocol of {plan.study}")
    return known[plan.protocol_sha256]


def _next(participant: str, group: str, last: _Seen, protocol: Protocol, today: date) -> list[Due]:
    assert last.row.summary is not None
    if last.session >= len(protocol.sessions) or last.row.summary.end_reason == "screened_out":
        return []
    days = protocol.sessions[last.session].days_after
    if days is None:
        return [Due(participant, group, last.session + 1, "due")]
    earliest, latest = (last.started + timedelta(days=count) for count in days)
    state: State = "later" if today < earliest else "overdue" if today > latest else "due"
    return [Due(participant, group, last.session + 1, state, earliest, latest)]
