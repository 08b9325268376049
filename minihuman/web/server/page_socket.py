"""A web socket to a page, which raises the same exception however the connection ends."""

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
        """Accept the connection.

        Raises:
            SocketClosedError: if the page has left meanwhile.
        """
        try:
            await self._socket.accept()
        except _ENDS as error:
            raise SocketClosedError from error

    async def receive(self) -> str:
        """Receive the next message.

        Raises:
            MessageError: if the message is binary, which no page sends.
            SocketClosedError: if the socket is closed.
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
        """Send a message, or a batch of messages as bytes.

        Raises:
            SocketClosedError: if the socket is closed.
        """
        try:
            if isinstance(message, str):
                await self._socket.send_text(message)
            else:
                await self._socket.send_bytes(message)
        except _ENDS as error:
            raise SocketClosedError from error

    async def close(self, code: int, reason: str = "") -> None:
        """Close the socket, even if it is closed already."""
        with contextlib.suppress(*_ENDS):
            await self._socket.close(code, reason[:100])
