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
LOOK_AHEAD_SLICE_S = 0.01  # of one connection; its page then gets what was found, and others have a turn
MAX_LOOP_BLOCK_S = 0.002  # of looking ahead before messages are handled
# Codes of a closed socket after which the page does not come again by itself.
ANOTHER = 4001
REFUSED = 4003
FOREIGN = 4004
_VANISHED = ("connection_lost", "timed_out")
CLOSE_BUSY = 4100  # the page tries again in a while
CLOSE_OLD = 4002  # and after this it is loaded anew: it is of another release than the server


def classify_connection_ending(connection: Connection) -> WebEnding:
    """Return the ending to tell the participant; "broken" if the log is incomplete or the page sent too much."""
    if connection.recording.is_broken or connection.is_over_budget:
        return "broken"
    session = connection.host.session
    return classify_ending(session.end_reason, agreed=connection.agreed, part_kind=session.part.part.kind)


def build_session_over(connection: Connection, completion: Completion) -> messages.SessionOver:
    """Build the last message to a page: what happened, what is saved, and the completion code.

    Only a log that was closed whole is reported as saved; otherwise the message states how many inputs it may lack.
    """
    session = connection.host.session
    words = get_page_texts(session.plan.language)
    text = words[completion.end]
    code = completion.code
    if completion.end == "broken":
        unsaved = connection.count_unsaved()
        if unsaved:
            text = words["broken_in_part"].replace("{unsaved}", str(unsaved))
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
        self,
        arrivals: Arrivals,
        data: Path,
        *,
        routes: Sequence[BaseRoute] = (),
        worlds: IsolatedWorlds | None = None,
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
        self._growing: deque[Connection] = deque()
        self._to_grow = asyncio.Event()

    def app(self) -> ASGIApp:
        """Build the application."""
        routes = [
            *build_page_routes(),
            Route("/favicon.ico", _no_icon),
            Route("/healthz", self._health),
            Route("/metrics", self._metrics),
            Route("/unwelcomed", self._counts.answer_unwelcomed),
            build_sound_route(self._arrivals.protocol),
            WebSocketRoute("/socket", self._socket),
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
        works = (self._grow, self._look_after, self._poll, self._keep_leases, self._finish_ended)
        tasks = [asyncio.create_task(work()) for work in works]
        try:
            yield
        finally:
            for task in (*tasks, *self._tasks):
                task.cancel()
            await asyncio.gather(*tasks, *self._tasks, self._polling.close(), return_exceptions=True)
            await asyncio.gather(*(asyncio.to_thread(connection.leave) for connection in self.connections.values()))

    async def _health(self, _: Request) -> Response:
        """Answer a health check, which a server whose event loop is stuck cannot do."""
        return Response("ok\n", media_type="text/plain")

    async def _metrics(self, request: Request) -> Response:
        return answer_metrics(request, self.connections.values(), self._counts, n_silent=len(self._silent))

    # A socket

    async def _socket(self, socket: WebSocket) -> None:
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
        """Converse with a page from its hello to its end, over any transport."""
        try:
            if len(self._silent) >= MAX_WAITING:  # a page says hello at once: the oldest is the least likely to be one
                oldest = next(iter(self._silent))
                del self._silent[oldest]
                await oldest.close(CLOSE_BUSY)
            hello, connection = await self._receive_hello(page, address)
            if isinstance(connection, messages.Refusal):
                await _refuse(page, connection)
                return
            await self._serve(page, connection, hello)
        except SocketClosedError:
            return
        except TimeoutError:
            await page.close(CLOSE_BUSY)  # a page that was slow to say hello tries again
        except messages.MessageError as error:
            await page.close(REFUSED, str(error))

    async def _receive_hello(
        self, page: PageTransport, address: str
    ) -> tuple[messages.Hello, Connection | messages.Refusal]:
        """Return a page's hello, with its connection or refusal; raise MessageError for another message or none."""
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

    async def _serve(self, page: PageTransport, connection: Connection, hello: messages.Hello) -> None:
        welcome, number, after = await connection.run(connection.greet, hello, page.name)
        if page.name == "http":
            self._counts.http_pages += 1
        protocol = PageProtocol(connection, welcome, after, monotonic_s())
        connection.changed.set()
        self._want_more(connection)
        writing = asyncio.create_task(self._write(page, connection, number, protocol))
        code = 0
        try:
            while connection.presence.is_newest(number):
                await self._receive(page, connection, protocol, await page.receive())
        except SocketClosedError as error:
            code = error.code
            raise
        finally:
            writing.cancel()
            connection.presence.close_socket(number, monotonic_s(), code)
            await asyncio.gather(writing, return_exceptions=True)

    async def _receive(self, page: PageTransport, connection: Connection, protocol: PageProtocol, text: str) -> None:
        """Handle the messages in a text; then finish the session, wake the writer or look ahead if necessary."""
        lines = text.split("\n")
        now_s = monotonic_s()
        protocol.begin_text(now_s)
        for place, line in enumerate(lines, 1):
            while not protocol.admits(now_s):
                await asyncio.sleep(0.1)  # backpressure; a page that reconnects sends a lot at once
                now_s = monotonic_s()
            answer = await connection.run(partial(protocol.receive, line, more=place < len(lines)))
            if answer is not None:
                await page.send(answer)
        if connection.host.over:
            await self._finish_if_over(connection)
        effect = await connection.run(protocol.end_text)
        if effect.has_answer:
            connection.changed.set()
            await asyncio.sleep(0)  # the page hears of this before the next message is taken
        if effect.wants_more:
            self._want_more(connection)
        if page.name == "http" and await connection.run(connection.is_too_slow):
            self._counts.too_slow_pages += 1
            await page.send(encode_unnumbered(self._factory.refuse_slow_page()))
            await page.close(REFUSED)
            raise SocketClosedError

    async def _write(self, page: PageTransport, connection: Connection, number: int, protocol: PageProtocol) -> None:
        """Send the connection's messages while this socket is the newest one of the connection."""
        await page.send(protocol.encode_welcome())
        while True:
            await connection.changed.wait()
            connection.changed.clear()
            if protocol.is_superseded or not connection.presence.is_newest(number):
                connection.changed.set()  # wakes the newest socket's task
                await page.close(connection.presence.dismissal_code or ANOTHER)
                return
            if connection in self._growing and not connection.is_busy and protocol.can_wait:
                continue  # ``_grow_one`` soon wakes this task, to send the messages with the scenes found ahead
            for batch in await connection.take_batches(protocol):
                await page.send(batch)

    # Ends

    async def _finish_if_over(self, connection: Connection) -> None:
        """Finish the log of a session that is over and inform the page; ``_look_after`` retries after OSError."""
        recording = connection.recording
        if not connection.host.over or recording.is_finishing:
            return
        recording.is_finishing = True
        try:
            await self._finish(connection)
        except LeaseLostError:
            await self._give_up(connection, CLOSE_BUSY)
        except OSError as error:
            if not recording.is_delayed:
                LOG.warning("a session is over, but its page is not told yet: %s", error)
            recording.is_delayed = True
            recording.is_finishing = False  # _look_after tries again

    async def _finish(self, connection: Connection) -> None:
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
        person = await asyncio.to_thread(self._arrivals.id_on_platform, admission.participant)
        session_code = get_session_code(self._arrivals.protocol, admission.session)
        completion = build_completion(self._web, end, session_code=session_code, person=person)
        connection.over = build_session_over(connection, completion)
        await connection.run(connection.host.outgoing.add, connection.over)
        connection.changed.set()

    async def _look_after(self) -> None:
        """End the sessions whose pages do not come back, and drop sessions that have been over for some time."""
        while True:
            await asyncio.sleep(CHECK_INTERVAL_S)
            for connection in tuple(self.connections.values()):
                await self._run_for(connection, self._look_after_safely(connection))

    async def _run_for(self, connection: Connection, work: Coroutine[Any, Any, None]) -> None:
        """Run a coroutine for a connection, in its own task if its worlds may be slow; drop it if one is running."""
        if not connection.has_threads:
            await work
        elif connection.is_busy:
            work.close()  # the caller tries again later
            connection.changed.set()  # the writer no longer waits for what the work would have added
        else:
            task = asyncio.create_task(work)
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _look_after_safely(self, connection: Connection) -> None:
        try:
            await self._look_after_one(connection)
        except Exception:  # a bug of ours: the other connections go on
            LOG.exception("a connection could not be looked after")

    async def _look_after_one(self, connection: Connection) -> None:
        now_s = monotonic_s()
        absence_s = connection.presence.absence_s(now_s)
        if connection.ping is not None:  # there was nothing to acknowledge
            connection.changed.set()
        if not connection.host.over:
            await connection.run(connection.read_inbox)
        if not connection.host.over and absence_s > self._web.reconnect_timeout_s:
            await connection.run(connection.stop, "connection_lost", "the page did not come back")
        if not connection.host.over and 0 < self._web.idle_timeout_s < connection.presence.inactivity_s(now_s):
            detail = f"nothing was pressed for {self._web.idle_timeout_s:g} s"
            await connection.run(connection.stop, "timed_out", detail)
        await self._finish_if_over(connection)
        if connection.over is not None and absence_s > KEEP_FINISHED_S:
            self.connections.pop(connection.key, None)
            await connection.run(connection.host.close)

    async def _poll(self) -> None:
        """Poll the sessions that wait for an answer from outside, such as a learner's policy."""
        while True:
            await asyncio.sleep(LEARNER_POLL_INTERVAL_S)
            for connection in [each for each in self.connections.values() if each.host.has_agent]:
                if connection.host.is_polled:
                    await self._run_for(connection, self._poll_one(connection))

    async def _poll_one(self, connection: Connection) -> None:
        if await connection.run(connection.poll):
            self._want_more(connection)

    # Leases

    async def _finish_ended(self) -> None:
        """Finish the logs that this server left when it was killed, as soon as the database is available."""
        while True:
            try:
                return await asyncio.to_thread(self._arrivals.finish_ended)
            except OSError:
                await asyncio.sleep(TTL_S)
            except MinihumanError as error:
                LOG.warning("what a killed server left was not finished: %s", error)
                return

    async def _keep_leases(self) -> None:
        """Renew this server's leases and copy what its sessions record; give up sessions that other servers have."""
        leases = self._arrivals.leases
        if leases is None:
            return
        renewed_s = -RENEWAL_INTERVAL_S
        is_away = False
        thread = ThreadPoolExecutor(1, "minihuman-leases")  # its own: those who arrive may wait for the database
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
                if not is_away:
                    LOG.warning("leases are not renewed, and nothing is acknowledged: %s", error)
                is_away = True
                self._factory.recorded.update(leased)
                await asyncio.sleep(CHECK_INTERVAL_S)
                continue
            is_away = False
            if is_due:
                renewed_s = now_s
            for connection in leased:
                connection.changed.set()  # there is something to acknowledge
                try:
                    await self._give_up_if_wanted(connection)
                except Exception:  # a bug of ours: the other connections go on
                    LOG.exception("a session could not be left to another server")

    def _take_leased(self, *, is_due: bool) -> list[Connection]:
        """Return the connections whose leases to renew now: all if renewal is due, else those with new records."""
        connections = set(self.connections.values())
        if not is_due:
            connections &= self._factory.recorded
        self._factory.recorded.clear()
        return [connection for connection in connections if _has_lease(connection)]

    async def _give_up_if_wanted(self, connection: Connection) -> None:
        """Hand a session over if another server has its lease or requests it."""
        lease = connection.lease
        if lease is None or connection.recording.is_finishing:
            return
        if lease.lost:
            await self._give_up(connection, CLOSE_BUSY)
        elif lease.is_requested:
            await self._give_up(connection, ANOTHER)

    async def _give_up(self, connection: Connection, code: int) -> None:
        """Hand a session over to another server."""
        if self.connections.get(connection.key) is connection:
            del self.connections[connection.key]
        connection.dismiss(code)
        await asyncio.to_thread(connection.leave)
        await connection.run(connection.host.close)

    # Looking ahead

    def _want_more(self, connection: Connection) -> None:
        if connection not in self._growing:
            self._growing.append(connection)
        self._to_grow.set()

    async def _grow(self) -> None:
        while True:
            if not self._growing:
                self._to_grow.clear()
                await self._to_grow.wait()
            connection = self._growing.popleft()
            await self._run_for(connection, self._grow_one(connection))

    async def _grow_one(self, connection: Connection) -> None:
        began_s = monotonic_s()
        turn_s = began_s
        while connection.presence.is_here and await connection.run(connection.grow):
            now_s = monotonic_s()
            if now_s > began_s + LOOK_AHEAD_SLICE_S:
                self._want_more(connection)
                break
            if now_s > turn_s + MAX_LOOP_BLOCK_S:
                await asyncio.sleep(0)
                turn_s = monotonic_s()
        await connection.run(connection.send_prefetched)
        await asyncio.sleep(0)


async def _refuse(page: PageTransport, refusal: messages.Refusal) -> None:
    """Send a page its refusal and close the socket; a page that has to wait gets only a closing code."""
    if refusal.reason == "wait":
        await page.close(CLOSE_BUSY)
        return
    await page.send(encode_unnumbered(refusal))
    if refusal.reason == "old":
        await page.close(CLOSE_OLD)
    else:
        await page.close(REFUSED)


def _has_lease(connection: Connection) -> bool:
    return connection.lease is not None and not connection.lease.lost and not connection.recording.is_finished


async def _no_icon(_: Request) -> Response:
    return Response(status_code=204)
