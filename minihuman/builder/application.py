"""The builder as an application that the desk mounts below its secret path: the page's files and the interface."""

from collections.abc import Iterator
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, Router
from starlette.types import Receive, Scope, Send

from minihuman.builder.preview_api import PreviewApi
from minihuman.builder.study_api import BuilderApi
from minihuman.web.http_security import build_headers
from minihuman.web.server.page_routes import HeaderMiddleware

PATH = "builder"  # below the desk's secret path
PAGE_FOLDER = Path(__file__).with_name("page")
_POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-src http://127.0.0.1:*; frame-ancestors 'none'"
)
_MEDIA_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".png": "image/png",
    ".svg": "image/svg+xml",
}


class BuilderApplication:
    """The ASGI application of the builder for a folder of protocols; the desk, which serves it, closes it at its end.

    Args:
        folder: the folder of the protocols.
        data_folder: the folder of the studies' data.
    """

    def __init__(self, folder: Path, data_folder: Path) -> None:
        self._previews = PreviewApi(folder, data_folder)
        routes = [*BuilderApi(folder, data_folder).routes(), *self._previews.routes(), *_build_page_routes()]
        self._app = HeaderMiddleware(Router(routes), build_headers(policy=_POLICY))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer an ASGI request: serve a file of the page, or an answer of the builder's interface."""
        await self._app(scope, receive, send)

    def close(self) -> None:
        """End the previews and simulations that the page started, and erase what they recorded."""
        self._previews.close()


def _build_page_routes() -> Iterator[Route]:
    """Yield the routes of the page's files, with the page itself at the root."""
    for path in sorted(PAGE_FOLDER.rglob("*")):
        if path.suffix in _MEDIA_TYPES:
            address = f"/{path.relative_to(PAGE_FOLDER).as_posix()}"
            yield _build_file_route(address.replace("/index.html", "/"), path)


def _build_file_route(address: str, path: Path) -> Route:
    """Build the route that serves a file of the page, which is read anew for each request."""

    async def answer(_: Request) -> Response:
        return Response(path.read_bytes(), media_type=_MEDIA_TYPES[path.suffix])

    return Route(address, answer)
