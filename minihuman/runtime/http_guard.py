"""Guards for the HTTP servers of an experimenter's machine: who may send requests, how large, and for how long.

`watch` and the programs' interface use the standard library's server, since they belong to the base install. The pages
of `desk` and of participants are Starlette's; they call `is_own_request`, too.
"""

import re
import socket
import sys
import threading
from collections.abc import Collection, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

Request = socket.socket | tuple[bytes, socket.socket]  # the standard library's type of a request
LOCAL_HOSTS = ("127.0.0.1", "localhost", "[::1]")
_PORT = re.compile(r":\d*$")
_MAX_LENGTH_DIGITS = 9


def is_own_request(headers: Mapping[str, str]) -> bool:
    """Return whether a request that changes something comes from a page of this server, or from no page at all.

    A browser states the site from which a request comes (`Sec-Fetch-Site`), an older one only its `Origin`. The names
    of ``headers`` are in lower case.
    """
    site = headers.get("sec-fetch-site", "")
    if site:
        return site == "same-origin"
    origin = headers.get("origin", "")
    return not origin or urlsplit(origin).netloc.lower() == headers.get("host", "").lower()


def is_named(host_header: str, names: Collection[str]) -> bool:
    """Return whether the Host header of a request has one of the given host names, with any port."""
    return _PORT.sub("", host_header) in names


def read_length(length: str, max_bytes: int) -> int | None:
    """Parse a request's Content-Length; return None if it is not a number, or exceeds ``max_bytes``."""
    if not (length.isascii() and length.isdecimal()) or len(length) > _MAX_LENGTH_DIGITS or int(length) > max_bytes:
        return None
    return int(length)


class GuardedHandler(BaseHTTPRequestHandler):
    """Handles one connection, with a limit on the duration of each request."""

    request_s = 10.0  # the time limit for a request, its answer, and the wait for the next one
    timeout = request_s

    def handle_one_request(self) -> None:
        """Handle one request within its time limit."""
        watchdog = threading.Timer(self.request_s, self._stop_reading)
        watchdog.daemon = True
        watchdog.start()
        try:
            super().handle_one_request()
        finally:
            watchdog.cancel()

    def _stop_reading(self) -> None:
        try:
            self.connection.shutdown(socket.SHUT_RD)
        except OSError:  # the client has gone
            return

    def log_message(self, format: str, *arguments: object) -> None:
        """Log nothing, since a line would contain an address and a secret."""


class GuardedServer(ThreadingHTTPServer):
    """An HTTP server with a limit on its connections, whose clients may disconnect before they are answered.

    The server's own connections are counted, not the threads of the process: whatever else runs in the process, a page
    that reloads is served.

    Args:
        address: host and port.
        handler: the class that handles a connection.
        max_connections: the number of connections at a time; a further one is closed without an answer.
    """

    daemon_threads = True

    def __init__(self, address: tuple[str, int], handler: type[GuardedHandler], *, max_connections: int = 64) -> None:
        self._free_connections = threading.BoundedSemaphore(max_connections)
        super().__init__(address, handler)

    def process_request(self, request: Request, client_address: object) -> None:
        """Handle a connection in a thread of its own, or close it if there are too many."""
        if not self._free_connections.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # the system has no thread left
            self._free_connections.release()
            raise

    def process_request_thread(self, request: Request, client_address: object) -> None:
        """Handle a connection, and count it as free afterwards."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free_connections.release()

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore errors of clients that have disconnected; print all others."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)  # type: ignore[arg-type] # as it was called
