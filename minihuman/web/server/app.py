"""The web application: one page, and one transport and one task per browser. The session hosts run the sessions.

Work that waits for the disk (connecting, finishing a log) runs in threads. Look-ahead runs between messages, for one
host at a time, so that a key never waits longer than two milliseconds or one scene.
"""

import asyncio
import contextlib
import json
import logging
from collections import deque
from collections.abc import AsyncIterator, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from minihuman.errors import MinihumanError
from minihuman.experiment.machine.screen_texts import find_stop_code
from minihuman.runtime.machine import collect_machine_facts, collect_world_facts
from minihuman.storage.lease import RENEWAL_INTERVAL_S, TTL_S, LeaseLostError
from minihuman.storage.system import monotonic_s
from minihuman.web import messages
from minihuman.web.arrivals import Arrivals
from minihuman.web.connection import Connection
from minihuman.web.connection_factory import ConnectionFactory
from minihuman.web.eligibility import (
    Completion,
    WebEnding,
    build_completion,
    classify_ending,
    get_page_texts,
    get_session_code,
)
from minihuman.web.http_security import build_headers, is_same_origin
from minihuman.web.message_codec import decode_page_message, encode_unnumbered
from minihuman.web.page_protocol import PageProtocol
from minihuman.web.server.metrics import PageCounts, answer_metrics
from minihuman.web.server.page_routes import PAGE_FOLDER, HeaderMiddleware, build_page_routes
from minihuman.web.server.page_socket import PageSocket
from minihuman.web.server.page_transport import PageTransport, SocketClosedError
from minihuman.web.server.polling import PollingEntrance
from minihuman.web.server.sound_route import build_sound_route
from minihuman.web.traffic_limits import HELLO_TIMEOUT_S, MAX_WAITING
from minihuman.worlds.isolation.isolated_world import IsolatedWorlds
from minihuman.worlds.source_digest import kernels_digest

LOG = logging.getLogger("minihuman")
KEEP_FINISHED_S = 600.0  # for which a session that is over is kept, for pages that reconnect
CHECK_INTERVAL_S = 1.0
LEARNER_POLL_INTERVAL_S = 0.1
COPY_INTERVAL_S = 0.05  # between copies of leased sessions' logs to the database
LOOK_AHEAD_SLICE_S = 0.01  # for one connection; its page then gets the scenes found, and others have a turn
MAX_LOOP_BLOCK_S = 0.002  # of looking ahead before messages are handled
# closing codes of sockets, after which a page does not reconnect by itself
ANOTHER = 4001  # another page or another server has the session
REFUSED = 4003
FOREIGN = 4004  # the page is of another site
_VANISHED = ("connection_lost", "timed_out")  # reasons for the end of a session whose participant went away
CLOSE_BUSY = 4100  # the closing code after which a page tries again in a while
CLOSE_OLD = 4002  # the closing code after which a page of another release than the server reloads itself


def classify_connection_ending(connection: Connection) -> WebEnding:
    """Return the ending to show to the participant; "broken" if the log is incomplete or the page sent too much."""
    if connection.recording.is_broken or connection.is_over_budget:
        return "broken"
    session = connection.host.session
    return classify_ending(session.end_reason, agreed=connection.agreed, part_kind=session.part.part.kind)


def build_session_over(connection: Connection, completion: Completion) -> messages.SessionOver:
    """Build the last message to a page, with the ending, whether the data are saved, and the completion code.

    If the log is incomplete, the message states how many inputs it may lack.
    """
    session = connection.host.session
    words = get_page_texts(session.plan.language)
    text = words[completion.end]
    code = completion.code
    if completion.end == "broken":
        if n_unsaved := connection.count_unsaved():
            text = words["broken_in_part"].replace("{unsaved}", str(n_unsaved))
        stop_code = find_stop_code(session.end_reason, session.end_detail)
        LOG.warning("a session stopped, code %s on its page: %s", stop_code, session.end_detail)
        code = code or stop_code
    return messages.SessionOver(completion.end, text, words["code"], code, words["leave"], completion.url)


class WebServer:
    """Serves a study to its participants' pages.

    Args:
        arrivals: the study and its visitors.
        data: the folder in which sessions are recorded.
        routes: the routes of other pages that this server serves.
        worlds: runs foreign worlds in processes of their own; None to run all worlds in this process.
    """

    def __init__(
        self, arrivals: Arrivals, data: Path, *, routes: Sequence[BaseRoute] = (), worlds: IsolatedWorlds | None = None
    ) -> None:
        self.connections: dict[str, Connection] = {}
        self._arrivals = arrivals
        self._web = arrivals.protocol.web
        self._factory = ConnectionFactory(arrivals, data, self.connections, worlds=worlds)
        self._tasks: set[asyncio.Task[None]] = set()  # for sessions that run in threads
        self._routes = routes
        self._silent: dict[PageTransport, None] = {}  # pages that have sent no hello yet, the oldest first
        self._connecting = 0  # pages whose hello is not answered yet
        self._counts = PageCounts()
        self._polling = PollingEntrance(self._converse, self._is_busy, max_lines=self._web.max_concurrent_sessions)
        self._to_look_ahead: deque[Connection] = deque()  # connections for which to look ahead, each once
        self._has_to_look_ahead = asyncio.Event()
        self._has_agents = asyncio.Event()  # whether a session has an agent

    def app(self) -> ASGIApp:
        """Build the ASGI application; its lifespan runs the server's tasks."""
        routes = [
            *build_page_routes(),
            Route("/healthz", self._answer_health_check),
            Route("/metrics", self._answer_metrics),
            Route("/unwelcomed", self._counts.answer_unwelcomed),
            build_sound_route(self._arrivals.protocol),
            WebSocketRoute("/socket", self._serve_socket),
            Route("/socket", self._polling.answer, methods=["POST"]),  # a proxy sends both to the same worker
            *self._routes,
        ]
        return HeaderMiddleware(Starlette(routes=routes, lifespan=self._lifespan), build_headers(self._web.embed_in))

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        worlds = collect_world_facts(block.world for block in self._arrivals.protocol.blocks)
        manifest = json.loads((PAGE_FOLDER / "worlds/manifest.json").read_text(encoding="utf-8"))
        if manifest["sources"] != kernels_digest():
            LOG.warning("the page's modules are of other rules, so none computes: run `python -m kernel_build`")
        self._factory.facts = {"player": "human", **await asyncio.to_thread(collect_machine_facts), **worlds}
        jobs = (self._look_ahead, self._supervise, self._poll, self._keep_leases, self._finish_ended_sessions)
        tasks = [asyncio.create_task(job()) for job in jobs]
        try:
            yield
        finally:
            for task in (*tasks, *self._tasks):
                task.cancel()
            await asyncio.gather(*tasks, *self._tasks, self._polling.close(), return_exceptions=True)
            await asyncio.gather(*(asyncio.to_thread(connection.leave) for connection in self.connections.values()))

    async def _answer_health_check(self, _: Request) -> Response:
        """Answer a health check; a server whose event loop is blocked does not answer."""
        return Response("ok\n", media_type="text/plain")

    async def _answer_metrics(self, request: Request) -> Response:
        return answer_metrics(request, self.connections.values(), self._counts, n_silent=len(self._silent))

    # A socket

    async def _serve_socket(self, socket: WebSocket) -> None:
        """Serve a page over a web socket, unless the page is foreign or the server is full."""
        page = PageSocket(socket)
        if not is_same_origin(socket.headers.get("origin"), socket.headers.get("host")):
            await page.close(FOREIGN)
            return
        if self._is_busy():
            await page.close(CLOSE_BUSY)
            return
        address = ""
        if socket.client is not None:
            address = socket.client.host
        with contextlib.suppress(SocketClosedError):
            await page.accept()
            await self._converse(page, address)

    def _is_busy(self) -> bool:
        return self._connecting >= MAX_WAITING

    async def _converse(self, page: PageTransport, address: str) -> None:
        """Serve a page over any transport, from its hello until the transport or the session ends."""
        try:
            if len(self._silent) >= MAX_WAITING:  # the oldest is most likely no page, as a page says hello at once
                oldest = next(iter(self._silent))
                del self._silent[oldest]
                await oldest.close(CLOSE_BUSY)
            hello, connection = await self._receive_hello(page, address)
            if isinstance(connection, messages.Refusal):
                await _refuse(page, connection)
                return
            await self._serve_page(page, connection, hello)
        except SocketClosedError:
            return
        except TimeoutError:
            await page.close(CLOSE_BUSY)  # a page that was slow to say hello tries again
        except messages.MessageError as error:
            await page.close(REFUSED, str(error))

    async def _receive_hello(
        self, page: PageTransport, address: str
    ) -> tuple[messages.Hello, Connection | messages.Refusal]:
        """Return a page's hello, with its connection or refusal; raise MessageError if the message is no hello."""
        self._silent[page] = None
        try:
            hello = decode_page_message(await asyncio.wait_for(page.receive(), HELLO_TIMEOUT_S))
        finally:
            self._silent.pop(page, None)
        if not isinstance(hello, messages.Hello):
            raise messages.MessageError("the page's first message must be a hello; reload the page")
        self._connecting += 1
        try:
            return hello, await self._factory.connect(hello, address, transport=page.name)
        finally:
            self._connecting -= 1

    async def _serve_page(self, page: PageTransport, connection: Connection, hello: messages.Hello) -> None:
        """Welcome a page, and exchange messages with it while its socket is the connection's newest one."""
        welcome, number, after = await connection.run(connection.greet, hello, page.name)
        if page.name == "http":
            self._counts.http_pages += 1
        protocol = PageProtocol(connection, welcome, after, monotonic_s())
        connection.changed.set()
        if connection.host.has_agent:
            self._has_agents.set()
        self._schedule_look_ahead(connection)
        sending = asyncio.create_task(self._send_messages(page, connection, number, protocol))
        code = 0
        try:
            while connection.presence.is_newest(number):
                await self._take_text(page, connection, protocol, await page.receive())
        except SocketClosedError as error:
            code = error.code
            raise
        finally:
            sending.cancel()
            connection.presence.close_socket(number, monotonic_s(), code)
            await asyncio.gather(sending, return_exceptions=True)

    async def _take_text(self, page: PageTransport, connection: Connection, protocol: PageProtocol, text: str) -> None:
        """Handle the messages in a text; then finish the session, wake the sender or look ahead if necessary."""
        lines = text.split("\n")
        now_s = monotonic_s()
        protocol.begin_text(now_s)
        while lines:
            admitted = lines[: protocol.admit(len(lines), now_s)]
            lines = lines[len(admitted) :]
            for answer in await connection.run(partial(protocol.receive_all, admitted, more=bool(lines))):
                await page.send(answer)
            if lines:
                await asyncio.sleep(0.1)  # backpressure; a page that reconnects sends a lot at once
                now_s = monotonic_s()
        await self._finish_if_over(connection)
        effect = await connection.run(protocol.end_text)
        if effect.has_answer:
            connection.changed.set()
            await asyncio.sleep(0)  # so that the answer is sent before the next message is handled
        if effect.wants_more:
            self._schedule_look_ahead(connection)
        if page.name == "http" and await connection.run(connection.is_too_slow):
            self._counts.too_slow_pages += 1
            await page.send(encode_unnumbered(self._factory.refuse_slow_page()))
            await page.close(REFUSED)
            raise SocketClosedError

    async def _send_messages(
        self, page: PageTransport, connection: Connection, number: int, protocol: PageProtocol
    ) -> None:
        """Send the connection's messages while the socket with a number is the newest one of the connection."""
        await page.send(protocol.encode_welcome())
        while True:
            await connection.changed.wait()
            connection.changed.clear()
            if protocol.is_superseded or not connection.presence.is_newest(number):
                connection.changed.set()  # for the task of the newest socket
                await page.close(connection.presence.dismissal_code or ANOTHER)
                return
            if connection in self._to_look_ahead and not connection.is_busy and protocol.can_wait:
                continue  # ``_look_ahead_for`` soon wakes this task, to send the messages with the scenes found ahead
            for batch in await connection.take_batches(protocol):
                await page.send(batch)

    # Ends

    async def _finish_if_over(self, connection: Connection) -> None:
        """Finish the log of a session that is over and inform the page; ``_supervise`` retries after an OSError."""
        recording = connection.recording
        if not connection.host.over or recording.is_finishing:
            return
        recording.is_finishing = True
        try:
            await self._finish_session(connection)
        except LeaseLostError:
            await self._hand_over(connection, CLOSE_BUSY)
        except OSError as error:
            if not recording.is_delayed:
                LOG.warning("a session is over, but its page is not told yet: %s", error)
            recording.is_delayed = True
            recording.is_finishing = False

    async def _finish_session(self, connection: Connection) -> None:
        """Finish a session's log, free the slot of a participant who left no data, and send the last message."""
        session = connection.host.session
        admission = connection.admission
        await asyncio.to_thread(connection.finish)
        end = classify_connection_ending(connection)
        if not connection.agreed:
            why: str = session.end_reason
            if end == "declined":
                why = end
            self._factory.isolate(connection)
            await asyncio.to_thread(self._arrivals.decline, admission, why)
        elif session.end_reason in _VANISHED and connection.is_unproven:
            await asyncio.to_thread(self._arrivals.release, admission, session.end_reason)
        person = await asyncio.to_thread(self._arrivals.find_platform_id, admission.participant)
        session_code = get_session_code(self._arrivals.protocol, admission.session)
        completion = build_completion(self._web, end, session_code=session_code, person=person)
        connection.over = build_session_over(connection, completion)
        await connection.run(connection.host.outgoing.add, connection.over)
        connection.changed.set()

    async def _supervise(self) -> None:
        """End the sessions whose pages do not come back, and drop sessions that have been over for some time."""
        while True:
            await asyncio.sleep(CHECK_INTERVAL_S)
            for connection in tuple(self.connections.values()):
                await self._run_for(connection, self._supervise_safely(connection))

    async def _run_for(self, connection: Connection, work: Coroutine[Any, Any, None]) -> None:
        """Await a connection's work or, if its worlds may be slow, start it as a task; drop it if a thread is busy."""
        if not connection.has_threads:
            await work
        elif connection.is_busy:
            work.close()  # the caller tries again later
            connection.changed.set()  # the sender no longer waits for messages that the work would have added
        else:
            task = asyncio.create_task(work)
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _supervise_safely(self, connection: Connection) -> None:
        try:
            await self._supervise_one(connection)
        except Exception:  # a bug of ours: the other connections go on
            LOG.exception("a connection could not be looked after")

    async def _supervise_one(self, connection: Connection) -> None:
        """Obey the experimenter's commands for a session, apply its time limits, and finish or drop it once over."""
        now_s = monotonic_s()
        absence_s = connection.presence.compute_absence_s(now_s)
        if connection.ping is not None:  # there was nothing to acknowledge
            connection.changed.set()
        if not connection.host.over:
            await connection.run(connection.read_inbox)
        if not connection.host.over and absence_s > self._web.reconnect_timeout_s:
            await connection.run(connection.stop, "connection_lost", "the page did not come back")
        if not connection.host.over and 0 < self._web.idle_timeout_s < connection.presence.compute_inactivity_s(now_s):
            detail = f"nothing was pressed for {self._web.idle_timeout_s:g} s"
            await connection.run(connection.stop, "timed_out", detail)
        await self._finish_if_over(connection)
        if connection.over is not None and absence_s > KEEP_FINISHED_S:
            self.connections.pop(connection.key, None)
            await connection.run(connection.host.close)

    async def _poll(self) -> None:
        """Poll the sessions that may wait for an answer from outside, such as a learner's policy."""
        while True:
            if not any(connection.host.has_agent for connection in self.connections.values()):
                self._has_agents.clear()
                await self._has_agents.wait()
            await asyncio.sleep(LEARNER_POLL_INTERVAL_S)
            for connection in [connection for connection in self.connections.values() if connection.host.is_polled]:
                await self._run_for(connection, self._poll_one(connection))

    async def _poll_one(self, connection: Connection) -> None:
        if await connection.run(connection.poll):
            self._schedule_look_ahead(connection)

    # Leases

    async def _finish_ended_sessions(self) -> None:
        """Finish the logs of sessions that had ended when this server was killed, once the database is available."""
        while True:
            try:
                await asyncio.to_thread(self._arrivals.finish_ended)
                return
            except OSError:
                await asyncio.sleep(TTL_S)
            except MinihumanError as error:
                LOG.warning("what a killed server left was not finished: %s", error)
                return

    async def _keep_leases(self) -> None:
        """Renew this server's leases, copy what its sessions record, and hand over sessions to other servers."""
        leases = self._arrivals.leases
        if leases is None:
            return
        renewed_s = -RENEWAL_INTERVAL_S
        is_database_away = False
        thread = ThreadPoolExecutor(1, "minihuman-leases")  # separate, as threads of arrivals may wait for the database
        while True:
            await asyncio.sleep(COPY_INTERVAL_S)
            now_s = monotonic_s()
            is_due = now_s >= renewed_s + RENEWAL_INTERVAL_S
            leased = self._take_leased(is_due=is_due)
            if not leased:
                continue
            try:
                await asyncio.get_running_loop().run_in_executor(
                    thread, leases.renew, [connection.lease for connection in leased if connection.lease is not None]
                )
            except OSError as error:
                if not is_database_away:
                    LOG.warning("leases are not renewed, and nothing is acknowledged: %s", error)
                is_database_away = True
                self._factory.recorded.update(leased)
                await asyncio.sleep(CHECK_INTERVAL_S)
                continue
            is_database_away = False
            if is_due:
                renewed_s = now_s
            for connection in leased:
                connection.changed.set()  # there is something to acknowledge
                try:
                    await self._hand_over_if_requested(connection)
                except Exception:  # a bug of ours: the other connections go on
                    LOG.exception("a session could not be left to another server")

    def _take_leased(self, *, is_due: bool) -> list[Connection]:
        """Return, and no longer list as recorded, the connections to renew: all if due, else those with new records."""
        connections = set(self.connections.values())
        if not is_due:
            connections &= self._factory.recorded
        self._factory.recorded.clear()
        return [connection for connection in connections if connection.has_lease]

    async def _hand_over_if_requested(self, connection: Connection) -> None:
        """Hand a session over if another server has its lease or requests it."""
        lease = connection.lease
        if lease is None or connection.recording.is_finishing:
            return
        if lease.lost:
            await self._hand_over(connection, CLOSE_BUSY)
        elif lease.is_requested:
            await self._hand_over(connection, ANOTHER)

    async def _hand_over(self, connection: Connection, code: int) -> None:
        """Stop hosting a session, which another server resumes, and close its page's socket with a code."""
        if self.connections.get(connection.key) is connection:
            del self.connections[connection.key]
        connection.dismiss(code)
        await asyncio.to_thread(connection.leave)
        await connection.run(connection.host.close)

    # Looking ahead

    def _schedule_look_ahead(self, connection: Connection) -> None:
        if connection not in self._to_look_ahead:
            self._to_look_ahead.append(connection)
        self._has_to_look_ahead.set()

    async def _look_ahead(self) -> None:
        while True:
            if not self._to_look_ahead:
                self._has_to_look_ahead.clear()
                await self._has_to_look_ahead.wait()
            connection = self._to_look_ahead.popleft()
            await self._run_for(connection, self._look_ahead_for(connection))

    async def _look_ahead_for(self, connection: Connection) -> None:
        """Look ahead for one connection for a slice of time, and send the scenes that were found."""
        began_s = monotonic_s()
        turn_s = began_s  # since when no messages could be handled
        while connection.presence.is_here and await connection.run(connection.grow):
            now_s = monotonic_s()
            if now_s > began_s + LOOK_AHEAD_SLICE_S:
                self._schedule_look_ahead(connection)
                break
            if now_s > turn_s + MAX_LOOP_BLOCK_S:
                await asyncio.sleep(0)  # so that messages are handled
                turn_s = monotonic_s()
        await connection.run(connection.send_prefetched)
        await asyncio.sleep(0)  # so that they are sent before other connections have their turn


async def _refuse(page: PageTransport, refusal: messages.Refusal) -> None:
    """Send a page its refusal and close the transport; a page that has to wait gets only a closing code."""
    if refusal.reason == "wait":
        await page.close(CLOSE_BUSY)
        return
    await page.send(encode_unnumbered(refusal))
    if refusal.reason == "old":
        await page.close(CLOSE_OLD)
    else:
        await page.close(REFUSED)
