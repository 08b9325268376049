"""Long polling over HTTP, for pages whose network blocks web sockets.

A page sends its texts with one kind of request, and waits for the server's messages with another. Both are POSTs: a
browser states the origin of a POST, and a proxy that buffers a response passes it on once it is complete. Requests are
numbered, so that a request that a proxy repeats has no second effect, and a response that was lost is sent again.
"""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Annotated

import msgspec
from msgspec import Meta
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from minihuman.web.http_security import is_same_origin
from minihuman.web.message_codec import MAX_MESSAGE_BYTES, encode_part
from minihuman.web.messages import TransportName
from minihuman.web.server.page_transport import PageTransport, SocketClosedError
from minihuman.web.traffic_limits import MAX_WAITING

HOLD_S = 20.0  # the longest wait of a request for something to send; proxies give up after 30 s or more
MAX_GAP_S = 10.0  # without a waiting request, after which the page counts as gone
LINGER_S = 30.0  # for which an ended line is remembered, so that its page can learn the reason
MAX_BODY_BYTES = 8 * MAX_MESSAGE_BYTES
MAX_TEXTS = 500  # of a request
MAX_BUFFER_BYTES = 1 << 20  # sent but not fetched; further messages wait, as they do in a socket
_MAX_PARALLEL = 4  # requests of one kind on one line: a request and its repetitions
_BROKEN = 1006  # a browser's code for a socket that ended without a code


class PollRequest(msgspec.Struct, forbid_unknown_fields=True):
    """The body of a page's request."""

    line: Annotated[str, Meta(pattern="^[0-9a-f]{32}$")]  # a secret that the page has drawn at random
    n: Annotated[int, Meta(ge=1, le=2**31)]  # counts the line's requests of this kind
    texts: (
        Annotated[list[Annotated[str, Meta(max_length=MAX_MESSAGE_BYTES)]], Meta(min_length=1, max_length=MAX_TEXTS)]
        | None
    ) = None  # None if the request waits for what the server sends


class LineEnd(msgspec.Struct, frozen=True):
    """The code and reason with which a line ended, as for the close of a web socket."""

    code: int
    reason: str = ""


class LineEndedError(Exception):
    """A request arrived for a line that has ended.

    Args:
        end: the code and reason of the end.
    """

    def __init__(self, end: LineEnd) -> None:
        super().__init__(end)
        self.end = end


_REQUEST = msgspec.json.Decoder(PollRequest)


class PollingLine(PageTransport):
    """A line to a page: a lasting connection that consists of the page's numbered requests.

    It must be created inside a running event loop.
    """

    name: TransportName = "http"

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self._end: LineEnd | None = None
        self._texts: deque[str] = deque()  # delivered by requests, but not received by the server yet
        self._n_delivered = 0  # number of the latest request with texts
        self._n_delivering = 0  # count of requests with texts that are not answered yet
        self._batches: list[bytes] = []  # sent by the server, but not fetched yet
        self._buffer_bytes = 0  # size of these batches
        self._n_fetched = 0  # number of the latest request for messages
        self._n_fetching = 0  # count of requests for messages that are not answered yet
        self._answer: bytes | None = None  # to the latest request for messages, kept for its repetitions
        self._gap = self._loop.call_later(MAX_GAP_S, self._end_abandoned)

    # The server's side

    async def receive(self) -> str:
        """Receive the next text.

        Raises:
            SocketClosedError: if the line has ended, and all texts that arrived before were received.
        """
        while not self._texts:
            if self._end is not None:
                raise SocketClosedError
            await self._wait_for_change()
        text = self._texts.popleft()
        self._announce_change()
        return text

    async def send(self, message: str | bytes) -> None:
        """Send a message or a batch, after waiting for the page to fetch earlier ones if too many bytes are queued.

        Raises:
            SocketClosedError: if the line has ended.
        """
        batch = message
        if isinstance(batch, str):
            batch = encode_part(batch)
        while self._buffer_bytes > MAX_BUFFER_BYTES and self._end is None:
            await self._wait_for_change()
        if self._end is not None:
            raise SocketClosedError
        self._batches.append(batch)
        self._buffer_bytes += len(batch)
        self._announce_change()

    async def close(self, code: int, reason: str = "") -> None:
        """End the line. The page can still fetch what was sent before."""
        self.end(LineEnd(code, reason[:100]))

    def end(self, end: LineEnd) -> None:
        """End the line with a code and reason, unless it has ended already."""
        if self._end is None:
            self._end = end
            self._gap.cancel()
            self._announce_change()

    # The page's side

    async def deliver(self, number: int, texts: list[str]) -> None:
        """Accept the texts of a request, and return once the server has received them. A repeated request is ignored.

        Args:
            number: the number of the request among those with texts, from 1.
            texts: the texts.

        Raises:
            LineEndedError: if the line has ended. A request out of order ends it.
        """
        self._require_open()
        if number <= self._n_delivered:
            return
        if number > self._n_delivered + 1 or self._n_delivering >= _MAX_PARALLEL:
            self._refuse_request()
        self._n_delivered = number
        self._n_delivering += 1
        try:
            await self._wait_until_received()  # the texts of earlier requests
            self._texts.extend(texts)
            self._announce_change()
            await self._wait_until_received()
        finally:
            self._n_delivering -= 1

    async def fetch(self, number: int) -> bytes:
        """Wait for the server to send batches, and return them joined; return b"" if it sends none for ``HOLD_S``.

        A repeated request gets the same response.

        Args:
            number: the number of the request among those for messages, from 1.

        Raises:
            LineEndedError: if the line has ended and everything was fetched. A request out of order ends it.
        """
        if number == self._n_fetched + 1:  # the next request shows that the page has received the previous answer
            self._n_fetched = number
            self._answer = None
        elif number != self._n_fetched or self._n_fetching >= _MAX_PARALLEL:
            self._refuse_request()
        self._gap.cancel()
        self._n_fetching += 1
        try:
            if self._answer is None:
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._wait_until_sent(), HOLD_S)
            if self._answer is None:
                self._answer = self._take_batches()
            return self._answer
        finally:
            self._n_fetching -= 1
            if not self._n_fetching and self._end is None:
                self._gap = self._loop.call_later(MAX_GAP_S, self._end_abandoned)

    def _require_open(self) -> None:
        """Raise ``LineEndedError`` if the line has ended."""
        if self._end is not None:
            raise LineEndedError(self._end)

    def _refuse_request(self) -> None:
        """End the line because of a request out of order, and raise ``LineEndedError``."""
        end = LineEnd(_BROKEN)
        self.end(end)
        raise LineEndedError(end)

    def _end_abandoned(self) -> None:
        self.end(LineEnd(_BROKEN))

    def _take_batches(self) -> bytes:
        """Return, joined, and discard the batches that were not fetched; b"" if there are none.

        Raises:
            LineEndedError: if there are none, and the line has ended.
        """
        if not self._batches:
            self._require_open()
        answer = b"".join(self._batches)
        self._batches.clear()
        self._buffer_bytes = 0
        self._announce_change()
        return answer

    async def _wait_until_received(self) -> None:
        while self._texts and self._end is None:
            await self._wait_for_change()

    async def _wait_until_sent(self) -> None:
        while not self._batches and self._answer is None and self._end is None:
            await self._wait_for_change()

    # Changes, after each of which all waiting coroutines check their conditions again

    def _announce_change(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()  # for the next change

    async def _wait_for_change(self) -> None:
        await self._changed.wait()


class PollingEntrance:
    """Answers the requests of pages that are connected over HTTP.

    Args:
        converse: serves a page until its line ends, given its transport and address.
        is_busy: returns whether the server is too busy for further pages, which then try again later.
        max_lines: the largest number of lines whose pages have said hello, including ended lines.
    """

    def __init__(
        self, converse: Callable[[PageTransport, str], Awaitable[None]], is_busy: Callable[[], bool], *, max_lines: int
    ) -> None:
        self._converse = converse
        self._is_busy = is_busy
        self._max_lines = max_lines + MAX_WAITING  # including lines that wait for their first message
        self._lines: dict[str, PollingLine] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def answer(self, request: Request) -> Response:
        """Answer a request; refuse a request that no page of this server would send."""
        if not is_same_origin(request.headers.get("origin"), request.headers.get("host")):
            return Response(status_code=403)
        if request.headers.get("content-type") != "application/json":
            return Response(status_code=415)
        try:
            body = await _read_body(request)
        except ClientDisconnect:
            return Response(status_code=400)
        if body is None:
            return Response(status_code=413)
        try:
            poll = _REQUEST.decode(body)
        except (msgspec.DecodeError, RecursionError):
            return Response(status_code=400)
        line = self._lines.get(poll.line)
        if line is None:
            if poll.texts is None or poll.n != 1:
                return _answer_end(LineEnd(_BROKEN))  # a line that ended, or was opened on an earlier server
            if self._is_busy() or len(self._lines) >= self._max_lines:
                return Response(status_code=503)
            line = self._open_line(poll.line, request)
        return await self._answer_on_line(line, poll, request)

    async def _answer_on_line(self, line: PollingLine, poll: PollRequest, request: Request) -> Response:
        """Pass a request to its line, and answer with what the line returns."""
        try:
            if poll.texts is not None:
                await line.deliver(poll.n, poll.texts)
                return Response(status_code=204)
            batches = await _fetch_while_connected(line, poll.n, request)
        except LineEndedError as error:
            return _answer_end(error.end)
        return Response(batches, media_type="application/octet-stream")

    def _open_line(self, name: str, request: Request) -> PollingLine:
        """Open a line with the name that the page has chosen, and start serving its page."""
        line = PollingLine()
        self._lines[name] = line
        address = ""
        if request.client is not None:
            address = request.client.host
        loop = asyncio.get_running_loop()

        def forget(task: asyncio.Task[None]) -> None:
            line.end(LineEnd(_BROKEN))
            self._tasks.discard(task)
            loop.call_later(LINGER_S, self._lines.pop, name, None)

        async def converse() -> None:
            await self._converse(line, address)

        task = loop.create_task(converse())
        self._tasks.add(task)
        task.add_done_callback(forget)
        return line

    async def close(self) -> None:
        """End all lines, because the server stops."""
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)


async def _read_body(request: Request) -> bytes | None:
    """Read and return a request's body; return None if it is too long."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > MAX_BODY_BYTES:
            return None
    return bytes(body)


async def _fetch_while_connected(line: PollingLine, number: int, request: Request) -> bytes:
    """Fetch batches from a line for a request; stop waiting and return b"" if the request's client disconnects."""

    async def wait_for_disconnect() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass

    fetching = asyncio.ensure_future(line.fetch(number))
    leaving = asyncio.ensure_future(wait_for_disconnect())
    try:
        await asyncio.wait((fetching, leaving), return_when=asyncio.FIRST_COMPLETED)
        if fetching.done():
            return fetching.result()
        return b""  # the client has disconnected
    finally:
        for task in (fetching, leaving):
            task.cancel()
        await asyncio.gather(fetching, leaving, return_exceptions=True)


def _answer_end(end: LineEnd) -> Response:
    """Answer a request on a line that has ended with 410 (Gone), and the code and reason of the end."""
    return Response(msgspec.json.encode(end), status_code=410, media_type="application/json")
