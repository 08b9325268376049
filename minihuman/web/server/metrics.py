"""The server's metrics for Prometheus, and the check of who may read them. They identify no participant."""

import hmac
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from starlette.requests import Request
from starlette.responses import Response

from minihuman.web.connection import Connection

METRICS_TOKEN_VARIABLE = "MINIHUMAN_METRICS_TOKEN"


@dataclass
class PageCounts:
    """Counts of pages since the server started."""

    http_pages: int = 0  # pages welcomed over HTTP, as their network blocks web sockets
    too_slow_pages: int = 0  # pages refused in a part in real time, as their network is too slow
    unwelcomed_pages: int = 0  # pages that reported that they could not connect by any transport

    async def answer_unwelcomed(self, _: Request) -> Response:
        """Count a page that could not connect by any transport; anyone can send this request, so it is only a hint."""
        self.unwelcomed_pages += 1
        return Response(status_code=204)


def answer_metrics(
    request: Request, connections: Iterable[Connection], counts: PageCounts, *, n_silent: int
) -> Response:
    """Answer a request of Prometheus with the metrics, or with 404 if the client may not read them.

    Args:
        request: the request for the metrics.
        connections: the open connections.
        counts: the counts of pages since the server started.
        n_silent: the number of sockets and lines that have not sent a hello.
    """
    if not _may_read_metrics(request):
        return Response(status_code=404)
    open_connections = tuple(connections)
    connected = [connection for connection in open_connections if connection.presence.is_here]
    gauges = {
        "sessions": sum(not connection.host.over for connection in open_connections),
        "pages_connected": len(connected),
        "pages_connected_over_http": sum(connection.transport == "http" for connection in connected),
        "sockets_without_hello": n_silent,
    }
    counters = {
        "http_pages_total": counts.http_pages,
        "too_slow_pages_total": counts.too_slow_pages,
        "unwelcomed_pages_total": counts.unwelcomed_pages,
    }
    text = f"{_format_metrics('gauge', gauges)}{_format_metrics('counter', counters)}"
    return Response(text, media_type="text/plain; version=0.0.4")


def _format_metrics(kind: str, numbers: Mapping[str, int]) -> str:
    return "".join(f"# TYPE minihuman_{name} {kind}\nminihuman_{name} {number}\n" for name, number in numbers.items())


def _may_read_metrics(request: Request) -> bool:
    """Return whether a request has the metrics token, or comes directly from this machine and not through a proxy."""
    token = os.environ.get(METRICS_TOKEN_VARIABLE, "")
    if token:
        return hmac.compare_digest(request.headers.get("authorization", "").encode(), f"Bearer {token}".encode())
    is_forwarded = "x-forwarded-for" in request.headers or "forwarded" in request.headers
    return not is_forwarded and request.client is not None and request.client.host in ("127.0.0.1", "::1")
