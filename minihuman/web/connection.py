"""A participant's connection: the session host, its recorder, its streams, and the newest socket. asyncio and disk.

A page gets the host that is running, one resumed at its exact step from the log of a killed server, or one for a new
segment. Making one waits for the disk.
"""

import asyncio
import contextlib
import hashlib
import itertools
import logging
import re
import secrets
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from ipaddress import ip_address
from pathlib import Path
from weakref import WeakValueDictionary

from minihuman.admin.manifest import record_log_end
from minihuman.errors import AllocationError, LogError, MinihumanError
from minihuman.experiment.machine.events import FINAL_END_REASONS, Event, SessionStarted
from minihuman.experiment.machine.inputs import ExperimenterCommand, Stop
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.session_plan import SessionPlan, needs_gamepad
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.replay import resume_from_events
from minihuman.experiment.words import InterfaceWords
from minihuman.log.paths import LOG_SUFFIX, SegmentPath, session_folder, study_folder
from minihuman.log.record.disk import GroupCommit, RecorderSettings
from minihuman.log.record.file_lock import is_being_recorded, require_unclaimed
from minihuman.log.record.finalization import put_aside
from minihuman.log.record.mcap_recorder import McapRecorder, resume_segment
from minihuman.log.record.recorder import DeferredRecorder, Recorder
from minihuman.log.record.session_leases import SUPERSEDED, SessionLeases
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.session_loop import CommandInbox, inbox_path
from minihuman.runtime.team_host import TeamTable
from minihuman.storage.remote_store import STORE_URL_FILE_NAME, RemoteStoreError
from minihuman.storage.system import current_system, monotonic_s
from minihuman.trust import SOURCE_FACT
from minihuman.web import messages
from minihuman.web.arrivals import Admission, Arrival, Arrivals, Rejection, identify_visitor, is_token
from minihuman.web.computed import PageWorld
from minihuman.web.eligibility import (
    BrowserProperties,
    Completion,
    build_completion,
    check_eligibility,
    classify_ending,
    collect_browser_facts,
    find_utc_offset_min,
    get_page_texts,
    get_session_code,
    list_touch_keys,
    needs_keyboard,
    requires_gamepad,
)
from minihuman.web.messages import KEY_CODES, IncomingStream
from minihuman.web.outbox import PageSettings
from minihuman.web.session_host import SessionHost
from minihuman.worlds.source_digest import kernels_digest

_RULES = (
    "version_minihuman",
    "rules",
    "pictures",
    "clauses",
    "number_rules",
    "consent_rules",
    "agent_rules",
)  # facts that say by what a session was played


@dataclass(frozen=True, slots=True)
class HostStorage:
    """Where sessions are recorded.

    Args:
        protocol: the study; the policies of its agents lie beside it.
        data: the data folder.
        group_commit: writes for all sessions of a process.
        teams: those of the sessions of a process.
    """

    protocol: Protocol
    data: Path
    group_commit: GroupCommit
    teams: TeamTable | None = None


@dataclass(slots=True)
class HostedSession:
    """A session host, and what it records to."""

    host: SessionHost
    recorder: Recorder
    started_ns: int  # the wall clock at the segment's time 0, ns since 1970
    segment: str  # what the page calls the segment: it says nothing of whose it is
    files: list[McapRecorder] = field(default_factory=list)  # its log, once there is one


def start_host(
    plan: SessionPlan,
    disk: HostStorage,
    facts: Mapping[str, str],
    settings: PageSettings,
    *,
    at_sync: Callable[[], None],
    at_team_change: Callable[[], None] = lambda: None,
) -> HostedSession:
    """Start a host for a new segment; nothing is on the disk before the consent.

    Raises:
        LogError: if the log exists already or cannot be written.
    """
    started_ns = current_system().clock.wall_ns()
    files: list[McapRecorder] = []

    def opened() -> Recorder:
        files.append(
            McapRecorder(
                disk.data,
                session.plan,
                started_ns=started_ns,
                settings=RecorderSettings(group=disk.group_commit, on_sync=at_sync),
            )
        )
        return files[0]

    require_unclaimed(SegmentPath.of_plan(disk.data, plan))
    session = build_session(plan, PageWorld, facts, picture_px=settings.picture_px, renders_steps=False)
    recorder = DeferredRecorder(plan, opened)
    agent = make_agent_host(disk.protocol, plan, disk.data, teams=disk.teams, changed=at_team_change)
    host = SessionHost(session, recorder, PageWorld, settings, agent=agent)
    return HostedSession(host, recorder, started_ns, _name(disk.data, plan), files)


def resume_host(
    part: Path,
    disk: HostStorage,
    facts: Mapping[str, str],
    settings: PageSettings,
    *,
    at_sync: Callable[[], None],
    at_team_change: Callable[[], None] = lambda: None,
) -> HostedSession:
    """Resume the segment of a live file: the session is fed its own log.

    Raises:
        LogError: if that cannot be, or if the segment began by other rules than are here, which its facts say of all of
            it; then the file is to be recovered, and the session resumes in another segment.
        WorldError: if its world cannot be made here.
    """
    left = resume_segment(part)
    try:
        _refuse_other_rules(part, left.events, facts)
        session, unwritten = resume_from_events(
            left.events, PageWorld, picture_px=settings.picture_px, renders_steps=False
        )
    except BaseException:
        left.close()
        raise
    plan = session.plan
    recorder = McapRecorder(
        disk.data,
        plan,
        started_ns=left.started_ns,
        left=left,
        settings=RecorderSettings(group=disk.group_commit, on_sync=at_sync),
    )
    agent = make_agent_host(
        disk.protocol, plan, disk.data, logged=left.events, teams=disk.teams, changed=at_team_change
    )
    host = SessionHost(session, recorder, PageWorld, settings, agent=agent, logged=left.events, unwritten=unwritten)
    return HostedSession(host, recorder, left.started_ns, _name(disk.data, plan), [recorder])


def _refuse_other_rules(part: Path, events: Sequence[Event], facts: Mapping[str, str]) -> None:
    """Refuse what another release began, or another state of the worlds."""
    began = events[0].facts if events and isinstance(events[0], SessionStarted) else {}
    for name in {*began, *facts}:
        if (name in _RULES or name.startswith(SOURCE_FACT)) and began.get(name) != facts.get(name):
            raise LogError(
                f"{part} was recorded with {name} {began.get(name)!r}, but this server has {facts.get(name)!r}; resume "
                "it with the version that recorded it"
            )


def _name(data: Path, plan: SessionPlan) -> str:
    return hashlib.sha256(str(SegmentPath.of_plan(data, plan).part).encode()).hexdigest()[:16]


LOG = logging.getLogger("minihuman")
_ACTS = messages.KeyMessage | messages.PointerMessage | messages.TextMessage | messages.AxisMessage  # of a person
_AHEAD_NS = 5_000_000_000  # a page's clock may be so far before ours, and a thousandth more with time
_MAX_OUTAGE_NS = 86_400_000_000_000


class Connection:
    """One participant's.

    Args:
        admission: whose it is.
        hosted: their session.
        inbox: the experimenter's commands.
        leases: of this server; None where no other machine has this study.
    """

    def __init__(
        self, admission: Admission, hosted: HostedSession, inbox: CommandInbox, leases: SessionLeases | None = None
    ) -> None:
        self.key = admission.key
        self.admission = admission
        self.lease = admission.lease if leases is not None else None
        self._leases = leases
        self.dismissed = 0  # with this code its page was sent away: another server has the session
        self.segment = hosted.segment
        self.host: SessionHost = hosted.host
        self.changed = asyncio.Event()  # there is something to send
        self.ping: tuple[int, int] | None = None  # of a batch: when it was sent and received; answered with the rest
        self.finishing = False
        self.delayed = False  # its end is, since the enrolment log is unavailable
        self.finished = False  # its log is on the disk, or never will be
        self.seen_s = monotonic_s()  # when a socket was here last
        self.acted_s = self.seen_s  # when something was pressed last
        self.sockets = 0  # how many there have been; the newest counts
        self.here = False  # the newest is open
        self.life = ""
        self.blind = False  # what keys lead to cannot be found out
        self.broken = False  # something of its log is lost
        self._hosted = hosted
        self._inbox = inbox
        self._closed = False  # its log is
        clock = current_system().clock  # the wall clock may have been set back since a session began
        self._zero_ns = clock.monotonic_ns() - max(clock.wall_ns() - hosted.started_ns, hosted.host.last_at_ns)
        self._incoming = IncomingStream()
        self._stream = ""
        self.loop = asyncio.get_running_loop()
        self.path: Path | None = None
        self.network = ""  # from which it was made, in memory only
        self.over: messages.SessionOver | None = None  # the last message to the page

    @property
    def agreed(self) -> bool:
        """Whether anything is recorded: there was a consent, or none was asked for."""
        return bool(self._hosted.files)

    def gone(self, number: int) -> None:
        """A socket is closed."""
        self.here = self.here and number != self.sockets

    def forget(self) -> None:
        """Keep nothing for the page: it begins anew when it comes again."""
        self.life = ""
        self.host.restart()

    def now_ns(self) -> int:
        """The session's time, by the server's clock."""
        return current_system().clock.monotonic_ns() - self._zero_ns

    def greet(self, hello: messages.Hello) -> tuple[messages.Welcome, int]:
        """Welcome a page on a new socket; return the answer and the last of our messages that it has."""
        self.sockets += 1
        self.here = True
        self.seen_s = monotonic_s()
        if hello.stream != self._stream:
            self._stream, self._incoming = hello.stream, IncomingStream(hello.first - 1)
            self.host.begin_stream(hello.first - 1)
        ahead_ns = hello.last - self.now_ns()
        if hello.segment == self.segment and 0 < ahead_ns < _MAX_OUTAGE_NS:
            self._zero_ns -= ahead_ns  # the page's clock ran on while there was no server
        again = bool(self.life) and hello.life == self.life and hello.heard <= self.host.outgoing.last_number
        if again:
            self.host.outgoing.acknowledge(hello.heard)
        else:
            self.life = secrets.token_hex(4)
            self.host.restart(computes=bool(hello.kernels) and hello.kernels == kernels_digest())
            if self.over is not None:
                self.host.outgoing.add(self.over)
        plan = self.host.session.plan
        welcome = messages.Welcome(
            segment=self.segment,
            life=self.life,
            again=again,
            heard=self._incoming.received,
            now=max(self.now_ns(), self.host.last_at_ns + 1),
            keys=dict(KEY_CODES),
            touch=list_touch_keys(plan),
            gamepad=needs_gamepad(plan),
            token=self.admission.token,
            words=get_page_texts(plan.language)
            | {"quit_title": InterfaceWords(plan.language, plan.words)["quit.title"]},
            taken=self.host.last_at_ns,
        )
        return welcome, hello.heard if again else 0

    def take(self, numbered: messages.NumberedMessage, *, more: bool = False) -> None:
        """Take a message of the page's stream; ``more`` came with it. A log that cannot be written ends the session.

        Raises:
            MessageError: if it is out of order, or of another time.
        """
        before = self._incoming.received
        if self.dismissed or not self._incoming.take(numbered.n):
            return
        try:
            self._take_new(numbered, more=more)
        except messages.MessageError:
            self._incoming.received = before  # it was refused, so that the page must not hear that it was taken
            raise

    def _take_new(self, numbered: messages.NumberedMessage, *, more: bool) -> None:
        arrival_ns = current_system().clock.monotonic_ns()
        now_ns = arrival_ns - self._zero_ns
        if numbered.at > now_ns + _AHEAD_NS + now_ns // 1000:
            raise messages.MessageError(
                f"message {numbered.n} has time {numbered.at} ns, but the session is at {now_ns} ns; reload the page"
            )
        if self.host.over:
            return
        if isinstance(numbered.what, _ACTS):
            self.acted_s = arrival_ns / 1e9
        if self._guarded(self.host.receive, numbered.n, numbered.at, numbered.what, more=more, arrival_ns=arrival_ns):
            self.host.outbox.record_step_time(current_system().clock.monotonic_ns() - arrival_ns)

    def poll(self) -> bool:
        """See whether a learner has made something; True if there is something to tell the page."""
        found = bool(self._guarded(self.host.poll))
        if found:
            self.changed.set()
        return found

    def grow(self) -> bool:
        """Look one scene further ahead; False if nothing is left. Where that fails the session goes on without."""
        if self.blind:
            return False
        try:
            return self.host.grow()
        except Exception:  # a bug of ours or of a world's: this page alone waits for the network
            LOG.exception("nothing is looked for ahead of a session any more")
            self.blind = True
            return False

    def send_prefetched(self) -> None:
        """Tell the page what was found ahead."""
        self.host.outbox.send_prefetched()
        self.changed.set()

    def read_inbox(self) -> None:
        """Hand on what the experimenter asks for: to the page, or at once where there is none."""
        for request in self._inbox.read_new():
            if self.here:
                self.host.ask(request.what, request.text)
            else:
                asked = ExperimenterCommand(max(self.now_ns(), self.host.last_at_ns + 1), request.what, request.text)
                self._guarded(self.host.stop, asked)
            self.changed.set()

    def stop(self, reason: str, detail: str) -> None:
        """End the session from outside."""
        at_ns = max(self.now_ns(), self.host.last_at_ns + 1)
        self._guarded(self.host.stop, Stop(at_ns, reason, detail))  # type: ignore[arg-type]
        self.changed.set()

    def _guarded(self, do: Callable[..., bool | None], *arguments: object, **others: object) -> bool | None:
        try:
            return do(*arguments, **others)
        except LogError as error:
            self.host.session.receive(Stop(self.host.last_at_ns, "disk_full", str(error)))
        except messages.MessageError:
            raise
        except Exception as error:  # a bug of ours: this session ends, the others go on
            LOG.exception("a session failed")
            stop = Stop(self.host.last_at_ns, "internal_error", f"{type(error).__name__}: {error}")
            with suppress(Exception):
                self.host.stop(stop)
        return None

    def safe(self) -> int:
        """The last of the page's messages that may be acknowledged: that no crash and no other server can undo."""
        return self.host.safe(None if self.lease is None else self.lease.count_acknowledgeable(monotonic_s()))

    def dismiss(self, code: int) -> None:
        """Send the page away: this server does not host the session any more."""
        self.dismissed = code
        self.here = False
        self.sockets += 1
        self.changed.set()

    def finish(self) -> None:
        """Finish the log and seal it; blocks for the disk. After an ``OSError`` it can be called again.

        Raises:
            LeaseLostError: if another server has the session: it did not end here.
            OSError: if the enrolment log cannot be written, the lease cannot be ended, or the log of a session that
                another server can resume cannot be kept where that server has it.
        """
        reason, leases, lease = self.host.session.end_reason, self._leases, self.lease
        is_final = self.agreed and reason in FINAL_END_REASONS
        if not self._closed:
            if leases is not None and lease is not None:
                for file in self._hosted.files:
                    with suppress(LogError):  # said below, where it is closed
                        file.drain()
                    if not is_final:
                        file.publish = lambda log: leases.publish(lease, log)
                leases.end(lease, str(reason) if is_final else "")
            try:
                self.path = self._hosted.recorder.close()
            except LogError as error:
                LOG.warning("a session's log was not finished: %s", error)
                self.broken = True
            self._closed = True
            self.host.close_agent()
        if self.path is not None:
            is_stored = _record_end(self.path)
            if leases is not None and lease is not None:
                has_store = (study_folder(self.path).parent / STORE_URL_FILE_NAME).is_file()
                leases.store(lease, None if (is_stored if has_store else is_final) else self.path)
        if leases is not None and lease is not None:
            leases.release(lease)
        self.finished = True

    def leave(self) -> None:
        """Make it durable and go: the next server goes on with it. Blocks for the disk.

        Of a session that was left to another server the log that is here is put aside.
        """
        if not self._closed:
            self.host.close_agent()
            for file in self._hosted.files:
                file.leave()
            if self._leases is not None and self.lease is not None and self._leases.release(self.lease):
                with suppress(OSError):  # else it is put aside when the session is leased here again
                    for file in self._hosted.files if self.dismissed else ():
                        put_aside(file.where.part, SUPERSEDED)


def _record_end(log: Path) -> bool:
    """Seal a log, and copy it to the remote store; False where that failed.

    A failure costs no participant their code, as the log is here.
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


_FOR_GOOD = (
    "browser",
    "keyboard",
    "latency",
)  # ineligible for good, so the page gives a code; a window can be made larger
_SIZE = re.compile(r"(\d{1,5}) x (\d{1,5})")


class ConnectionFactory:
    """Makes the connections of a study.

    Args:
        arrivals: the study, and who comes.
        data: where sessions are kept.
        connections: the open ones; new ones are added.
        group: writes their logs; None: a thread of its own.
    """

    def __init__(
        self, arrivals: Arrivals, data: Path, connections: dict[str, Connection], *, group: GroupCommit | None = None
    ) -> None:
        self.facts: Mapping[str, str] = {}  # of this machine
        self._arrivals, self._data, self._connections = arrivals, data, connections
        arrivals.hosted = connections
        self._disk = HostStorage(arrivals.protocol, data, group or GroupCommit(), TeamTable(arrivals.protocol, data))
        self.recorded: set[Connection] = set()  # of leased sessions, whose logs have grown
        self._wakes = _WakeQueue(self.recorded)
        web = arrivals.protocol.web
        self._web = web
        self._settings = PageSettings(web.image_size_px, web.image_encoding)
        self._words = get_page_texts(arrivals.protocol.study.language)
        self._apart = itertools.count(1)
        self._connection_keys: dict[bytes, str] = {}  # by a digest of a hello's link
        self._turns: WeakValueDictionary[bytes, asyncio.Lock] = WeakValueDictionary()  # while one waits

    async def connect(self, hello: messages.Hello, address: str = "") -> Connection | messages.Refusal:
        """Find or make the connection for a hello from a network address."""
        if hello.version != messages.MESSAGE_VERSION:
            return messages.Refusal("old", self._words["busy"])  # it is loaded again by itself
        protocol = self._arrivals.protocol
        needed = {"needs_keyboard": needs_keyboard(protocol), "needs_gamepad": requires_gamepad(protocol)}
        if reason := check_eligibility(self._web, _browser_properties(hello.facts), **needed):
            who = identify_visitor(hello.platform, self._web.recruitment_platforms)
            return self._turned(reason, person=who.id if who is not None else "")
        came_with = hashlib.sha256(repr((hello.token, sorted(hello.platform.items()))).encode()).digest()
        turn = self._turns.setdefault(came_with, asyncio.Lock())
        network = address
        with suppress(ValueError):  # of IPv6 the /64 network, which is what a household has
            network = ip_address(address).exploded[:19]
        invited = is_token(hello.token) and not self._web.open_access  # if they invented it, they are turned away
        crowd = self._turns.setdefault(came_with if invited else network.encode(), asyncio.Lock())
        async with turn, crowd if crowd is not turn else contextlib.nullcontext():
            there = self._connections.get(self._connection_keys.get(came_with, ""))
            if there is not None:
                return there
            if len(self._connections) >= self._web.max_concurrent_sessions:
                return self._turned("busy")
            crowded = [one for one in self._connections.values() if one.network == network and not one.agreed]
            if not invited and sum(not one.host.over for one in crowded) >= self._web.max_unconsented_per_address:
                return self._turned("busy")
            connection = await self._admit_page(hello)
            if isinstance(connection, Connection):
                connection.network = network
                self._connection_keys[came_with] = connection.key
            return connection

    def isolate(self, connection: Connection) -> None:
        """Keep a connection for its own page alone: the participant's code is free for the next one."""
        if connection.key != connection.admission.key:  # it was, and its end is tried again
            return
        del self._connections[connection.key]
        own = f"{connection.key} left {next(self._apart)}"
        self._connection_keys = {
            came: own if key == connection.key else key for came, key in self._connection_keys.items()
        }
        connection.key = own
        self._connections[own] = connection

    async def _admit_page(self, hello: messages.Hello) -> Connection | messages.Refusal:
        try:
            arrival = Arrival(hello.token, hello.platform, find_utc_offset_min(hello.facts))
            admission = await asyncio.to_thread(self._arrivals.arrive, arrival)
        except OSError as error:  # the database is away, or the disk: the page tries again
            LOG.warning("a participant has to wait: %s", error)
            return messages.Refusal("wait", "")
        if isinstance(admission, Rejection):
            return self._refused(admission)
        if admission.lease is None and admission.key in self._connections:
            return self._connections[admission.key]
        facts = {**self.facts, **collect_browser_facts(hello.facts)}
        facts["picture_px"] = "{} x {}".format(*self._settings.picture_px)
        facts["picture_encoding"] = self._settings.encoding
        if hello.kernels == kernels_digest():
            facts["page_kernels"] = hello.kernels  # what the plan lets the page compute, it does
        opened: list[Connection] = []  # none before its recorder is open

        def wake() -> None:
            for connection in opened:
                self._wakes.wake(connection)

        def ask_team() -> None:
            for connection in opened:
                connection.loop.call_soon_threadsafe(connection.poll)

        try:
            hosted = await asyncio.to_thread(self._hosted, admission, facts, wake, ask_team)
        except (MinihumanError, OSError) as error:
            await asyncio.to_thread(self._arrivals.settle, admission)
            LOG.warning("a session was not started: %s", error)
            # no database, or a log that another server left was complete: the page comes again, and is told
            return (
                messages.Refusal("wait", "") if isinstance(error, OSError | AllocationError) else self._turned("broken")
            )
        connection = Connection(admission, hosted, self._inbox(admission), self._arrivals.leases)
        self._connections[admission.key] = connection
        opened.append(connection)
        wake()
        return connection

    def _hosted(
        self, admission: Admission, facts: dict[str, str], wake: Callable[[], None], ask_team: Callable[[], None]
    ) -> HostedSession:
        """Start or resume a host; blocks for the disk."""
        hosted = self._start_or_resume(admission, facts, wake, ask_team)
        if admission.lease is not None:
            hosted.segment = _name(Path(admission.lease.grant.name), hosted.host.session.plan)
            files = hosted.files
            admission.lease.follow(
                lambda: files[0].where.part if files else None, lambda: hosted.recorder.durable_writes
            )
        return hosted

    def _start_or_resume(
        self, admission: Admission, facts: dict[str, str], wake: Callable[[], None], ask_team: Callable[[], None]
    ) -> HostedSession:
        if admission.part is not None:
            if is_being_recorded(admission.part):
                raise LogError(f"{admission.part} is being written by another server; reload the page in a moment")
            with contextlib.suppress(LogError, FileNotFoundError):
                left_ns = current_system().clock.wall_ns() - admission.part.stat().st_mtime_ns
                if left_ns <= self._web.reconnect_timeout_s * 1e9:
                    return resume_host(
                        admission.part, self._disk, facts, self._settings, at_sync=wake, at_team_change=ask_team
                    )
        plan = admission.plan or self._arrivals.plan(admission)
        lease, leases = admission.lease, self._arrivals.leases
        if lease is not None and leases is not None and plan.segment > 1:
            leases.publish(lease, SegmentPath.of_plan(self._data, plan).log)  # else the next one has only the rest
        return start_host(plan, self._disk, facts, self._settings, at_sync=wake, at_team_change=ask_team)

    def _inbox(self, admission: Admission) -> CommandInbox:
        """Where the experimenter asks for something."""
        folder = session_folder(
            self._data, self._arrivals.protocol.study.name, admission.participant, admission.session
        )
        return CommandInbox(inbox_path(folder / f"{admission.participant}_ses-{admission.session:02d}{LOG_SUFFIX}"))

    def _refused(self, refused: Rejection) -> messages.Refusal:
        """Whoever has taken part and comes again gets the code again."""
        if refused.reason == "wait":
            return messages.Refusal("wait", "")
        if not refused.ended:
            return self._turned(refused.reason)
        end = classify_ending("complete" if refused.ended not in FINAL_END_REASONS else refused.ended, agreed=True)  # type: ignore[arg-type]
        code = get_session_code(self._arrivals.protocol, refused.session)
        done = build_completion(self._web, end, session_code=code, person=refused.person)
        is_over = refused.reason == "finished"
        return self._with_code(end if is_over else refused.reason, self._words[end if is_over else "not_today"], done)

    def _with_code(self, reason: str, words: str, done: Completion) -> messages.Refusal:
        words = f"{words} {self._words['code']}: {done.code}" if done.code else words
        return messages.Refusal(reason, words, self._words["leave"], done.url)

    def _turned(self, reason: str, *, person: str = "") -> messages.Refusal:
        width, height = self._web.min_window_size_px
        fields = {"browsers": ", ".join(self._web.allowed_browsers), "width": width, "height": height}
        words = self._words[reason].format(**fields)
        if reason not in _FOR_GOOD:
            return messages.Refusal(reason, words)
        return self._with_code(reason, words, build_completion(self._web, "screened_out", person=person))


class _WakeQueue:
    """Wakes connections whose data became durable; one call of the loop wakes all that wait."""

    def __init__(self, recorded: set[Connection]) -> None:
        self._recorded = recorded
        self._woken: deque[Connection] = deque()
        self._called = False

    def wake(self, connection: Connection) -> None:
        """Something became durable; called by the log's thread."""
        self._woken.append(connection)
        if not self._called:
            self._called = True
            with contextlib.suppress(RuntimeError):  # the loop is closed
                connection.loop.call_soon_threadsafe(self._set_changed)

    def _set_changed(self) -> None:
        self._called = False
        while self._woken:
            connection = self._woken.popleft()
            connection.changed.set()
            if connection.lease is not None:
                self._recorded.add(connection)


def _browser_properties(facts: Mapping[str, bool | float | str]) -> BrowserProperties:
    """Convert a page's facts to what eligibility depends on."""
    family = str(facts.get("browser", "other")).lower()
    size = _SIZE.fullmatch(str(facts.get("window_px", "")))
    known = next((name for name in ("chrome", "edge", "firefox", "safari") if name in family), "other")
    if "chromium" in family:
        known = "chrome"
    rtt = facts.get("rtt_ms")
    return BrowserProperties(
        browser=known,
        window_px=(int(size[1]), int(size[2])) if size else (0, 0),
        rtt_ms=float(rtt) if isinstance(rtt, int | float) else None,
        keyboard=facts.get("mouse") is not False or facts.get("touch") is not True,
        gamepad=facts.get("gamepad") is True,
    )
