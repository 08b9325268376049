"""Creates connections: a page that says hello is identified, then admitted or refused. It uses asyncio and disk.

The link in a hello is looked up, then its session is planned, started or resumed in a thread. Two tabs with one link
are handled one after the other, and so are visitors from one network who have none of the study's links.
"""

import asyncio
import contextlib
import hashlib
import itertools
import logging
import shutil
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from weakref import WeakValueDictionary

from minihuman.errors import AllocationError, LogError, MinihumanError
from minihuman.log.paths import LOG_SUFFIX, SegmentPath, session_folder
from minihuman.log.record.disk import RESERVE_BYTES, GroupCommit
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.runtime.session_loop import CommandInbox, inbox_path
from minihuman.runtime.team_host import TeamTable
from minihuman.storage.system import current_system
from minihuman.web.arrivals import Admission, Arrival, Arrivals, Rejection, identify_visitor, is_token
from minihuman.web.computed import PageWorld
from minihuman.web.connection import Connection
from minihuman.web.eligibility import (
    check_eligibility,
    collect_browser_facts,
    find_utc_offset_min,
    needs_keyboard,
    read_browser_properties,
    requires_gamepad,
)
from minihuman.web.hosted_session import HostedSession, HostStorage, name_segment, resume_host, start_host
from minihuman.web.messages import MESSAGE_VERSION, Hello, Refusal, TransportName
from minihuman.web.outbox import PageSettings
from minihuman.web.refusals import WAIT, RefusalTexts
from minihuman.web.traffic_limits import find_network
from minihuman.worlds.isolation.isolated_world import IsolatedWorlds
from minihuman.worlds.source_digest import kernels_digest

LOG = logging.getLogger("minihuman")


class ConnectionFactory:
    """Makes a study's connections.

    Args:
        arrivals: the study and its visitors.
        data: the folder in which sessions are recorded.
        connections: the open connections by key; new ones are added.
        group: the writer of all their logs; None for a thread of this factory's own.
        worlds: runs foreign worlds in processes of their own; None to run all worlds in this process.
    """

    def __init__(
        self,
        arrivals: Arrivals,
        data: Path,
        connections: dict[str, Connection],
        *,
        group: GroupCommit | None = None,
        worlds: IsolatedWorlds | None = None,
    ) -> None:
        self.facts: Mapping[str, str] = {}  # of this machine
        self.recorded: set[Connection] = set()  # of leased sessions, whose logs have grown
        self._arrivals = arrivals
        self._data = data
        self._connections = connections
        arrivals.hosted = connections
        self._disk = HostStorage(
            arrivals.protocol, data, group or GroupCommit(), TeamTable(arrivals.protocol, data), worlds or PageWorld
        )
        self._threads = self._make_threads(worlds)
        self._wakes = _WakeQueue(self.recorded)
        self._web = arrivals.protocol.web
        self._settings = PageSettings(self._web.image_size_px, self._web.image_encoding)
        self._refusals = RefusalTexts(arrivals.protocol)
        self._isolation_numbers = itertools.count(1)
        self._connection_keys: dict[bytes, str] = {}  # by a digest of a hello's link
        # by a digest of a link, or by network; each is dropped once no page waits for it
        self._turns: WeakValueDictionary[bytes, asyncio.Lock] = WeakValueDictionary()

    def _make_threads(self, worlds: IsolatedWorlds | None) -> Executor | None:
        """Return threads for all sessions if isolated worlds may keep the sessions waiting; None otherwise."""
        protocol = self._arrivals.protocol
        if worlds is None or not any(worlds.isolates(block.world) for block in protocol.blocks):
            return None
        return ThreadPoolExecutor(protocol.web.max_concurrent_sessions, "minihuman-session")

    async def connect(
        self, hello: Hello, address: str = "", *, transport: TransportName = "websocket"
    ) -> Connection | Refusal:
        """Find or make the connection for a page that said hello, given its network address and transport.

        Return a refusal if the page's participant may not take part, or has to wait.
        """
        if hello.version != MESSAGE_VERSION:
            return self._refusals.ask_to_reload()
        refusal = self._refuse_browser(hello)
        if refusal is not None:
            return refusal
        link_digest = hashlib.sha256(repr((hello.token, sorted(hello.platform.items()))).encode()).digest()
        turn = self._turns.setdefault(link_digest, asyncio.Lock())
        network = find_network(address)
        # without open access an invented token is turned away, so the form suffices here
        is_invited = is_token(hello.token) and not self._web.open_access
        async with contextlib.AsyncExitStack() as turns:
            await turns.enter_async_context(turn)
            if not is_invited:
                network_turn = self._turns.setdefault(network.encode(), asyncio.Lock())
                await turns.enter_async_context(network_turn)
            existing = self._connections.get(self._connection_keys.get(link_digest, ""))
            if existing is not None:
                return existing
            if self._is_full() or self._is_disk_low():
                return self._refusals.turn_away("busy")
            if not is_invited and self._is_crowded(network) and not await self._is_issued(hello.token):
                return self._refusals.turn_away("busy")
            connection = await self._admit_page(hello, transport)
            if isinstance(connection, Connection):
                connection.network = network
                if connection.admission.is_invited:
                    connection.network = ""
                self._connection_keys[link_digest] = connection.key
            return connection

    def _refuse_browser(self, hello: Hello) -> Refusal | None:
        """Return the refusal of a browser that is not eligible; None if it is."""
        protocol = self._arrivals.protocol
        reason = check_eligibility(
            self._web,
            read_browser_properties(hello.facts),
            needs_keyboard=needs_keyboard(protocol),
            needs_gamepad=requires_gamepad(protocol),
        )
        if not reason:
            return None
        platform_visitor = identify_visitor(hello.platform, self._web.recruitment_platforms)
        if platform_visitor is None:
            return self._refusals.turn_away(reason)
        return self._refusals.turn_away(reason, person=platform_visitor.id)

    def refuse_slow_page(self) -> Refusal:
        """Return the refusal of a page whose network is too slow for a part in real time."""
        return self._refusals.turn_away("too_slow")

    def _is_full(self) -> bool:
        return len(self._connections) >= self._web.max_concurrent_sessions

    def _is_disk_low(self) -> bool:
        """Return whether the disk has only the space needed to finish running sessions' logs; log a warning if so."""
        folder = next(path for path in (self._data, *self._data.absolute().parents) if path.is_dir())
        is_low = shutil.disk_usage(folder).free < RESERVE_BYTES
        if is_low:
            LOG.warning("%s is nearly full: nobody new is admitted; free some space", folder)
        return is_low

    async def _is_issued(self, token: str) -> bool:
        """Return whether a token was issued, by the experimenter or earlier by the page of an open study.

        The answer is False if the database cannot be reached.
        """
        try:
            return await asyncio.to_thread(self._arrivals.is_invited, token)
        except OSError:  # the database is away, which admission reports
            return False

    def _is_crowded(self, network: str) -> bool:
        """Return whether a network has reached the limit of visitors who have not taken part in their session yet."""
        unproven = [
            connection
            for connection in self._connections.values()
            if connection.network == network and connection.is_unproven and not connection.host.over
        ]
        return len(unproven) >= self._web.max_unconsented_per_address

    def isolate(self, connection: Connection) -> None:
        """Rename a connection so that only its own page uses it, which frees the participant's key.

        A connection that is isolated already stays as it is.
        """
        if connection.key != connection.admission.key:
            return
        del self._connections[connection.key]
        own_key = f"{connection.key} left {next(self._isolation_numbers)}"
        for link_digest, key in self._connection_keys.items():
            if key == connection.key:
                self._connection_keys[link_digest] = own_key
        connection.key = own_key
        self._connections[own_key] = connection

    async def _admit_page(self, hello: Hello, transport: TransportName) -> Connection | Refusal:
        """Admit a page's visitor and start or resume the session; return its connection, or the refusal."""
        try:
            arrival = Arrival(hello.token, hello.platform, find_utc_offset_min(hello.facts))
            admission = await asyncio.to_thread(self._arrivals.arrive, arrival)
        except OSError as error:  # the database is away, or the disk: the page tries again
            LOG.warning("a participant has to wait: %s", error)
            return WAIT
        if isinstance(admission, Rejection):
            return self._refusals.answer_rejection(admission)
        if admission.lease is None and admission.key in self._connections:
            return self._connections[admission.key]
        opened: list[Connection] = []  # empty until the connection exists; its recorder calls back earlier

        def wake() -> None:
            for connection in opened:
                self._wakes.wake(connection)

        def ask_team() -> None:
            for connection in opened:
                connection.loop.call_soon_threadsafe(connection.poll_soon)

        try:
            facts = self._collect_facts(hello) | {"transport": transport}
            hosted = await asyncio.to_thread(self._host_session, admission, facts, wake, ask_team)
        except (MinihumanError, OSError) as error:
            await asyncio.to_thread(self._arrivals.settle, admission)
            LOG.warning("a session was not started: %s", error)
            # the database is away, or another server completed the session: the page's next try gets the reason
            if isinstance(error, OSError | AllocationError):
                return WAIT
            return self._refusals.turn_away("broken")
        connection = self._make_connection(admission, hosted)
        connection.transport = transport
        opened.append(connection)
        wake()
        return connection

    def _make_connection(self, admission: Admission, hosted: HostedSession) -> Connection:
        """Make the connection of an admitted participant to a hosted session, and register it under its key."""
        connection = Connection(
            admission,
            hosted,
            self._open_inbox(admission),
            self._arrivals.leases,
            max_outage_s=self._web.reconnect_timeout_s,
            threads=self._threads,
        )
        self._connections[admission.key] = connection
        return connection

    def _collect_facts(self, hello: Hello) -> dict[str, str]:
        """Collect the log's facts about this machine, the browser, and the pictures that are sent to the page."""
        facts = {**self.facts, **collect_browser_facts(hello.facts)}
        facts["picture_px"] = "{} x {}".format(*self._settings.picture_px)
        facts["picture_encoding"] = self._settings.encoding
        if hello.kernels == kernels_digest():
            facts["page_kernels"] = hello.kernels  # the page computes the episodes that the plan lets it compute
        return facts

    def _host_session(
        self, admission: Admission, facts: dict[str, str], wake: Callable[[], None], ask_team: Callable[[], None]
    ) -> HostedSession:
        """Start or resume the host of an admitted participant's session, and let its lease follow its log.

        This waits for the disk.

        Args:
            admission: the participant's admission.
            facts: the facts for the log.
            wake: called by the log's thread when data became durable.
            ask_team: called when the participant's team has changed.
        """
        hosted = self._start_or_resume(admission, facts, wake, ask_team)
        if admission.lease is not None:
            hosted.segment = name_segment(Path(admission.lease.grant.name), hosted.host.session.plan)
            admission.lease.follow(hosted.find_live_log, lambda: hosted.recorder.durable_writes)
        return hosted

    def _start_or_resume(
        self, admission: Admission, facts: dict[str, str], wake: Callable[[], None], ask_team: Callable[[], None]
    ) -> HostedSession:
        """Resume the session of a live log, or start a host for a new segment.

        A new segment is started if there is no live log, it was left too long ago, or it cannot be resumed here. The
        arguments are those of ``_host_session``.

        Raises:
            AllocationError: if there is nothing left to play.
            LogError: if another server is writing the log, or the new segment cannot be started.
            OSError: if the earlier log cannot be stored where other servers can read it.
        """
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
        lease = admission.lease
        leases = self._arrivals.leases
        if lease is not None and leases is not None and plan.segment > 1:
            # the next server would otherwise have only the new segment
            leases.publish(lease, SegmentPath.of_plan(self._data, plan).log)
        return start_host(plan, self._disk, facts, self._settings, at_sync=wake, at_team_change=ask_team)

    def _open_inbox(self, admission: Admission) -> CommandInbox:
        """Open the inbox through which the experimenter sends commands to a session."""
        folder = session_folder(
            self._data, self._arrivals.protocol.study.name, admission.participant, admission.session
        )
        return CommandInbox(inbox_path(folder / f"{admission.participant}_ses-{admission.session:02d}{LOG_SUFFIX}"))


class _WakeQueue:
    """Wakes connections whose data became durable; one call on the event loop wakes all that are waiting.

    Args:
        recorded: the set to which woken connections of leased sessions are added, because their logs have grown.
    """

    def __init__(self, recorded: set[Connection]) -> None:
        self._recorded = recorded
        self._woken: deque[Connection] = deque()
        self._is_scheduled = False

    def wake(self, connection: Connection) -> None:
        """Schedule a connection to be woken because its data became durable; called by the log's thread."""
        self._woken.append(connection)
        if not self._is_scheduled:
            self._is_scheduled = True
            with contextlib.suppress(RuntimeError):  # the loop is closed
                connection.loop.call_soon_threadsafe(self._wake_all)

    def _wake_all(self) -> None:
        """Wake all connections that are waiting; called on the event loop."""
        self._is_scheduled = False
        while self._woken:
            connection = self._woken.popleft()
            connection.hear_from_disk()
            if connection.lease is not None:
                self._recorded.add(connection)
