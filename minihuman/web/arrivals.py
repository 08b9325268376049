"""Arrivals: identifies the visitors who open a study's page, and plans their sessions.

Visitors come by link or from a recruiting platform. This module uses no network. A link carries an unguessable token
behind the #, which browsers send to no server. Each call may wait for a lock and for the disk, so it must not run on
the event loop.
"""

import logging
import re
from collections.abc import Container, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

from minihuman.admin.enrolment_entries import AuditNote
from minihuman.admin.enrolment_log import free_slot
from minihuman.admin.manifest import find_unrecorded_logs, record_log_end
from minihuman.admin.next_session import is_session_complete, plan_next_session
from minihuman.admin.recruitment import LinkIssued, ParticipantArrived, PlatformId, Recruitment, hash_link_token
from minihuman.admin.remote_logs import sync_logs
from minihuman.admin.withdrawal import replace_participant
from minihuman.errors import AllocationError, LogError
from minihuman.experiment.machine.events import FINAL_END_REASONS
from minihuman.experiment.plan.allocation import allocation_sha256, build_allocation_list
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import RecruitmentPlatform
from minihuman.log.paths import PART_SUFFIX, list_log_files, list_sessions, session_folder
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.finalization import find_leftovers
from minihuman.log.record.session_leases import Lease, SessionLeases, name_session
from minihuman.storage.lease import LeaseHeldError
from minihuman.storage.remote_store import RemoteStoreError
from minihuman.storage.system import now_text
from minihuman.web.arrival_signature import SIGNATURE_PARAMETER, is_signed

LOG = logging.getLogger("minihuman")
_TOKEN = re.compile(r"[A-Za-z0-9_-]{22}")  # 16 random bytes, as secrets.token_urlsafe writes them


def build_link(address: str, token: str) -> str:
    """Build a participant's link from the page's address and the participant's token."""
    return f"{address}#t={token}"


def is_token(text: str) -> bool:
    """Return whether a text has the form of a link's token, so that most guesses need no lookup."""
    return _TOKEN.fullmatch(text) is not None


_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_PARAMETERS: dict[RecruitmentPlatform, str] = {"prolific": "PROLIFIC_PID", "sona": "survey_code", "mturk": "workerId"}
_FRAGMENTS: dict[RecruitmentPlatform, str] = {
    "prolific": "#PROLIFIC_PID={{%PROLIFIC_PID%}}",
    "sona": "#survey_code=%SURVEY_CODE%",
    "mturk": "",  # it adds ?workerId=... itself
}
_PREVIEW = "ASSIGNMENT_ID_NOT_AVAILABLE"  # MTurk shows a task to people who have not taken it


@dataclass(frozen=True, slots=True)
class PlatformVisitor:
    """A visitor sent by a recruiting platform."""

    platform: RecruitmentPlatform
    id: str
    preview: bool = False  # whether they see a preview of a task that they have not accepted
    signature: str = ""  # proof that they came through one of the study's own links

    def __repr__(self) -> str:
        """Return a description without the id, which must appear in no log and no traceback."""
        return f"Visitor({self.platform})"


def identify_visitor(parameters: Mapping[str, str], allowed: tuple[RecruitmentPlatform, ...]) -> PlatformVisitor | None:
    """Return the visitor whom a link's parameters identify on one of the allowed platforms; None without a valid id."""
    for platform in allowed:
        visitor_id = parameters.get(_PARAMETERS[platform], "")
        if _ID.fullmatch(visitor_id):
            preview = parameters.get("assignmentId") == _PREVIEW
            return PlatformVisitor(
                platform, visitor_id, preview=preview, signature=parameters.get(SIGNATURE_PARAMETER, "")
            )
    return None


def build_platform_link(platform: RecruitmentPlatform, address: str) -> str:
    """Build a study's link for a platform; the platform inserts a visitor's id behind the #, which no server logs."""
    return f"{address}{_FRAGMENTS[platform]}"


RejectionReason = Literal["unknown", "closed", "full", "preview", "finished", "not_today", "broken", "wait"]


@dataclass(frozen=True, slots=True)
class Arrival:
    """What the page reports about the visitor who opened it."""

    token: str = ""  # of the link
    platform: Mapping[str, str] = field(default_factory=dict)  # the platform's parameters
    utc_offset_min: int | None = None  # of the browser's local time

    def __repr__(self) -> str:
        """Return a description without anything that identifies the visitor."""
        token = "no token"
        if self.token:
            token = "token"
        return f"Arrival({token}, {len(self.platform)} parameters)"


@dataclass(frozen=True, slots=True)
class Admission:
    """A visitor who may take part."""

    key: str  # of their connection: "sub-07/1"
    participant: str
    session: int
    part: Path | None  # the live log of a session that was cut off, or that runs now; None if there is none
    plan: SessionPlan | None  # of the session to start; None if there is a live log to resume
    token: str = ""  # of a link made for them just now, which brings them back
    lease: Lease | None = None  # of the session; None where this server hosts it already, or is the only one
    utc_offset_min: int | None = None  # of the visitor's local time
    is_invited: bool = False  # by a link that was issued before


@dataclass(frozen=True, slots=True)
class Rejection:
    """A visitor who may not take part, and the reason."""

    reason: RejectionReason
    ended: str = ""  # why their last session ended; "" if they have not taken part
    session: int = 1  # the number of their last session
    person: str = ""  # their id on the platform that sent them


class Arrivals:
    """Admits visitors to one study, plans their sessions, and hands over sessions that did not start.

    Args:
        protocol: the study.
        data: the data folder.
        leases: this server's session leases; None if no other machine serves this study.
        arrival_key: the key that signs visitors, if the study requires signatures.
    """

    def __init__(
        self, protocol: Protocol, data: Path, leases: SessionLeases | None = None, *, arrival_key: bytes = b""
    ) -> None:
        self.protocol = protocol
        self.leases = leases
        self.hosted: Container[str] = ()  # the keys of the sessions that this server hosts
        self._data = data
        self._arrival_key = arrival_key
        self._study_dir = data / protocol.study.name
        self.recruits = Recruitment(self._study_dir)
        # cached for later calls: the list of 100,000 slots takes longer than a journal may be held
        allocation_sha256(build_allocation_list(protocol))

    def arrive(self, arrival: Arrival) -> Admission | Rejection:
        """Identify a visitor, and enrol a new visitor if the study has room; return the admission or the rejection.

        Raises:
            OSError: if the study's folder cannot be read or written.
        """
        platform_visitor = identify_visitor(arrival.platform, self.protocol.web.recruitment_platforms)
        if platform_visitor is not None and platform_visitor.preview:
            return Rejection("preview")
        if not self._is_proven(arrival, platform_visitor):
            return Rejection("unknown")
        try:
            return self._admit_visitor(arrival, platform_visitor)
        except LeaseHeldError:
            return Rejection("wait")
        except (AllocationError, LogError) as error:
            LOG.warning("a participant was refused: %s", error)
            if isinstance(error, RemoteStoreError):
                return Rejection("wait")
            return Rejection("broken")

    def is_invited(self, token: str) -> bool:
        """Return whether the study issued the link with a token; a guessed token is no invitation.

        Raises:
            OSError: if the study's folder cannot be read.
        """
        return is_token(token) and self.recruits.has_issued(hash_link_token(token))

    def _is_proven(self, arrival: Arrival, platform_visitor: PlatformVisitor | None) -> bool:
        """Return whether a visitor has the proof that the study requires, if any: one of its links or a signature."""
        if not self.protocol.web.require_signed_arrival or self.is_invited(arrival.token):
            return True
        study = self.protocol.study.name
        return platform_visitor is not None and is_signed(
            self._arrival_key, study, platform_visitor.platform, platform_visitor.id, platform_visitor.signature
        )

    def plan(self, admission: Admission) -> SessionPlan:
        """Plan a participant's next segment, after finishing a log that was cut off.

        Raises:
            AllocationError: if there is nothing left to play, or this is not the day of the session.
            LogError: if an earlier log is damaged, or is being written.
            OSError: if the log cannot be stored where every server can read it.
        """
        return plan_next_session(
            self.protocol,
            self._data,
            participant=admission.participant,
            session=admission.session,
            utc_offset_min=admission.utc_offset_min,
            publish=partial(self._publish_log, admission.lease),
        )

    def _publish_log(self, lease: Lease | None, log: Path) -> None:
        """Store a log where other servers can read it, if there are any."""
        if self.leases is not None and lease is not None:
            self.leases.publish(lease, log)

    def decline(self, admission: Admission, why: str) -> None:
        """Free the slot of a visitor who left no data, and forget the visitor; the enrolment log records the reason.

        A participant with earlier data stays enrolled.

        Args:
            admission: the visitor's admission.
            why: the reason, for the enrolment log.
        """
        if (self._study_dir / admission.participant).exists():
            return
        self.recruits.forget(admission.participant)
        free_slot(self._study_dir, admission.participant, why)

    def release(self, admission: Admission, why: str) -> None:
        """Free the slot of a visitor who left before playing, so that another can take it; the visitor may come back.

        A visitor who has taken part in an earlier session keeps the slot.

        Args:
            admission: the visitor's admission.
            why: the reason why the session ended, such as ``timed_out``, for the enrolment log.
        """
        if admission.session > 1:
            return
        reason = f"left without playing: {why.replace('_', ' ')}"
        replace_participant(self._study_dir, admission.participant, AuditNote(reason, "server"))

    def find_platform_id(self, participant: str) -> str:
        """Return a participant's id on the recruiting platform, for the link back; "" if no platform sent them."""
        platform_visitor = self.recruits.ids().get(participant)
        if platform_visitor is None:
            return ""
        return platform_visitor.id

    def _admit_visitor(self, arrival: Arrival, platform_visitor: PlatformVisitor | None) -> Admission | Rejection:
        """Find the participant who a visitor is, or enrol a new one; return the admission to the next session.

        Returns:
            The admission; a rejection if the visitor may not take part, or the participant has no session to play.

        Raises:
            LeaseHeldError: if another server hosts the session.
            LogError: if a log of the participant cannot be read, finished or fetched.
        """
        key = self._find_visitor_key(arrival, platform_visitor)
        if not key and not self.protocol.web.open_access:
            return Rejection("unknown")
        is_invited = self.is_invited(arrival.token)
        token = ""
        if not key:
            (token,) = self.recruits.issue(1)
            key = hash_link_token(token)
        participant = self.recruits.find_participant(key)
        plan = None
        if participant is None:
            enrolment = self._enrol_visitor(key, platform_visitor)
            if isinstance(enrolment, Rejection):
                return enrolment
            participant, plan = enrolment
        leased_session = self._lease_next_session(participant)
        if isinstance(leased_session, str):
            last = max(1, len(self.protocol.sessions))  # a study that declares no sessions has one
            return Rejection("finished", leased_session, last, self.find_platform_id(participant))
        session, lease = leased_session
        try:
            admission = self._plan_admission(participant, session, plan, arrival.utc_offset_min)
        except BaseException:
            self._release_lease(lease)
            raise
        if isinstance(admission, Rejection):
            self._release_lease(lease)
            return admission
        return replace(admission, token=token, lease=lease, is_invited=is_invited)

    def _find_visitor_key(self, arrival: Arrival, platform_visitor: PlatformVisitor | None) -> str:
        """Return the key of a visitor's link or, without a link, of the visitor's id on a platform; "" without both."""
        if is_token(arrival.token):
            return hash_link_token(arrival.token)
        if platform_visitor is not None:
            return self.recruits.hash_platform_id(platform_visitor.platform, platform_visitor.id)
        return ""

    def _release_lease(self, lease: Lease | None) -> None:
        if self.leases is not None and lease is not None:
            self.leases.release(lease)

    def _plan_admission(
        self, participant: str, session: int, plan: SessionPlan | None, utc_offset_min: int | None
    ) -> Admission | Rejection:
        """Return the admission to a session, with its live log if it can be resumed, and otherwise with its plan.

        Args:
            participant: the participant's code.
            session: the session's number.
            plan: the plan if the participant has just been enrolled; None to plan a session without a live log.
            utc_offset_min: the offset of the visitor's local time from UTC, in minutes; None if it is not known.

        Returns:
            The admission; a rejection if there is nothing to play today.
        """
        folder = session_folder(self._data, self.protocol.study.name, participant, session)
        part = next(iter(list_log_files(folder, f"*{PART_SUFFIX}")), None)
        key = f"{participant}/{session}"
        admission = Admission(key, participant, session, part, plan, utc_offset_min=utc_offset_min)
        if part is not None or plan is not None:
            return admission
        try:
            return replace(admission, plan=self.plan(admission))
        except AllocationError:
            if session == 1:
                return Rejection("broken")
            ended = self._read_end_reason(participant, session - 1)
            return Rejection("not_today", ended, session - 1, self.find_platform_id(participant))

    def _enrol_visitor(
        self, key: str, platform_visitor: PlatformVisitor | None
    ) -> tuple[str, SessionPlan | None] | Rejection:
        """Enrol a new visitor in the next slot; return the participant's code and the plan of the first session.

        The plan is None if the visitor was enrolled in the meantime. A study that is closed or full, or does not know
        the link, rejects the visitor.

        Args:
            key: the visitor's key, as ``_find_visitor_key`` returns it, or that of a link that was just made.
            platform_visitor: the visitor's id on a platform; None if no platform sent the visitor.
        """
        with self.recruits.exclusive() as recruits:
            if key in recruits.standing.came:
                return recruits.standing.came[key], None  # another tab was first
            is_expected = not key.startswith("link:") or key in recruits.standing.issued
            if not is_expected and not self.protocol.web.open_access:
                return Rejection("unknown")
            if not recruits.standing.recruiting:
                return Rejection("closed")
            try:
                plan = plan_next_session(self.protocol, self._data)
            except AllocationError:
                return Rejection("full")
            participant = plan.participant.id
            if platform_visitor is not None:
                self.recruits.remember(PlatformId(participant, platform_visitor.platform, platform_visitor.id))
            issued = []
            if not is_expected:  # a link made by the page, in an open study
                issued.append(LinkIssued(key, now_text()))
            recruits.journal.append(*issued, ParticipantArrived(key, participant, now_text()))
            return participant, plan

    def _lease_next_session(self, participant: str) -> tuple[int, Lease | None] | str:
        """Find a participant's first incomplete session, and lease it unless it is hosted here or leases are not used.

        Returns:
            The session's number and its lease, which is None if it was not leased; if there is no such session, the
            reason why the participant's last session ended.

        Raises:
            LeaseHeldError: if another server hosts the session.
            RemoteStoreError: if the files that another server stored cannot be fetched.
        """
        if self.leases is None:
            with suppress(RemoteStoreError):  # without the store, only the logs on this machine count
                self._sync_logs(participant)
        n_sessions = max(1, len(self.protocol.sessions))  # a study that declares no sessions has one
        for session in range(1, n_sessions + 1):
            lease = None
            end_reason = self._read_end_reason(participant, session)
            is_hosted_here = f"{participant}/{session}" in self.hosted
            if not end_reason and self.leases is not None and not is_hosted_here:
                lease = self._lease_session(self.leases, participant, session)
                end_reason = lease.grant.ended or self._read_end_reason(participant, session)
            if not end_reason:
                return session, lease
            self._release_lease(lease)
            if end_reason in FINAL_END_REASONS - {"complete"}:
                return end_reason
        return end_reason

    def _lease_session(self, leases: SessionLeases, participant: str, session: int) -> Lease:
        """Lease a session, and restore its files if another server has hosted it.

        Raises:
            LeaseHeldError: if another server hosts the session.
            RemoteStoreError: if the files that another server stored cannot be fetched.
        """
        lease = leases.acquire(name_session(self.protocol.study.name, participant, session))
        try:
            if not lease.grant.ended:
                try:
                    self._sync_logs(participant)
                except RemoteStoreError:
                    if lease.grant.copied:  # otherwise no other server has recorded anything of the session
                        raise
                folder = session_folder(self._data, self.protocol.study.name, participant, session)
                leases.restore(lease, folder)
                if lease.grant.copied and not (folder.is_dir() and list_sessions(folder)):
                    raise RemoteStoreError(
                        f"the log of {lease.session} is in the remote store, which does not show it; is it mounted?"
                    )
        except BaseException:
            leases.release(lease)
            raise
        return lease

    def _sync_logs(self, participant: str) -> None:
        sync_logs(self._data, f"{self.protocol.study.name}/{participant}/")

    def _read_end_reason(self, participant: str, session: int) -> str:
        """Return the reason why a session ended, from its log on this machine; "" without a complete log."""
        folder = session_folder(self._data, self.protocol.study.name, participant, session)
        if not folder.is_dir() or find_leftovers(folder) or not list_sessions(folder):
            return ""
        log = read_log(folder)
        if not is_session_complete(log):
            return ""
        return log.end_reason

    def settle(self, admission: Admission) -> None:
        """Release the lease, if any, of a session that was not started; if its log is whole, mark the session as ended.

        Errors in marking it are ignored.
        """
        if self.leases is None or admission.lease is None:
            return
        if ended := self._read_end_reason(admission.participant, admission.session):
            with suppress(LogError, OSError):  # the log is here, and `gather` brings it to the store
                self.leases.end(admission.lease, ended)
                self._sync_logs(admission.participant)
        self.leases.release(admission.lease)

    def finish_ended(self) -> None:
        """Finish the logs of sessions that had ended when this server was killed.

        Then add to the enrolment log the chain heads of finished logs that it lacks. Do nothing if no other machine
        serves this study.

        Raises:
            OSError: if the database or the remote store cannot be reached, or a log cannot be written.
            LogError: if a log cannot be finished.
        """
        if self.leases is None:
            return
        for part in find_leftovers(self._study_dir):
            with suppress(LeaseHeldError):
                finished = self.leases.recover(part, only_ended=True)
                if finished and finished.readable:
                    record_log_end(finished.path)
        for log in find_unrecorded_logs(self._study_dir):
            record_log_end(log)
