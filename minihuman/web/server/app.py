"""The web application: one page, one socket per browser, one task each; the sessions' own work is the session hosts'.

What waits for the disk (connecting, finishing a log) runs in threads. Looking ahead runs between messages, for one host
after the other, so that a key never waits longer than two milliseconds or one scene. The page's files are read at
start: an update of the package does not change what a running server sends.
"""

import asyncio
import contextlib
import json
import logging
from collections import deque
from collections.abc import AsyncIterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from minihuman.errors import MinihumanError
from minihuman.runtime.machine import collect_machine_facts, collect_world_facts
from minihuman.storage.lease import RENEWAL_INTERVAL_S, TTL_S, LeaseLostError
from minihuman.storage.system import monotonic_s
from minihuman.web import messages
from minihuman.web.arrivals import Arrivals
from minihuman.web.connection import Connection, ConnectionFactory
from minihuman.web.eligibility import build_completion, classify_ending, get_page_texts, get_session_code
from minihuman.web.messages import (
    HEADERS,
    HELLO_TIMEOUT_S,
    MAX_BACKLOG,
    MAX_TARGET_BYTES,
    MAX_WAITING,
    PREFETCH_BACKLOG,
    MessageError,
    RateLimit,
    is_same_origin,
)
from minihuman.web.page_modules import list_page_modules
from minihuman.worlds.source_digest import kernels_digest

_ENDS = (WebSocketDisconnect, RuntimeError)  # RuntimeError: something was sent after the end


class SocketClosedError(Exception):
    """The socket has ended, from either side."""


class PageSocket:
    """A socket to a page.

    Raises:
        SocketClosedError: from any method but `close`, once the socket has ended.
    """

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket

    async def accept(self) -> None:
        """Take the call."""
        try:
            await self._socket.accept()
        except _ENDS as error:
            raise SocketClosedError from error

    async def receive(self) -> str:
        """The next message.

        Raises:
            MessageError: it is bytes, which no page sends.
        """
        try:
            return await self._socket.receive_text()
        except KeyError:
            raise MessageError("a binary message arrived, but a page must send text; reload the page") from None
        except _ENDS as error:
            raise SocketClosedError from error

    async def send(self, message: str | bytes) -> None:
        """Send a message."""
        try:
            if isinstance(message, str):
                await self._socket.send_text(message)
            else:
                await self._socket.send_bytes(message)
        except _ENDS as error:
            raise SocketClosedError from error

    async def close(self, code: int, reason: str = "") -> None:
        """End the socket, which may have ended already."""
        with contextlib.suppress(*_ENDS):
            await self._socket.close(code, reason[:100])


_METHODS = ("GET", "HEAD", "POST")


class HeaderMiddleware:
    """An application whose every answer has the headers that keep its pages to themselves.

    Args:
        app: the application.
        policy: a content security policy instead of the participants' page's.
    """

    def __init__(self, app: ASGIApp, *, policy: str = "") -> None:
        self._app = app
        headers = {**dict(HEADERS), "content-security-policy": policy} if policy else dict(HEADERS)
        self._headers = [(name.encode(), value.encode()) for name, value in headers.items()]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse what no page of ours asks."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": self._with_ours(message.get("headers", ()))}
            await send(message)

        target = len(scope.get("raw_path") or b"") + len(scope.get("query_string", b""))
        if scope["method"] not in _METHODS or target > MAX_TARGET_BYTES:
            await guarded({"type": "http.response.start", "status": 400, "headers": [(b"content-length", b"0")]})
            await send({"type": "http.response.body", "body": b""})
            return
        await self._app(scope, receive, guarded)

    def _with_ours(self, headers: Sequence[tuple[bytes, bytes]]) -> list[tuple[bytes, bytes]]:
        names = {name for name, _ in self._headers}
        return [*((name, value) for name, value in headers if name.lower() not in names), *self._headers]


_FOLDER = Path(__file__).parents[1] / "page"
_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".wasm": "application/wasm",
}


def build_page_routes() -> list[Route]:
    """The page at the root, and what it loads below `/static`."""
    files = [path for path in sorted(_FOLDER.rglob("*")) if path.suffix in _TYPES]
    addresses = {path: f"/static/{path.relative_to(_FOLDER).as_posix()}" for path in files}
    of_page = [_route("/" if path.name == "page.html" else addresses[path], path) for path in files]
    return [*of_page, *(_route(address, path) for address, path in list_page_modules())]


def _route(address: str, path: Path) -> Route:
    content, kind = path.read_bytes(), _TYPES[path.suffix]

    async def answer(_: Request) -> Response:
        return Response(content, media_type=kind)

    return Route(address, answer)


LOG = logging.getLogger("minihuman")
KEEP_FINISHED_S = 600.0  # a session that is over, for pages that come again
CHECK_INTERVAL_S = 1.0
LEARNER_POLL_INTERVAL_S = 0.1
COPY_INTERVAL_S = 0.05  # between copies of what leased sessions record
LOOK_AHEAD_SLICE_S = 0.01  # of one connection, before its page gets what was found and others have a turn
MAX_LOOP_BLOCK_S = 0.002  # before messages have a turn
MAX_BATCH_BYTES = 65_536  # of messages that are sent as one
# Codes of a closed socket after which the page does not come again by itself.
ANOTHER, REFUSED, FOREIGN = 4001, 4003, 4004
CLOSE_BUSY = 4100  # the page tries again in a while
CLOSE_OLD = 4002  # and after this it is loaded anew: it is of another release than the server


class WebServer:
    """A study, served.

    Args:
        arrivals: the study, and who comes.
        data: where sessions are kept.
        routes: of other pages that this server has.
    """

    def __init__(self, arrivals: Arrivals, data: Path, *, routes: Sequence[BaseRoute] = ()) -> None:
        self.connections: dict[str, Connection] = {}
        self._arrivals = arrivals
        self._web = arrivals.protocol.web
        self._factory = ConnectionFactory(arrivals, data, self.connections)
        self._routes = routes
        self._silent: dict[PageSocket, None] = {}  # without a hello, the oldest first
        self._connecting = 0  # sockets with a hello, without an answer
        self._growing: deque[Connection] = deque()
        self._to_grow = asyncio.Event()

    def app(self) -> ASGIApp:
        """The application."""
        routes = [
            *build_page_routes(),
            Route("/favicon.ico", _no_icon),
            Route("/healthz", self._health),
            Route("/metrics", self._metrics),
            WebSocketRoute("/socket", self._socket),
            *self._routes,
        ]
        return HeaderMiddleware(Starlette(routes=routes, lifespan=self._lifespan))

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        worlds = collect_world_facts(block.world for block in self._arrivals.protocol.blocks)
        if json.loads((_FOLDER / "worlds/manifest.json").read_text(encoding="utf-8"))["sources"] != kernels_digest():
            LOG.warning("the page's modules are of other rules, so none computes: run `python -m kernel_build`")
        self._factory.facts = {"player": "human", **await asyncio.to_thread(collect_machine_facts), **worlds}
        works = (self._grow, self._look_after, self._poll, self._keep_leases, self._finish_ended)
        tasks = [asyncio.create_task(work()) for work in works]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await asyncio.gather(*(asyncio.to_thread(connection.leave) for connection in self.connections.values()))

    async def _health(self, _: Request) -> Response:
        """Answer; a server whose loop is stuck does not."""
        return Response("ok\n", media_type="text/plain")

    async def _metrics(self, _: Request) -> Response:
        """What Prometheus reads; nothing that says who is there."""
        gauges = {
            "sessions": sum(not one.host.over for one in self.connections.values()),
            "pages_connected": sum(one.here for one in self.connections.values()),
            "sockets_without_hello": len(self._silent),
        }
        lines = (f"# TYPE minihuman_{name} gauge\nminihuman_{name} {count}\n" for name, count in gauges.items())
        return Response("".join(lines), media_type="text/plain; version=0.0.4")

    # A socket

    async def _socket(self, socket: WebSocket) -> None:
        page = PageSocket(socket)
        if not is_same_origin(socket.headers.get("origin"), socket.headers.get("host")):
            await page.close(FOREIGN)
            return
        if self._connecting >= MAX_WAITING:
            await page.close(CLOSE_BUSY)
            return
        try:
            await page.accept()
            if len(self._silent) >= MAX_WAITING:  # a page says hello at once: the oldest is the least likely to be one
                oldest = next(iter(self._silent))
                del self._silent[oldest]
                await oldest.close(CLOSE_BUSY)
            hello, connection = await self._receive_hello(page, socket.client.host if socket.client else "")
            if isinstance(connection, messages.Refusal) and connection.reason == "wait":
                await page.close(CLOSE_BUSY)
                return
            if isinstance(connection, messages.Refusal):
                await page.send(messages.encode_unnumbered(connection))
                await page.close(CLOSE_OLD if connection.reason == "old" else REFUSED)
                return
            await self._serve(page, connection, hello)
        except SocketClosedError:
            return
        except TimeoutError:
            await page.close(CLOSE_BUSY)  # a page that was slow to say hello tries again
        except messages.MessageError as error:
            await page.close(REFUSED, str(error))

    async def _receive_hello(
        self, page: PageSocket, address: str
    ) -> tuple[messages.Hello, Connection | messages.Refusal]:
        """Wait for the hello, and connect its page."""
        self._silent[page] = None
        try:
            hello = messages.decode_page_message(await asyncio.wait_for(page.receive(), HELLO_TIMEOUT_S))
        finally:
            self._silent.pop(page, None)
        if not isinstance(hello, messages.Hello):
            raise messages.MessageError("the page's first message must be a hello; reload the page")
        self._connecting += 1
        try:
            return hello, await self._factory.connect(hello, address)
        finally:
            self._connecting -= 1

    async def _serve(self, page: PageSocket, connection: Connection, hello: messages.Hello) -> None:
        welcome, after = connection.greet(hello)
        number = connection.sockets
        connection.changed.set()
        self._want_more(connection)
        writing = asyncio.create_task(self._write(page, connection, number, welcome, after))
        allowance = RateLimit(monotonic_s())
        try:
            while connection.sockets == number:
                texts = (await page.receive()).split("\n")  # several as one
                now_s, sent, safe = monotonic_s(), connection.host.outgoing.last_number, connection.safe()
                for place, text in enumerate(texts, 1):
                    while not allowance.take(now_s):
                        await asyncio.sleep(0.1)  # backpressure; a page that reconnects sends a lot at once
                        now_s = monotonic_s()
                    message = messages.decode_page_message(text)
                    if isinstance(message, messages.NumberedMessage):
                        connection.take(message, more=place < len(texts))
                    elif isinstance(message, messages.Ping) and place < len(texts):
                        connection.ping = message.sent, connection.now_ns()
                    else:
                        await self._answer(page, connection, message)
                await self._finish_if_over(connection)
                if connection.host.outgoing.kept > MAX_BACKLOG:
                    connection.forget()
                    raise messages.MessageError(
                        f"more than {MAX_BACKLOG} messages have not been acknowledged; reload the page"
                    )
                grown = connection.host.outgoing.last_number != sent
                if grown or connection.safe() != safe:
                    connection.changed.set()
                    await asyncio.sleep(0)  # the page hears of this before the next message is taken
                if grown or isinstance(getattr(message, "what", None), messages.RoundTripMessage):
                    self._want_more(connection)  # there is more to find
        finally:
            writing.cancel()
            connection.seen_s = monotonic_s()
            connection.gone(number)
            await asyncio.gather(writing, return_exceptions=True)

    async def _answer(
        self, page: PageSocket, connection: Connection, message: messages.Hello | messages.PageAck | messages.Ping
    ) -> None:
        match message:
            case messages.PageAck():
                was_behind = connection.host.outgoing.kept > PREFETCH_BACKLOG
                connection.host.outgoing.acknowledge(message.n)
                if was_behind:  # nothing was looked for ahead
                    self._want_more(connection)
            case messages.Ping():
                received_ns = connection.now_ns()
                await page.send(
                    messages.encode_unnumbered(messages.Pong(message.sent, received_ns, connection.now_ns()))
                )
            case messages.Hello():
                raise messages.MessageError(
                    "a second hello arrived, but a page must send one per connection; reload the page"
                )

    async def _write(
        self, page: PageSocket, connection: Connection, number: int, welcome: messages.Welcome, after: int
    ) -> None:
        """Send what there is to send, as long as this is the newest socket of its connection."""
        await page.send(messages.encode_unnumbered(welcome))
        sent, acked, outgoing = after, 0, connection.host.outgoing
        while True:
            await connection.changed.wait()
            connection.changed.clear()
            if connection.sockets != number or connection.host.outgoing is not outgoing:
                connection.changed.set()  # for the newest
                await page.close(connection.dismissed or ANOTHER)
                return
            if connection in self._growing and all(
                isinstance(message, messages.EpisodeState) and message.tick is None and not message.who
                for _, message in outgoing.after(sent)  # a page that went ahead loses nothing if these come later
            ):
                continue  # it goes with what is found ahead, in a moment
            safe = connection.safe()  # asked first: a page that hears of a safe key has heard where it led
            parts, size = [], 0
            for last, message in outgoing.after(sent):
                parts.append(messages.encode_numbered(last, message))
                sent, size = last, size + len(parts[-1])
                if size > MAX_BATCH_BYTES:
                    await page.send(b"".join(parts))
                    parts, size = [], 0
            if safe > acked:
                acked = safe
                parts.append(messages.encode_text(messages.ServerAck(acked)))
            if connection.ping is not None:
                ping, connection.ping = connection.ping, None
                parts.append(messages.encode_text(messages.Pong(*ping, connection.now_ns())))
            if parts:
                await page.send(b"".join(parts))

    # Ends

    async def _finish_if_over(self, connection: Connection) -> None:
        """Finish the log of a session that is over, then tell the page; later if the enrolment log is unavailable."""
        if not connection.host.over or connection.finishing:
            return
        connection.finishing = True
        try:
            await self._finish(connection)
        except LeaseLostError:
            await self._give_up(connection, CLOSE_BUSY)
        except OSError as error:
            if not connection.delayed:
                LOG.warning("a session is over, but its page is not told yet: %s", error)
            connection.delayed = True
            connection.finishing = False  # _look_after tries again

    async def _finish(self, connection: Connection) -> None:
        session, admission = connection.host.session, connection.admission
        await asyncio.to_thread(connection.finish)
        end = classify_ending(session.end_reason, agreed=connection.agreed, part_kind=session.part.part.kind)
        if connection.broken:
            end = "broken"
        if not connection.agreed:
            why = "declined" if end == "declined" else session.end_reason
            self._factory.isolate(connection)
            await asyncio.to_thread(self._arrivals.decline, admission, why)
        person = await asyncio.to_thread(self._arrivals.id_on_platform, admission.participant)
        code = get_session_code(self._arrivals.protocol, admission.session)
        found = build_completion(self._web, end, session_code=code, person=person)
        words = get_page_texts(session.plan.language)
        connection.over = messages.SessionOver(end, words[end], words["code"], found.code, words["leave"], found.url)
        connection.host.outgoing.add(connection.over)
        connection.changed.set()

    async def _look_after(self) -> None:
        """End the sessions whose pages do not come back, and forget those that are over."""
        while True:
            await asyncio.sleep(CHECK_INTERVAL_S)
            for connection in tuple(self.connections.values()):
                try:
                    await self._look_after_one(connection)
                except Exception:  # of one connection; the others go on
                    LOG.exception("a connection could not be looked after")

    async def _look_after_one(self, connection: Connection) -> None:
        now_s = monotonic_s()
        gone_s = 0.0 if connection.here else now_s - connection.seen_s
        if connection.ping is not None:  # there was nothing to acknowledge
            connection.changed.set()
        if not connection.host.over:
            connection.read_inbox()
        if not connection.host.over and gone_s > self._web.reconnect_timeout_s:
            connection.stop("connection_lost", "the page did not come back")
        if not connection.host.over and 0 < self._web.idle_timeout_s < now_s - connection.acted_s:
            connection.stop("timed_out", f"nothing was pressed for {self._web.idle_timeout_s:g} s")
        await self._finish_if_over(connection)
        if connection.over is not None and gone_s > KEEP_FINISHED_S:
            del self.connections[connection.key]
            connection.host.close()

    async def _poll(self) -> None:
        """See to learners that were asked for a policy."""
        while True:
            await asyncio.sleep(LEARNER_POLL_INTERVAL_S)
            for connection in tuple(self.connections.values()):
                if connection.host.is_polled and connection.poll():
                    self._want_more(connection)

    # Leases

    async def _finish_ended(self) -> None:
        """Finish what this server left when it was killed, as soon as the database can be asked."""
        while True:
            try:
                return await asyncio.to_thread(self._arrivals.finish_ended)
            except OSError:
                await asyncio.sleep(TTL_S)
            except MinihumanError as error:
                LOG.warning("what a killed server left was not finished: %s", error)
                return

    async def _keep_leases(self) -> None:
        """Renew the leases of this server's sessions, and copy what they record; let go of those that others have."""
        leases = self._arrivals.leases
        if leases is None:
            return
        renewed_s, is_away = -RENEWAL_INTERVAL_S, False
        thread = ThreadPoolExecutor(1, "minihuman-leases")  # its own: those who arrive may wait for the database
        while True:
            await asyncio.sleep(COPY_INTERVAL_S)
            now_s = monotonic_s()
            due = now_s >= renewed_s + RENEWAL_INTERVAL_S
            recorded = self._factory.recorded
            some = set(self.connections.values()) if due else recorded.intersection(self.connections.values())
            recorded.clear()
            held = [one for one in some if one.lease is not None and not one.lease.lost and not one.finished]
            if not held:
                continue
            try:
                await asyncio.get_running_loop().run_in_executor(
                    thread, leases.renew, [one.lease for one in held if one.lease is not None]
                )
            except OSError as error:
                if not is_away:
                    LOG.warning("leases are not renewed, and nothing is acknowledged: %s", error)
                is_away = True
                recorded.update(held)
                await asyncio.sleep(CHECK_INTERVAL_S)
                continue
            is_away = False
            renewed_s = now_s if due else renewed_s
            for connection in held:
                connection.changed.set()  # there is something to acknowledge
                try:
                    lease = None if connection.finishing else connection.lease
                    if lease is not None and (lease.lost or lease.wanted):
                        await self._give_up(connection, CLOSE_BUSY if lease.lost else ANOTHER)
                except Exception:  # of one connection; the others go on
                    LOG.exception("a session could not be left to another server")

    async def _give_up(self, connection: Connection, code: int) -> None:
        """Leave a session to another server."""
        if self.connections.get(connection.key) is connection:
            del self.connections[connection.key]
        connection.dismiss(code)
        await asyncio.to_thread(connection.leave)
        connection.host.close()

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
            connection, began_s = self._growing.popleft(), monotonic_s()
            turn_s = began_s
            while connection.here and connection.grow():
                now_s = monotonic_s()
                if now_s > began_s + LOOK_AHEAD_SLICE_S:
                    self._want_more(connection)
                    break
                if now_s > turn_s + MAX_LOOP_BLOCK_S:
                    await asyncio.sleep(0)
                    turn_s = monotonic_s()
            connection.send_prefetched()
            await asyncio.sleep(0)


async def _no_icon(_: Request) -> Response:
    return Response(status_code=204)
