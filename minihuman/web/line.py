"""One socket, with one word for its end.

Whoever closes a socket, and whenever, is told of in several ways: Starlette has two, uvicorn's protocols others, and
which one comes depends on who was first. Here all of them are `LineError`.
"""

import contextlib

from starlette.websockets import WebSocket, WebSocketDisconnect

from minihuman.web.wire import WireError

_ENDS = (WebSocketDisconnect, RuntimeError)  # RuntimeError: something was sent after the end


class LineError(Exception):
    """The socket has ended, from either side."""


class Line:
    """A socket to a page.

    Raises:
        LineError: from any method but `close`, once the socket has ended.
    """

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket

    async def accept(self) -> None:
        """Take the call."""
        try:
            await self._socket.accept()
        except _ENDS as error:
            raise LineError from error

    async def hear(self) -> str:
        """The next message.

        Raises:
            WireError: it is bytes, which no page sends.
        """
        try:
            return await self._socket.receive_text()
        except KeyError:
            raise WireError("a page sends text") from None
        except _ENDS as error:
            raise LineError from error

    async def say(self, message: str | bytes) -> None:
        """Send a message."""
        try:
            if isinstance(message, str):
                await self._socket.send_text(message)
            else:
                await self._socket.send_bytes(message)
        except _ENDS as error:
            raise LineError from error

    async def close(self, code: int, reason: str = "") -> None:
        """End the socket, which may have ended already."""
        with contextlib.suppress(*_ENDS):
            await self._socket.close(code, reason[:100])
