"""Hosted sessions and their recordings: start, resume from a live log, finish or leave. All of it waits for the disk.

A page gets the running host, a host resumed at its exact step from the log of a killed server, or a host for a new
segment.
"""

import hashlib
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from minihuman.admin.manifest import record_log_end
from minihuman.errors import LogError
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.events import FINAL_END_REASONS, Event, SessionStarted
from minihuman.experiment.machine.life_signs import LifeSigns
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.replay import resume_from_events
from minihuman.log.paths import SegmentPath, study_folder
from minihuman.log.record.disk import GroupCommit, RecorderSettings
from minihuman.log.record.file_lock import require_unclaimed
from minihuman.log.record.finalization import put_aside
from minihuman.log.record.mcap_recorder import McapRecorder, resume_segment
from minihuman.log.record.recorder import DeferredRecorder, Recorder
from minihuman.log.record.session_leases import SUPERSEDED, Lease, SessionLeases
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.team_host import TeamTable
from minihuman.storage.remote_store import STORE_URL_FILE_NAME, RemoteStoreError
from minihuman.storage.system import current_system
from minihuman.trust import SOURCE_FACT
from minihuman.web.computed import PageWorld
from minihuman.web.outbox import PageSettings
from minihuman.web.session_host import SessionHost

LOG = logging.getLogger("minihuman")
_RULE_FACTS = (
    "version_minihuman",
    "rules",
    "pictures",
    "shadow_pictures",
    "clauses",
    "number_rules",
    "consent_rules",
    "key_rules",
    "text_rules",
    "message_rules",
    "agent_rules",
    "trial_rules",
    "presence_rules",
)  # facts that must be equal on the server that resumes a session


@dataclass(frozen=True, slots=True)
class HostStorage:
    """The storage to which sessions are recorded, and the objects that their hosts share.

    Args:
        protocol: the study; the policies of its agents are stored beside it.
        data: the data folder.
        group_commit: the writer shared by all sessions of a process.
        teams: the teams among the sessions of a process; None if agents play all partners.
        make_world: makes the worlds of sessions.
    """

    protocol: Protocol
    data: Path
    group_commit: GroupCommit
    teams: TeamTable | None = None
    make_world: WorldFactory = PageWorld


@dataclass(slots=True)
class HostedSession:
    """A session host with its recorder and its log."""

    host: SessionHost
    recorder: Recorder
    started_ns: int  # the wall clock at the segment's time 0, ns since 1970
    segment: str  # the page's name of the segment, as by ``name_segment``
    files: list[McapRecorder] = field(default_factory=list)  # the recorder of its log, once there is a log
    signs: LifeSigns = field(default_factory=LifeSigns)  # of its page and participant

    def find_live_log(self) -> Path | None:
        """Return the path of the log that is being written; None before there is one."""
        if not self.files:
            return None
        return self.files[0].segment_path.part

    @property
    def is_log_broken(self) -> bool:
        """Return whether a write to the log failed."""
        return any(file.is_broken for file in self.files)

    def require_log(self) -> None:
        """Check that everything written so far went to the log.

        Raises:
            LogError: if a write failed.
        """
        for file in self.files:
            file.require_writable()


def start_host(
    plan: SessionPlan,
    disk: HostStorage,
    facts: Mapping[str, str],
    settings: PageSettings,
    *,
    at_sync: Callable[[], None],
    at_team_change: Callable[[], None] = lambda: None,
) -> HostedSession:
    """Start a host for a new segment. Nothing is written to the disk before the consent.

    Args:
        plan: the segment's plan.
        disk: the storage to which the session is recorded.
        facts: the log's facts about the machine and the browser.
        settings: the protocol's settings for pages.
        at_sync: called by the log's thread whenever data became durable.
        at_team_change: called whenever the participant's team has changed.

    Raises:
        LogError: if the log exists already or cannot be written.
    """
    started_ns = current_system().clock.wall_ns()
    recorder_settings = RecorderSettings(group=disk.group_commit, on_sync=at_sync)
    files: list[McapRecorder] = []  # empty until the participant has consented

    def open_recorder() -> Recorder:
        files.append(McapRecorder(disk.data, session.plan, started_ns=started_ns, settings=recorder_settings))
        return files[0]

    require_unclaimed(SegmentPath.of_plan(disk.data, plan))
    session = build_session(plan, disk.make_world, facts, picture_px=settings.picture_px, renders_steps=False)
    recorder = DeferredRecorder(plan, open_recorder)
    signs = LifeSigns(tells_acts=True)
    agent = make_agent_host(disk.protocol, plan, disk.data, teams=disk.teams, changed=at_team_change, signs=signs)
    host = SessionHost(session, recorder, disk.make_world, settings, agent=agent)
    return HostedSession(host, recorder, started_ns, name_segment(disk.data, plan), files, signs)


def resume_host(
    part: Path,
    disk: HostStorage,
    facts: Mapping[str, str],
    settings: PageSettings,
    *,
    at_sync: Callable[[], None],
    at_team_change: Callable[[], None] = lambda: None,
) -> HostedSession:
    """Resume the segment of a live log by feeding the session its own logged events.

    The arguments other than ``part``, the path of the live log, are those of ``start_host``.

    Raises:
        LogError: if the log cannot be resumed, or was begun under other rules than this server's. Its facts apply to
            all of it, so it then has to be recovered and the session resumed in a new segment.
        WorldError: if the session's world cannot be made here.
    """
    resumed = resume_segment(part)
    try:
        _refuse_other_rules(part, resumed.events, facts)
        session, unwritten = resume_from_events(
            resumed.events, disk.make_world, picture_px=settings.picture_px, renders_steps=False
        )
    except BaseException:
        resumed.close()
        raise
    plan = session.plan
    recorder_settings = RecorderSettings(group=disk.group_commit, on_sync=at_sync)
    recorder = McapRecorder(disk.data, plan, started_ns=resumed.started_ns, left=resumed, settings=recorder_settings)
    signs = LifeSigns(tells_acts=True)
    agent = make_agent_host(
        disk.protocol, plan, disk.data, logged=resumed.events, teams=disk.teams, changed=at_team_change, signs=signs
    )
    host = SessionHost(
        session, recorder, disk.make_world, settings, agent=agent, logged=resumed.events, unwritten=unwritten
    )
    return HostedSession(host, recorder, resumed.started_ns, name_segment(disk.data, plan), [recorder], signs)


def _refuse_other_rules(part: Path, events: Sequence[Event], facts: Mapping[str, str]) -> None:
    """Refuse a log that was begun by another release, or with another version of the worlds.

    Raises:
        LogError: if a fact about the rules differs between the log's events and the present facts.
    """
    logged_facts: Mapping[str, str] = {}
    if events and isinstance(events[0], SessionStarted):
        logged_facts = events[0].facts
    for name in {*logged_facts, *facts}:
        is_rule = name in _RULE_FACTS or name.startswith(SOURCE_FACT)
        logged = logged_facts.get(name)
        present = facts.get(name)
        if is_rule and logged != present:
            raise LogError(
                f"{part} was recorded with {name} {logged!r}, but this server has {present!r}; resume it with the "
                "version that recorded it"
            )


def name_segment(data: Path, plan: SessionPlan) -> str:
    """Return a segment's name for pages, a digest that does not reveal which participant the segment belongs to."""
    return hashlib.sha256(str(SegmentPath.of_plan(data, plan).part).encode()).hexdigest()[:16]


class SessionRecording:
    """Finishes the log and the lease of a session that is over, or leaves them if its server stops; waits for the disk.

    Args:
        hosted: the session.
        lease: the session's lease; None if no other machine serves this study.
        leases: this server's session leases; None if no other machine serves this study.
    """

    def __init__(self, hosted: HostedSession, lease: Lease | None, leases: SessionLeases | None) -> None:
        self.is_finishing = False  # whether a task is finishing it
        self.is_delayed = False  # whether finishing has to be tried again
        self.is_finished = False  # whether finishing is done, with a whole log or a broken one
        self.is_broken = False  # whether a part of the log is lost
        self.log: Path | None = None  # the finished log
        self._hosted = hosted
        self._lease = lease
        self._leases = leases
        self._is_closed = False  # whether the log was closed

    def finish(self) -> None:
        """Finish and seal the log. After an ``OSError`` this can be called again.

        Raises:
            LeaseLostError: if another server has the session, so that it did not end here.
            OSError: if the enrolment log cannot be written, the lease cannot be ended, or the log of a session that
                another server can resume cannot be stored where that server can read it.
        """
        reason = self._hosted.host.session.end_reason
        is_final = bool(self._hosted.files) and reason in FINAL_END_REASONS
        if not self._is_closed:
            final_reason = ""
            if is_final:
                final_reason = str(reason)
            self._end_lease(final_reason)
            self._close_log()
        if self.log is not None:
            self._store_log(self.log, is_final=is_final)
        if self._leases is not None and self._lease is not None:
            self._leases.release(self._lease)
        self.is_finished = True

    def _end_lease(self, final_reason: str) -> None:
        """Write the log's pending events to the disk, and end the lease.

        Args:
            final_reason: the reason for which the session ended for good; "" if another server can resume the session.
                The log is then published before it gets its final name.
        """
        if self._leases is None or self._lease is None:
            return
        leases = self._leases
        lease = self._lease
        for file in self._hosted.files:
            with suppress(LogError):  # ``_close_log`` reports the error
                file.drain()
            if not final_reason:
                file.publish = lambda log: leases.publish(lease, log)
        leases.end(lease, final_reason)

    def _close_log(self) -> None:
        """Finish the log, record whether that failed, and close the session's agent."""
        try:
            self.log = self._hosted.recorder.close()
        except LogError as error:
            LOG.warning("a session's log was not finished: %s", error)
            self.is_broken = True
        self._is_closed = True
        self._hosted.host.close_agent()

    def _store_log(self, log: Path, *, is_final: bool) -> None:
        """Seal the log, and replace its copy in the database: by the log if other servers need it, else by nothing.

        Args:
            log: the finished log.
            is_final: whether the session ended for good, so that no other server resumes it.
        """
        is_in_store = _seal_log(log)
        if self._leases is None or self._lease is None:
            return
        is_needed = not is_final
        if (study_folder(log).parent / STORE_URL_FILE_NAME).is_file():
            is_needed = not is_in_store
        if is_needed:
            self._leases.store(self._lease, log)
        else:
            self._leases.store(self._lease, None)

    def leave(self, *, is_dismissed: bool) -> None:
        """Make the log durable and stop hosting the session, which the next server resumes.

        Args:
            is_dismissed: whether another server has the session; the log on this machine is then put aside.
        """
        if self._is_closed:
            return
        self._hosted.host.close_agent()
        for file in self._hosted.files:
            file.leave()
        if self._leases is None or self._lease is None:
            return
        is_released = self._leases.release(self._lease)
        if is_released and is_dismissed:
            with suppress(OSError):  # otherwise it is put aside when the session is leased here again
                for file in self._hosted.files:
                    put_aside(file.segment_path.part, SUPERSEDED)


def _seal_log(log: Path) -> bool:
    """Seal a log, by recording its end in the enrolment log, and copy it to the remote store if there is one.

    Return whether both succeeded.

    After a failure the participant gets the completion code all the same, because the log is on this machine.
    """
    try:
        record_log_end(log)
    except RemoteStoreError as error:
        LOG.warning("%s; `minihuman gather` puts it there later", error)
    except LogError as error:
        LOG.warning("%s is whole, but was not sealed: %s", log, error)
    else:
        return True
    return False
