"""A time limit for HTTP requests: a connection that sends half a request, or none, is closed.

uvicorn limits how long an idle connection is kept after an answer, but not how long a request may take to arrive. This
module extends its `H11Protocol`. It uses `transport`, `loop` and `conn` besides the methods of `asyncio.Protocol`; if
uvicorn renames one of them, no connection is closed any more, which the tests detect.
"""

import asyncio

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from minihuman.web.traffic_limits import HELLO_TIMEOUT_S

_INCOMPLETE = (h11.IDLE, h11.SEND_BODY)  # states of a client that has not sent all of a request


class TimedHttpProtocol(H11Protocol):
    """An HTTP protocol whose requests must be complete within a time limit."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time limit for the first request."""
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Receive data, and start the time limit unless it is running."""
        if self._deadline is None:
            self._wait()
        super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the time limit."""
        if self._deadline is not None:
            self._deadline.cancel()
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._deadline = self.loop.call_later(HELLO_TIMEOUT_S, self._close_if_incomplete)

    def _close_if_incomplete(self) -> None:
        self._deadline = None
        is_http = self.transport.get_protocol() is self  # else it has become a socket of a page
        if is_http and self.conn.their_state in _INCOMPLETE:
            self.transport.close()
