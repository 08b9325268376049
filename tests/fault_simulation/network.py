"""A network between pages and a server: messages take their time, and a connection may be cut. ASGI on one side."""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from tests.fault_simulation.schedule import Schedule, ServerLoop

HOST = b"study.example"
_HEADERS = [(b"host", HOST), (b"origin", b"https://" + HOST)]


class Listener(Protocol):
    """The page's side of a socket."""

    def opened(self) -> None:
        """It is open."""

    def received(self, data: str | bytes) -> None:
        """A message came."""

    def closed(self, code: int, reason: str) -> None:
        """It is closed, from either side."""


class Socket:
    """A web socket between a page and an ASGI application.

    Args:
        schedule: the time.
        loop: the server's.
        listener: the page.
        delay_s: of a message, at most; each is behind the one before it.
        twice: the probability that a message of the page's comes twice.
        swapped: the probability that it comes behind the next, which no socket does.
    """

    def __init__(
        self,
        schedule: Schedule,
        loop: ServerLoop,
        listener: Listener,
        *,
        delay_s: float,
        twice: float = 0.0,
        swapped: float = 0.0,
    ) -> None:
        self.errors: list[str] = []  # tracebacks of the server's
        self._schedule, self._loop, self._listener, self._delay_s = schedule, loop, listener, delay_s
        self._twice, self._swapped = twice, swapped
        self._up: deque[dict[str, Any]] = deque([{"type": "websocket.connect"}])
        self._wanted: asyncio.Future[None] | None = None
        self._up_ns = self._down_ns = 0  # when the last message arrives
        self._held: str | None = None
        self._cut = False
        self._page_closed = self._server_closed = False

    async def serve(self, app: Callable[..., Any]) -> None:
        """The server's side of it."""
        scope = {
            "type": "websocket",
            "path": "/socket",
            "raw_path": b"/socket",
            "query_string": b"",
            "subprotocols": [],
        }
        scope |= {"headers": _HEADERS, "scheme": "wss", "asgi": {"version": "3.0"}, "http_version": "1.1"}
        try:
            await app(scope, self._receive, self._send)
        except Exception as error:  # as a web server does
            if not self._loop.is_abandoned:
                self.errors.append(f"{type(error).__name__}: {error}")
            self._server_closed = True
            self._down(lambda: self._close_page(1011, ""))

    async def _receive(self) -> dict[str, Any]:
        while not self._up:
            self._wanted = self._loop.create_future()
            await self._wanted
        return self._up.popleft()

    async def _send(self, message: dict[str, Any]) -> None:
        if self._server_closed:
            raise RuntimeError("the socket is closed")
        match message["type"]:
            case "websocket.accept":
                self._down(self._listener.opened)
            case "websocket.send":
                data = message.get("text") or message.get("bytes") or ""
                self._down(lambda: self._listener.received(data))
            case "websocket.close":
                self._server_closed = True
                self._down(lambda: self._close_page(message.get("code", 1000), message.get("reason") or ""))

    def send(self, text: str) -> None:
        """The page sends."""
        if self._cut or self._page_closed:
            return
        if self._held is not None:
            held, self._held = self._held, None
            texts = [text, held]
        elif self._schedule.chance(self._swapped):
            self._held = text
            self._schedule.after(1.0, self._release)
            return
        else:
            texts = [text, text] if self._schedule.chance(self._twice) else [text]
        for one in texts:
            self._up_later({"type": "websocket.receive", "text": one})

    def _release(self) -> None:
        if self._held is not None:
            held, self._held = self._held, None
            self._up_later({"type": "websocket.receive", "text": held})

    def close(self) -> None:
        """The page closes it, or is gone."""
        if not self._page_closed:
            self._page_closed = True
            self._up_later({"type": "websocket.disconnect", "code": 1001})

    def cut(self) -> None:
        """Neither side hears any more; each notices in its own time."""
        self._cut = True
        rng = self._schedule.rng
        self._schedule.after(rng.random() * 3.0, lambda: self._close_page(1006, ""))
        self._schedule.after(rng.random() * 8.0, lambda: self._put({"type": "websocket.disconnect", "code": 1006}))

    def server_died(self) -> None:
        """The server's process is gone: its system closes the socket."""
        self._server_closed = True
        self._schedule.after(self._schedule.rng.random() * 0.5, lambda: self._close_page(1006, ""))

    def _close_page(self, code: int, reason: str) -> None:
        if not self._page_closed:
            self._page_closed = True
            self._listener.closed(code, reason)

    def _up_later(self, message: dict[str, Any]) -> None:
        self._up_ns = max(self._up_ns, self._schedule.now_ns + self._some_ns())

        def arrive() -> None:
            if not self._cut:
                self._put(message)

        self._schedule.after((self._up_ns - self._schedule.now_ns) / 1e9, arrive)

    def _put(self, message: dict[str, Any]) -> None:
        if self._server_closed:
            return
        self._up.append(message)
        if self._wanted is not None and not self._wanted.done():
            self._wanted.set_result(None)

    def _down(self, do: Callable[[], None]) -> None:
        self._down_ns = max(self._down_ns, self._schedule.now_ns + self._some_ns())

        def arrive() -> None:
            if not self._cut and not self._page_closed:
                do()

        self._schedule.after((self._down_ns - self._schedule.now_ns) / 1e9, arrive)

    def _some_ns(self) -> int:
        return round(self._schedule.rng.random() * self._delay_s * 1e9) + 1
