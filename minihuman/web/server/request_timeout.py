"""Limits on HTTP requests: a connection that sends half a request, or none, is closed, and few of them wait at once.

uvicorn limits how long an idle connection is kept after an answer, but not how long a request may take to arrive, nor
how many connections are open. This module extends its `H11Protocol`. It uses `transport`, `loop` and `conn` besides the
methods of `asyncio.Protocol`; if uvicorn renames one of them, no connection is closed any more, which the tests detect.
"""

import asyncio
import socket
from collections import defaultdict
from typing import ClassVar

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from minihuman.web.traffic_limits import HELLO_TIMEOUT_S, MAX_WAITING, find_network

ACCEPTED_AT_ONCE = 16  # connections: few beside MAX_WAITING, as one is read only when some more were accepted
_QUEUED = 1024  # connections that the system keeps until they are accepted
_INCOMPLETE = (h11.IDLE, h11.SEND_BODY)  # states of a client that has not sent all of a request


class QueueingServer(uvicorn.Server):
    """A server that accepts few connections at once, while the system keeps many more waiting."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and lengthen the queue that asyncio has made as short as the number accepted at once."""
        await super().startup(sockets)
        for listening_socket in sockets or ():
            listening_socket.listen(_QUEUED)


class TimedHttpProtocol(H11Protocol):
    """An HTTP protocol whose requests must be complete within a time limit, and of which few may be incomplete."""

    _open: ClassVar[dict["TimedHttpProtocol", str]] = {}  # connections of this process and their networks, oldest first
    _deadline: asyncio.TimerHandle | None = None
    _has_sent = False  # whether the client has sent anything

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time limit for the first request; close a waiting connection if too many wait."""
        super().connection_made(transport)
        peer = transport.get_extra_info("peername") or ("",)
        self._open[self] = find_network(str(peer[0]))
        self._close_one_if_crowded()
        self._start_deadline()

    def data_received(self, data: bytes) -> None:
        """Receive data, and start the time limit unless it is running."""
        if self._deadline is None:
            self._start_deadline()
        self._has_sent = True
        super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection, and cancel its time limit."""
        self._open.pop(self, None)
        if self._deadline is not None:
            self._deadline.cancel()
        super().connection_lost(exc)

    def _start_deadline(self) -> None:
        self._deadline = self.loop.call_later(HELLO_TIMEOUT_S, self._close_if_incomplete)

    def _close_if_incomplete(self) -> None:
        self._deadline = None
        if self._is_waiting():
            self.transport.close()

    def _is_waiting(self) -> bool:
        """Return whether the client has not sent a whole request yet; False once the connection is a web socket."""
        is_http = self.transport.get_protocol() is self
        return is_http and not self.transport.is_closing() and self.conn.their_state in _INCOMPLETE

    def _close_one_if_crowded(self) -> None:
        """If too many connections wait for a whole request, close one of the network that has the most of them.

        A page sends its request at once, so a connection that has sent only a part of a request is hardly a page's: the
        oldest of these is closed. If there is none, the network's oldest connection is closed.
        """
        waiting_by_network: defaultdict[str, list[TimedHttpProtocol]] = defaultdict(list)
        for connection, network in tuple(self._open.items()):
            if connection._is_waiting():
                waiting_by_network[network].append(connection)
            elif connection.transport.get_protocol() is not connection:
                del self._open[connection]  # a web socket has the connection now
        if sum(map(len, waiting_by_network.values())) > MAX_WAITING:
            candidates = max(waiting_by_network.values(), key=len)
            with_partial_requests = [connection for connection in candidates if connection._has_sent]
            closed_connection = (with_partial_requests or candidates)[0]
            closed_connection.transport.close()
