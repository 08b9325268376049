"""The port through which the server talks to a page over a web socket or HTTP, and the exception for its end."""

import abc

from minihuman.web.messages import TransportName


class SocketClosedError(Exception):
    """The transport was ended by either side.

    Args:
        code: the code with which the page closed it; 0 if none is known.
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
            MessageError: if the page sent something other than a text.
        """

    @abc.abstractmethod
    async def send(self, message: str | bytes) -> None:
        """Send a message, or a batch of them as bytes."""

    @abc.abstractmethod
    async def close(self, code: int, reason: str = "") -> None:
        """End the transport; it may have ended already."""
