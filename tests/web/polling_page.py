"""A page over HTTP without a browser: `polling.js` in Python, on a network that fails."""

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import httpx
from starlette.applications import Starlette

from minihuman.web.server.app import WebServer
from tests.web.typed_page import TypedPage

ADDRESS = "http://study.example"
RETRIES = 3


class Network(httpx.AsyncBaseTransport):
    """Carries requests to a server in this process.

    Args:
        server: the server.
        rng: draws the faults.
        fault_probability: of each of the faults: closed before the request came or before its answer did, delayed, and
            sent twice, as a proxy does that heard nothing.
    """

    def __init__(self, server: WebServer, rng: random.Random | None = None, fault_probability: float = 0.0) -> None:
        self._inside = httpx.ASGITransport(server.app())
        self._rng = rng or random.Random(0)
        self._fault_probability = fault_probability
        self.faults: list[str] = []

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        """Carry a request and its answer."""
        kinds = ("closed", "swallowed", "delayed", "twice")
        fault = ""
        if self._rng.random() < len(kinds) * self._fault_probability:
            fault = self._rng.choice(kinds)
            self.faults.append(fault)
        if fault == "closed":
            raise httpx.ConnectError("closed")
        if fault == "delayed":
            await asyncio.sleep(self._rng.random() * 0.3)
        if fault == "twice":
            _, response = await asyncio.gather(self._carry(request), self._carry(request))
        else:
            response = await self._carry(request)
        if fault == "swallowed":
            raise httpx.ReadError("swallowed")
        return response

    async def _carry(self, request: httpx.Request) -> httpx.Response:
        copy = httpx.Request(request.method, request.url, headers=request.headers, content=request.content)
        return await self._inside.handle_async_request(copy)


@asynccontextmanager
async def open_client(server: WebServer, network: Network | None = None) -> AsyncIterator[httpx.AsyncClient]:
    """Run a server in this process; yields what asks it as its own page does."""
    headers = {"origin": ADDRESS}
    transport = network or Network(server)
    async with (
        server._lifespan(Starlette()),
        httpx.AsyncClient(transport=transport, base_url=ADDRESS, headers=headers, timeout=None) as client,
    ):
        yield client


class PollingLine:
    """The page's side of a line."""

    def __init__(self, client: httpx.AsyncClient, name: str) -> None:
        self.end: dict[str, Any] | None = None
        self._client = client
        self._name = name
        self._n_brought = 0
        self._n_fetched = 0
        self._turn = asyncio.Lock()

    async def send(self, *texts: str) -> None:
        """Send texts in one request."""
        async with self._turn:
            self._n_brought += 1
            await self.post({"line": self._name, "n": self._n_brought, "texts": texts})

    async def fetch(self) -> bytes:
        """Ask for what the server sends, once."""
        self._n_fetched += 1
        return await self.post({"line": self._name, "n": self._n_fetched})

    async def post(self, body: dict[str, Any]) -> bytes:
        """Send a request until it is answered; nothing once the line has ended."""
        for _ in range(RETRIES + 1):
            try:
                response = await self._client.post("/socket?seat=1", json=body)
            except httpx.TransportError:
                continue
            if response.status_code == 410:
                self.end = response.json()
                return b""
            assert response.is_success, response
            return response.content
        self.end = {"code": 1006}
        return b""

    async def __aiter__(self) -> AsyncIterator[bytes]:
        while self.end is None:
            if batches := await self.fetch():
                yield batches


class PollingTypedPage(TypedPage):
    """A participant whose network lets no web socket through.

    Args:
        client: asks the server.
        number: of the participant.
        token: of their link.
        reported_rtt_s: that the page reports whatever it measures; None: what it measures.
    """

    def __init__(
        self,
        client: httpx.AsyncClient,
        number: int,
        token: str,
        *,
        reported_rtt_s: float | None = None,
        **options: Any,
    ) -> None:
        super().__init__(ADDRESS, token, rng=random.Random(number), **options)
        self.sent_presses: list[tuple[str, int]] = []  # keys and their times
        self._client = client
        self._number = number
        self._reported_rtt_s = reported_rtt_s

    def say(self, *, waits: bool = False, **what: Any) -> int:
        """Say something, numbered."""
        if what["t"] == "key" and what["down"]:
            self.sent_presses.append((what["key"], what["stamp"]))
        if what["t"] == "link" and self._reported_rtt_s is not None:
            what["back"] = what["sent"] + what["answered"] - what["received"] + round(self._reported_rtt_s * 1e9)
        return super().say(waits=waits, **what)

    def _confirmed(self, now: dict[str, Any]) -> None:
        """See where the session is; the first picture starts the clock of real time."""
        super()._confirmed(now)
        seen = (now["episode"], now["step"], now["node"])
        if now["step"] == 0 and seen != self._seen:
            self._seen = seen
            at_ns = self._now_ns()
            self.say(t="shown", submit=at_ns, flip=at_ns, episode=seen[0], step=seen[1], node=seen[2])

    @asynccontextmanager
    async def open_socket(self) -> AsyncIterator[PollingLine]:  # type: ignore[override]
        """Open a line."""
        yield PollingLine(self._client, f"{self._number:032x}")
