"""The files of the page and of activities' modules, and the headers of every answer.

The files are read and compressed when the server starts, so an update of the package does not change what a running
server sends, and a browser with a slow line waits for a third of the bytes. They hold nothing secret, which
a compressed answer could give away by its size.
"""

import gzip
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from minihuman.web.eligibility import load_page_texts
from minihuman.web.page_modules import list_page_modules
from minihuman.web.traffic_limits import MAX_TARGET_BYTES

_METHODS = ("GET", "HEAD", "POST")
_REFUSES = re.compile(r"q=0(\.0{0,3})?")


class HeaderMiddleware:
    """Adds the headers of `http_security` to every answer of an application.

    Args:
        app: the application.
        headers: the headers, as `build_headers` builds them.
    """

    def __init__(self, app: ASGIApp, headers: Mapping[str, str]) -> None:
        self._app = app
        self._headers = [(name.encode(), value.encode()) for name, value in headers.items()]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request with the headers; answer 400 if its method or the length of its target is not allowed."""
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


UNREACHABLE_ADDRESS = "/static/unreachable.json"
PAGE_FOLDER = Path(__file__).parents[1] / "page"
_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".wasm": "application/wasm",
}


def build_page_routes() -> list[Route]:
    """Build the routes of the page at the root, of its icon, and of the files that it loads below `/static`."""
    routes = [Route("/favicon.ico", _answer_without_icon)]
    for path in sorted(PAGE_FOLDER.rglob("*")):
        if path.suffix in _TYPES:
            address = f"/static/{path.relative_to(PAGE_FOLDER).as_posix()}"
            if path.name == "page.html":
                address = "/"
            routes.append(_route(address, path))
    routes += [_route(address, path) for address, path in list_page_modules()]
    routes.append(_serve(UNREACHABLE_ADDRESS, _encode_unreachable_texts(), _TYPES[".json"]))
    return routes


async def _answer_without_icon(_: Request) -> Response:
    return Response(status_code=204)


def _encode_unreachable_texts() -> bytes:
    """Encode as JSON, by language, the texts of a page that could not connect and so has no texts from the server."""
    texts = {language: page_texts["unreachable"] for language, page_texts in load_page_texts().items()}
    return json.dumps(texts, ensure_ascii=False).encode()


def _route(address: str, path: Path) -> Route:
    return _serve(address, path.read_bytes(), _TYPES[path.suffix])


def _serve(address: str, content: bytes, media_type: str) -> Route:
    """Build a route that answers with the same content every time, compressed if the request accepts gzip."""
    compressed = gzip.compress(content, mtime=0)
    vary = {"vary": "accept-encoding"}

    async def answer(request: Request) -> Response:
        if accepts_gzip(request.headers.get("accept-encoding", "")):
            return Response(compressed, media_type=media_type, headers=vary | {"content-encoding": "gzip"})
        return Response(content, media_type=media_type, headers=vary)

    return Route(address, answer)


def accepts_gzip(accept_encoding: str) -> bool:
    """Return whether the value of an Accept-Encoding header accepts gzip (RFC 9110, 12.5.3).

    It does if it names gzip or, without gzip, ``*`` with a quality above 0; "" does not.
    """
    is_accepted = {}
    for entry in accept_encoding.lower().split(","):
        coding, *parameters = (word.strip() for word in entry.split(";"))
        is_accepted[coding] = not any(_REFUSES.fullmatch(parameter) for parameter in parameters)
    return is_accepted.get("gzip", is_accepted.get("*", False))
