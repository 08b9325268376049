"""The files of the page and of activities' modules, and the headers of every answer.

The files are read when the server starts, so an update of the package does not change what a running server sends.
"""

from collections.abc import Sequence
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from minihuman.web.http_security import HEADERS
from minihuman.web.page_modules import list_page_modules
from minihuman.web.traffic_limits import MAX_TARGET_BYTES

_METHODS = ("GET", "HEAD", "POST")


class HeaderMiddleware:
    """Adds the headers of `http_security` to every answer of an application.

    Args:
        app: the application.
        policy: the content security policy; "" for that of the participants' page.
    """

    def __init__(self, app: ASGIApp, *, policy: str = "") -> None:
        self._app = app
        if policy:
            headers = {**dict(HEADERS), "content-security-policy": policy}
        else:
            headers = dict(HEADERS)
        self._headers = [(name.encode(), value.encode()) for name, value in headers.items()]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse one that no page of ours sends."""
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


PAGE_FOLDER = Path(__file__).parents[1] / "page"
_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".wasm": "application/wasm",
}


def build_page_routes() -> list[Route]:
    """Build the routes of the page at the root and of the files that it loads below `/static`."""
    routes = []
    for path in sorted(PAGE_FOLDER.rglob("*")):
        if path.suffix in _TYPES:
            address = f"/static/{path.relative_to(PAGE_FOLDER).as_posix()}"
            if path.name == "page.html":
                address = "/"
            routes.append(_route(address, path))
    routes += [_route(address, path) for address, path in list_page_modules()]
    return routes


def _route(address: str, path: Path) -> Route:
    content = path.read_bytes()
    kind = _TYPES[path.suffix]

    async def answer(_: Request) -> Response:
        return Response(content, media_type=kind)

    return Route(address, answer)
