"""A socket to a page, with a single exception for all the ways in which it can end."""

import contextlib

from starlette.websockets import WebSocket, WebSocketDisconnect

from minihuman.web.messages import MessageError

_ENDS = (WebSocketDisconnect, RuntimeError)  # RuntimeError: something was sent after the end


class SocketClosedError(Exception):
    """The socket was closed, by either side.

    Args:
        code: the code with which the page closed the socket; 0 if it is unknown.
    """

    def __init__(self, code: int = 0) -> None:
        super().__init__(code)
        self.code = code


class PageSocket:
    """A socket to a page.

    Raises:
        SocketClosedError: from any method but `close`, once the socket is closed.
    """

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket

    async def accept(self) -> None:
        """Accept the connection."""
        try:
            await self._socket.accept()
        except _ENDS as error:
            raise SocketClosedError from error

    async def receive(self) -> str:
        """Receive the next message.

        Raises:
            MessageError: if the message is binary, which no page sends.
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
        """Close the socket, even if it is closed already."""
        with contextlib.suppress(*_ENDS):
            await self._socket.close(code, reason[:100])
