"""A numbered stream both ways, over any number of sockets: nothing is lost, nothing comes twice. No I/O.

What is said is kept until the other side has it, and said again on the next socket. What is heard is taken in order:
what was heard before is passed over, and a gap is an error, since a socket keeps its order.
"""

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

from minihuman.web.wire import WireError

Message = TypeVar("Message")


class Saying(Generic[Message]):
    """This side's messages, from 1 on."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, Message]] = deque()
        self._said = 0

    @property
    def said(self) -> int:
        """The number of the last message."""
        return self._said

    @property
    def kept(self) -> int:
        """How many messages were not heard yet."""
        return len(self._kept)

    def say(self, message: Message) -> int:
        """Keep a message until it is heard; its number."""
        self._said += 1
        self._kept.append((self._said, message))
        return self._said

    def heard(self, number: int) -> None:
        """The other side has everything up to a number.

        Raises:
            WireError: if that was never said.
        """
        if number > self._said:
            raise WireError(f"message {number} was not said yet; the last is {self._said}")
        while self._kept and self._kept[0][0] <= number:
            self._kept.popleft()

    def after(self, number: int) -> Iterator[tuple[int, Message]]:
        """What is to be said again to somebody who has everything up to a number."""
        return (kept for kept in tuple(self._kept) if kept[0] > number)


class Hearing:
    """The other side's messages.

    Args:
        heard: the last one that was taken.
    """

    def __init__(self, heard: int = 0) -> None:
        self.heard = heard

    def take(self, number: int) -> bool:
        """Whether a message is new.

        Raises:
            WireError: if one before it is missing.
        """
        if number > self.heard + 1:
            raise WireError(f"message {number} follows message {self.heard}")
        new = number == self.heard + 1
        self.heard = max(self.heard, number)
        return new
