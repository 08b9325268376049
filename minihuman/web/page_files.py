"""The page's files, as they were when the server started: an update of the package changes nothing that it gives."""

from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

_FOLDER = Path(__file__).with_name("static")
_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}


def page_routes() -> list[Route]:
    """The page at the root, and what it loads below `/static`."""
    files = [path for path in sorted(_FOLDER.iterdir()) if path.suffix in _TYPES]
    return [_route("/" if path.name == "page.html" else f"/static/{path.name}", path) for path in files]


def _route(address: str, path: Path) -> Route:
    content, kind = path.read_bytes(), _TYPES[path.suffix]

    async def answer(_: Request) -> Response:
        return Response(content, media_type=kind)

    return Route(address, answer)
