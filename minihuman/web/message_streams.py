"""Message numbers and acknowledgements, with one stream in each direction. No I/O.

Each side repeats its messages until the other has them: the page until they are on the server's disk, the server until
the page has them. A stream outlives the sockets that carry it. A socket keeps its order, so a gap is an error.
"""

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

from minihuman.web.messages import MessageError

Message = TypeVar("Message")


class OutgoingStream(Generic[Message]):
    """Numbers this side's messages from 1, and keeps them until they are acknowledged."""

    def __init__(self) -> None:
        self._unacknowledged: deque[tuple[int, Message]] = deque()
        self.last_number = 0  # of the last message

    @property
    def n_unacknowledged(self) -> int:
        """Return the number of messages that are not acknowledged yet."""
        return len(self._unacknowledged)

    def add(self, message: Message) -> None:
        """Number a message and keep it until it is acknowledged."""
        self.last_number += 1
        self._unacknowledged.append((self.last_number, message))

    def acknowledge(self, number: int) -> None:
        """Discard the messages up to a number, which the other side has received.

        Raises:
            MessageError: if no message with that number was sent.
        """
        if number > self.last_number:
            raise MessageError(
                f"message {number} was acknowledged, but the last one sent is {self.last_number}; reload the page"
            )
        while self._unacknowledged and self._unacknowledged[0][0] <= number:
            self._unacknowledged.popleft()

    def after(self, number: int) -> Iterator[tuple[int, Message]]:
        """Yield the number and content of each unacknowledged message after a given number."""
        unacknowledged = tuple(self._unacknowledged)  # a copy, as messages may be added or removed meanwhile
        return ((own_number, message) for own_number, message in unacknowledged if own_number > number)


class IncomingStream:
    """Counts the messages received from the other side.

    Args:
        received: the number of the last message that was received before.
    """

    def __init__(self, received: int = 0) -> None:
        self.received = received

    def take(self, number: int) -> bool:
        """Count a message as received; return whether it is new.

        Raises:
            MessageError: if a message before it is missing.
        """
        if number > self.received + 1:
            raise MessageError(
                f"message {number} arrived after message {self.received}; the messages in between are missing; reload "
                "the page"
            )
        is_new = number == self.received + 1
        self.received = max(self.received, number)
        return is_new
