"""The participant's page in a preview's frame, which must not take the keyboard focus from the form beside it."""

from http import HTTPStatus
from pathlib import Path

from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_ADDRESS = "/preview_focus.js"
_SCRIPT_FILE = Path(__file__).with_name("page") / "preview_focus.js"
_HEAD = b"<head>"
_SCRIPT = f'<script src="{_ADDRESS}"></script>'.encode()


class UnfocusedPage:
    """Middleware that adds a script to an application's page, before the page's own, and passes on all other requests.

    Args:
        app: the application, with the page at its root.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._script = Response(_SCRIPT_FILE.read_bytes(), media_type="text/javascript")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request for the page or for the script; leave any other to the application."""
        if scope["type"] != "http" or scope["path"] not in ("/", _ADDRESS):
            await self._app(scope, receive, send)
        elif scope["path"] == _ADDRESS:
            await self._script(scope, receive, send)
        else:
            await self._answer_page(scope, receive, send)

    async def _answer_page(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer with the application's page, uncompressed, after inserting the script at the beginning of its head."""
        messages: list[Message] = []
        request_headers = [(name, content) for name, content in scope["headers"] if name != b"accept-encoding"]

        async def collect(message: Message) -> None:
            messages.append(message)

        await self._app({**scope, "headers": request_headers}, receive, collect)
        start = messages[0]
        body = b"".join(message.get("body", b"") for message in messages[1:])
        if start["status"] == HTTPStatus.OK and body:
            body = body.replace(_HEAD, _HEAD + _SCRIPT, 1)
            headers = [(name, content) for name, content in start["headers"] if name.lower() != b"content-length"]
            start = {**start, "headers": [*headers, (b"content-length", str(len(body)).encode())]}
        await send(start)
        await send({"type": "http.response.body", "body": body})
