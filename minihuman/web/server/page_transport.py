"""The port by which the server speaks with a page, whatever carries it, and the one exception for its end."""

import abc

from minihuman.web.messages import TransportName


class SocketClosedError(Exception):
    """The transport has ended, from either side.

    Args:
        code: that the page closed it with; 0: none is known.
    """

    def __init__(self, code: int = 0) -> None:
        super().__init__(code)
        self.code = code


class PageTransport(abc.ABC):
    """Carries texts from a page and batches of messages to it.

    Raises:
        SocketClosedError: from any method but `close`, once the transport has ended.
    """

    name: TransportName

    @abc.abstractmethod
    async def receive(self) -> str:
        """Receive the next text.

        Raises:
            MessageError: if it is none.
        """

    @abc.abstractmethod
    async def send(self, message: str | bytes) -> None:
        """Send a message, or a batch of them as bytes."""

    @abc.abstractmethod
    async def close(self, code: int, reason: str = "") -> None:
        """End the transport, which may have ended already."""
