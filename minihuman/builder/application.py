"""The builder as an application that the desk mounts below its secret path: the page's files and the interface."""

from collections.abc import Iterator
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, Router
from starlette.types import ASGIApp

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
_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".png": "image/png",
    ".svg": "image/svg+xml",
}


def build_application(folder: Path, data_folder: Path) -> ASGIApp:
    """Build the builder for a folder of protocols; ``data_folder`` is the folder of the studies' data."""
    routes = [
        *BuilderApi(folder, data_folder).routes(),
        *PreviewApi(folder, data_folder).routes(),
        *_build_page_routes(),
    ]
    return HeaderMiddleware(Router(routes), build_headers(policy=_POLICY))


def _build_page_routes() -> Iterator[Route]:
    """Yield the routes of the page's files, with the page itself at the root."""
    for path in sorted(PAGE_FOLDER.rglob("*")):
        if path.suffix in _TYPES:
            address = f"/{path.relative_to(PAGE_FOLDER).as_posix()}"
            yield _route(address.replace("/index.html", "/"), path)


def _route(address: str, path: Path) -> Route:
    async def answer(_: Request) -> Response:
        return Response(path.read_bytes(), media_type=_TYPES[path.suffix])

    return Route(address, answer)
