"""A web socket to a page, with one exception for all the ways in which it ends."""

import contextlib

from starlette.websockets import WebSocket, WebSocketDisconnect

from minihuman.web.messages import MessageError, TransportName
from minihuman.web.server.page_transport import PageTransport, SocketClosedError

_ENDS = (WebSocketDisconnect, RuntimeError)  # RuntimeError: something was sent after the end


class PageSocket(PageTransport):
    """A web socket to a page.

    Args:
        socket: the web socket.
    """

    name: TransportName = "websocket"

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket

    async def accept(self) -> None:
        """Take the call."""
        try:
            await self._socket.accept()
        except _ENDS as error:
            raise SocketClosedError from error

    async def receive(self) -> str:
        """Receive the next message.

        Raises:
            MessageError: it is bytes, which no page sends.
        """
        try:
            return await self._socket.receive_text()
        except KeyError:
            raise MessageError("a binary message arrived, but a page must send text; reload the page") from None
        except WebSocketDisconnect as error:
            raise SocketClosedError(error.code) from error
        except RuntimeError as error:
            raise SocketClosedError from error

    async def send(self, message: str | bytes) -> None:
        """Send a message."""
        try:
            if isinstance(message, str):
                await self._socket.send_text(message)
            else:
                await self._socket.send_bytes(message)
        except _ENDS as error:
            raise SocketClosedError from error

    async def close(self, code: int, reason: str = "") -> None:
        """End the socket, which may have ended already."""
        with contextlib.suppress(*_ENDS):
            await self._socket.close(code, reason[:100])
