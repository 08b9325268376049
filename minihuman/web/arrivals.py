"""Arrivals: who comes to a study's page, by link or from a platform, and what they are to play. Files, no network.

Every call may wait for a lock and for the disk: not on the loop that serves others.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from minihuman.errors import AllocationError, LogError
from minihuman.lab.next_session import is_complete, next_session
from minihuman.lab.recruits import Came, Issued, PlatformId, Recruits, key_of_link
from minihuman.lab.register import free
from minihuman.lab.shelf import ShelfError, gather
from minihuman.log.paths import PART_SUFFIX, session_folder, sessions_in
from minihuman.log.read.open_log import open_log
from minihuman.log.record.finish import leftovers
from minihuman.study.events import SETTLED
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Protocol
from minihuman.web.links import is_token
from minihuman.web.platforms import Visitor, visitor

Reason = Literal["unknown", "closed", "full", "preview", "finished", "not_today", "broken"]


@dataclass(frozen=True, slots=True)
class Arrival:
    """What the page says of who opened it."""

    token: str = ""  # of the link
    platform: Mapping[str, str] = field(default_factory=dict)  # the platform's parameters

    def __repr__(self) -> str:
        """Without what says who they are."""
        return f"Arrival({'token' if self.token else 'no token'}, {len(self.platform)} parameters)"


@dataclass(frozen=True, slots=True)
class Seated:
    """Somebody who may play."""

    key: str  # of their seat: "sub-07/1"
    participant: str
    session: int
    part: Path | None  # the live log of a session that was cut off, or that runs now
    plan: SessionPlan | None  # what is played where there is no such log
    token: str = ""  # of a link made for them just now, which brings them back


@dataclass(frozen=True, slots=True)
class Refused:
    """Somebody who may not, and why."""

    reason: Reason
    ended: str = ""  # where they have taken part: why their last session ended


class Arrivals:
    """The people of one study.

    Args:
        protocol: the study.
        data: the data folder.
    """

    def __init__(self, protocol: Protocol, data: Path) -> None:
        self.protocol = protocol
        self._data = data
        self._study_dir = data / protocol.study.name
        self.recruits = Recruits(self._study_dir)

    def arrive(self, arrival: Arrival) -> Seated | Refused:
        """Say who somebody is, giving them a slot if they are new and may have one.

        Raises:
            OSError: if the study's folder cannot be read or written.
        """
        who = visitor(arrival.platform, self.protocol.web.platforms)
        if who is not None and who.preview:
            return Refused("preview")
        try:
            return self._seated(arrival, who)
        except (AllocationError, LogError):
            return Refused("broken")

    def plan(self, seated: Seated) -> SessionPlan:
        """What somebody plays in a new segment; a log that was cut off is finished first.

        Raises:
            AllocationError: if there is nothing left to play, or it is not the day.
            LogError: if an earlier log is damaged, or is being written.
        """
        return next_session(self.protocol, self._data, participant=seated.participant, session=seated.session)

    def decline(self, seated: Seated, why: str) -> None:
        """Forget somebody who left no data: the register says that one came and why they left, and the slot is free.

        Who agreed to something before, and has data, stays.
        """
        if (self._study_dir / seated.participant).exists():
            return
        self.recruits.forget(seated.participant)
        free(self._study_dir, seated.participant, why)

    def id_on_platform(self, participant: str) -> str:
        """A participant's id on the platform that sent them, for the link back; "" for the others."""
        who = self.recruits.id_of(participant)
        return who.id if who else ""

    def _seated(self, arrival: Arrival, who: Visitor | None) -> Seated | Refused:
        given = key_of_link(arrival.token) if is_token(arrival.token) else ""
        key = given or (self.recruits.key_of_person(who.platform, who.id) if who else "")
        if not key and not self.protocol.web.anyone:
            return Refused("unknown")
        token = ""
        if not key:
            (token,) = self.recruits.issue(1)
            key = key_of_link(token)
        participant, plan = self.recruits.standing().came.get(key), None
        if participant is None:
            first = self._first_time(key, who)
            if isinstance(first, Refused):
                return first
            participant, plan = first
        session = self._session(participant)
        if isinstance(session, str):
            return Refused("finished", session)
        folder = session_folder(self._data, self.protocol.study.name, participant, session)
        part = next(iter(sorted(folder.glob(f"*{PART_SUFFIX}"))), None)
        seated = Seated(f"{participant}/{session}", participant, session, part, plan, token)
        if part is not None or plan is not None:
            return seated
        try:
            return replace(seated, plan=self.plan(seated))
        except AllocationError:
            return Refused("not_today" if session > 1 else "broken")

    def _first_time(self, key: str, who: Visitor | None) -> tuple[str, SessionPlan | None] | Refused:
        """Give the next slot to somebody new, and say what they play if they have just got it."""
        with self.recruits.exclusive() as file:
            if key in file.standing.came:
                return file.standing.came[key], None  # in another tab, at the same moment
            known = not key.startswith("link:") or key in file.standing.issued
            if not known and not self.protocol.web.anyone:
                return Refused("unknown")
            if not file.standing.recruiting:
                return Refused("closed")
            try:
                plan = next_session(self.protocol, self._data)
            except AllocationError:
                return Refused("full")
            participant = plan.participant.id
            if who is not None:
                self.recruits.remember(PlatformId(participant, who.platform, who.id))
            issued = [] if known else [Issued(key, file.now())]  # a page's own, where anybody may come
            file.write(*issued, Came(key, participant, file.now()))
            return participant, plan

    def _session(self, participant: str) -> int | str:
        """The first of a participant's sessions that is not complete; if all are, why the last one ended."""
        ended = ""
        with suppress(ShelfError):  # it is away: what is here is what there is
            gather(self._data, f"{self.protocol.study.name}/{participant}/")
        for session in range(1, max(1, len(self.protocol.sessions)) + 1):
            folder = session_folder(self._data, self.protocol.study.name, participant, session)
            if not folder.is_dir() or leftovers(folder) or not sessions_in(folder):
                return session
            log = open_log(folder)
            ended = log.end_reason
            if ended in SETTLED - {"complete"}:
                return ended
            if not is_complete(log):
                return session
        return ended
