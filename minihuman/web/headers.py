"""The headers of every answer, and a limit on what is asked: a layer around the server's application."""

from collections.abc import Sequence

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from minihuman.web.guard import HEADERS, MAX_TARGET_BYTES

_HEADERS = [(name.encode(), value.encode()) for name, value in HEADERS]
_METHODS = ("GET", "HEAD", "POST")


class Guarded:
    """An application whose every answer has the headers that keep its pages to themselves."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse what no page of ours asks."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": _with_ours(message.get("headers", ()))}
            await send(message)

        target = len(scope.get("raw_path") or b"") + len(scope.get("query_string", b""))
        if scope["method"] not in _METHODS or target > MAX_TARGET_BYTES:
            await guarded({"type": "http.response.start", "status": 400, "headers": [(b"content-length", b"0")]})
            await send({"type": "http.response.body", "body": b""})
            return
        await self._app(scope, receive, guarded)


def _with_ours(headers: Sequence[tuple[bytes, bytes]]) -> list[tuple[bytes, bytes]]:
    names = {name for name, _ in _HEADERS}
    return [*((name, value) for name, value in headers if name.lower() not in names), *_HEADERS]
