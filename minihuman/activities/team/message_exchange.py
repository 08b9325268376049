"""The exchange of messages between a team's seats: words are kept, and a mark expires. Reads no clock.

Pages report when their messages were written and are not trusted, so the least interval between the messages that
others see of a seat is kept here.
"""

from collections.abc import Iterable, Set
from dataclasses import dataclass

from minihuman.activities.team.message_events import MessageShown
from minihuman.activities.team.messages import INTERVAL_NS

MARK_S = INTERVAL_NS / 1e9  # how long a mark is seen


@dataclass(frozen=True, slots=True)
class SentMessage:
    """A message, and the time from which other seats see it."""

    message: MessageShown
    since_s: float


class MessageExchange:
    """The messages of a block, in order of arrival."""

    def __init__(self) -> None:
        self._sent: dict[str, SentMessage] = {}  # by digest
        self._next_s: dict[int, float] = {}  # by seat, when the next message of it can be seen

    def send(self, messages: Iterable[MessageShown], now_s: float) -> bool:
        """Add a seat's messages and return whether any of them is new.

        Other seats see each message at least the shortest interval after the seat's previous message.
        """
        new_messages = [message for message in messages if message.digest not in self._sent]
        for message in new_messages:
            since_s = max(now_s, self._next_s.get(message.seat, now_s))
            self._next_s[message.seat] = since_s + MARK_S
            self._sent[message.digest] = SentMessage(message, since_s)
        return bool(new_messages)

    def find_next(self, seat: int, received: Set[str], now_s: float) -> MessageShown | None:
        """Return the next visible message of another seat that a seat has not received; None if there is none.

        ``received`` has the digests of the messages that the seat has. Words stay available until they are received; a
        mark expires after `MARK_S`.
        """
        for sent in self._sent.values():
            message = sent.message
            if message.seat == seat or message.digest in received:
                continue
            age_s = now_s - sent.since_s
            is_expired = not message.text and age_s >= MARK_S
            if age_s >= 0 and not is_expired:
                return message
        return None
