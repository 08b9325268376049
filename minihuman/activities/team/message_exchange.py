"""The messages that a team's seats pass to each other: words at once, a mark as long as it is seen. No clock."""

from collections.abc import Iterable, Set
from dataclasses import dataclass

from minihuman.activities.team.message_events import MessageShown
from minihuman.activities.team.messages import INTERVAL_NS

MARK_S = INTERVAL_NS / 1e9  # how long a mark is seen


@dataclass(frozen=True, slots=True)
class SentMessage:
    """A message, and when it came."""

    message: MessageShown
    since_s: float


class MessageExchange:
    """The messages of a block, in the order in which they came."""

    def __init__(self) -> None:
        self._sent: dict[str, SentMessage] = {}  # by digest

    def send(self, messages: Iterable[MessageShown], now_s: float) -> bool:
        """Take a seat's messages; whether there is a new one among them."""
        new = [message for message in messages if message.digest not in self._sent]
        self._sent |= {message.digest: SentMessage(message, now_s) for message in new}
        return bool(new)

    def find_next(self, seat: int, received: Set[str], now_s: float) -> MessageShown | None:
        """Find the next message of another that a seat has not received; words wait for it, a mark does not."""
        for sent in self._sent.values():
            is_due = bool(sent.message.text) or now_s - sent.since_s < MARK_S
            if sent.message.seat != seat and is_due and sent.message.digest not in received:
                return sent.message
        return None
