"""The protocol of a page on one socket: texts in, batches of bytes out. No I/O, no clock.

A hello settles where both streams resume. Numbered messages, acknowledgements and pings follow, several in one text.
The page is sent the session's messages, numbered, in batches, with the acknowledgement of its messages that are safe.
The protocol does not depend on what carries the texts and batches, which may be a socket or HTTP requests.
"""

import abc
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from minihuman.web import messages
from minihuman.web.message_codec import decode_page_message, encode_numbered, encode_text, encode_unnumbered
from minihuman.web.message_streams import IncomingStream, OutgoingStream
from minihuman.web.traffic_limits import MAX_BACKLOG, PREFETCH_BACKLOG, RateLimit

MAX_BATCH_BYTES = 65_536  # of messages that are sent as one

_TEXTS = (messages.TextMessage, messages.FieldMessage)  # what a participant typed
ServerMessages = OutgoingStream[messages.ServerMessage | messages.PictureMessage]


class StreamNames:
    """Tracks which of the page's streams is being received, and which of the server's numberings the page follows."""

    def __init__(self) -> None:
        self.incoming = IncomingStream()
        self.life = ""  # the server's numbering; "": the page has nothing of it
        self._stream = ""

    def receive_stream(self, stream: str, first: int) -> bool:
        """Follow a page's stream from its first unacknowledged message; return True if it is a new stream."""
        if stream == self._stream:
            return False
        self._stream = stream
        self.incoming = IncomingStream(first - 1)
        return True

    def resumes(self, life: str, heard: int, outgoing: ServerMessages) -> bool:
        """Return whether a page can continue with the server's numbering.

        It can if it names that numbering and claims to have no message that was never sent.
        """
        return bool(self.life) and life == self.life and heard <= outgoing.last_number


class PageSession(abc.ABC):
    """The interface through which a page's protocol uses its session."""

    ping: tuple[int, int] | None = None  # the times at which a ping to answer with the next batch was sent and received

    @property
    @abc.abstractmethod
    def outgoing(self) -> ServerMessages:
        """Return the stream of messages to the page; a restart replaces it."""

    @abc.abstractmethod
    def now_ns(self) -> int:
        """Return the session's time in nanoseconds."""

    @abc.abstractmethod
    def safe(self) -> int:
        """Return the number of the last message of the page that may be acknowledged."""

    @abc.abstractmethod
    def take(self, numbered: messages.NumberedMessage, *, more: bool = False) -> None:
        """Handle a numbered message of the page's stream.

        Args:
            numbered: the message.
            more: whether further messages arrived with this one.

        Raises:
            MessageError: if the message is out of order, or its time is not plausible.
        """

    @abc.abstractmethod
    def hear(self, now_s: float) -> None:
        """Record that the page is alive at a monotonic time in seconds."""

    @abc.abstractmethod
    def record_act(self) -> None:
        """Record that the participant is typing a text that the page has not sent yet."""

    @abc.abstractmethod
    def bid_farewell(self, *, is_left: bool) -> None:
        """Record that the page was closed, or that the participant left it for another page."""

    @abc.abstractmethod
    def spend(self, n_bytes: int, *, number: int, is_text: bool = False) -> bool:
        """Count the size of a message against the session's budget; return False if the session accepts no more.

        A message that was received before costs nothing: over a bad network an honest page repeats many messages, and
        repeated messages are not written.

        Args:
            n_bytes: the size of the message.
            number: the message's number.
            is_text: whether the message contains text that the participant typed.
        """

    @abc.abstractmethod
    def forget(self) -> None:
        """Discard the messages kept for the page, so that it starts afresh when it reconnects."""


@dataclass(frozen=True, slots=True)
class TextEffect:
    """The effect of a text that a page sent."""

    has_answer: bool  # whether there are messages or an acknowledgement to send
    wants_more: bool  # whether to look further ahead


class PageProtocol:
    """Speaks the protocol between one socket of a page and its session.

    Args:
        session: the page's session.
        welcome: the answer to the page's hello.
        after: the number of the last server message that the page has.
        now_s: the present monotonic time in seconds.
    """

    def __init__(self, session: PageSession, welcome: messages.Welcome, after: int, now_s: float) -> None:
        self._session = session
        self._welcome = welcome
        self._outgoing = session.outgoing
        self._sent = after  # the number of the last server message that was sent
        self._acknowledged = 0  # the number of the last page message that was acknowledged
        self._rate_limit = RateLimit(now_s)
        self._last_number = 0  # the server's last message before the text that is being received
        self._was_behind = False  # whether the page had too many unacknowledged messages to look ahead for it
        self._ends_with_round_trip = False

    # From the page

    def begin_text(self, now_s: float) -> None:
        """Record the session's state before a text, which may contain several messages, for ``end_text``.

        Args:
            now_s: the monotonic time in seconds.
        """
        self._session.hear(now_s)
        self._last_number = self._session.outgoing.last_number
        self._was_behind = False

    def admit(self, n_messages: int, now_s: float) -> int:
        """Count further messages, as many as the rate limit admits now; return how many those are. The rest must wait.

        Args:
            n_messages: the number of messages.
            now_s: the monotonic time in seconds.
        """
        return self._rate_limit.take(now_s, n_messages)

    def receive_all(self, lines: Sequence[str], *, more: bool) -> list[str]:
        """Handle messages that arrived together; return the answers to be sent at once.

        Args:
            lines: the messages.
            more: whether further messages follow in the same text.

        Raises:
            MessageError: if a message is one that the study's own page never sends; those before it were handled.
        """
        answers = [self.receive(line, more=more or number < len(lines)) for number, line in enumerate(lines, 1)]
        return [answer for answer in answers if answer is not None]

    def receive(self, text: str, *, more: bool) -> str | None:
        """Handle one message; return the answer to be sent at once, or None if there is none.

        Args:
            text: the message.
            more: whether further messages follow in the same text.

        Raises:
            MessageError: if the message is one that the study's own page never sends.
        """
        message = decode_page_message(text)
        self._ends_with_round_trip = False
        match message:
            case messages.NumberedMessage():
                self._receive_numbered(message, len(text), more=more)
            case messages.Ping():
                return self._receive_ping(message, more=more)
            case messages.PageAck():
                self._acknowledge(message.n)
            case messages.Farewell():
                if not self.is_superseded:  # otherwise a newer page is connected already
                    self._session.bid_farewell(is_left=message.left)
            case messages.Hello():
                raise messages.MessageError(
                    "a second hello arrived, but a page must send one per connection; reload the page"
                )
        return None

    def _receive_numbered(self, message: messages.NumberedMessage, n_bytes: int, *, more: bool) -> None:
        """Give the session a numbered message, if its budget admits it."""
        is_text = isinstance(message.what, _TEXTS)
        if self._session.spend(n_bytes, number=message.n, is_text=is_text):
            self._session.take(message, more=more)
            self._ends_with_round_trip = isinstance(message.what, messages.RoundTripMessage)

    def _receive_ping(self, ping: messages.Ping, *, more: bool) -> str | None:
        """Return the answer to a ping; None if the next batch contains it, as further messages follow in the text."""
        if ping.acted:
            self._session.record_act()
        received_ns = self._session.now_ns()
        if more:
            self._session.ping = ping.sent, received_ns
            return None
        return encode_unnumbered(messages.Pong(ping.sent, received_ns, self._session.now_ns()))

    def _acknowledge(self, number: int) -> None:
        """Discard messages that the page has; note whether too many were unacknowledged to look ahead for the page."""
        outgoing = self._session.outgoing
        was_behind = outgoing.n_unacknowledged > PREFETCH_BACKLOG
        outgoing.acknowledge(number)
        self._was_behind |= was_behind

    def end_text(self) -> TextEffect:
        """End the reception of a text, and return its effect.

        Raises:
            MessageError: if too many of the server's messages have not been acknowledged. They are discarded, so that
                the page starts afresh when it reconnects.
        """
        outgoing = self._session.outgoing
        if outgoing.n_unacknowledged > MAX_BACKLOG:
            self._session.forget()
            raise messages.MessageError(f"more than {MAX_BACKLOG} messages have not been acknowledged; reload the page")
        has_grown = outgoing.last_number != self._last_number
        return TextEffect(
            has_answer=has_grown or self._session.safe() > self._acknowledged,
            wants_more=has_grown or self._was_behind or self._ends_with_round_trip,
        )

    # To the page

    def encode_welcome(self) -> str:
        """Encode the answer to the page's hello."""
        return encode_unnumbered(self._welcome)

    @property
    def is_superseded(self) -> bool:
        """Return whether the session's messages have been renumbered, so that this socket's page must reconnect."""
        return self._session.outgoing is not self._outgoing

    @property
    def can_wait(self) -> bool:
        """Return whether the pending messages may be delayed, because the page has computed their content ahead."""
        return all(
            isinstance(message, messages.EpisodeState) and message.tick is None and not message.who
            for _, message in self._outgoing.after(self._sent)
        )

    def take_batches(self) -> Iterator[bytes]:
        """Yield the pending data in batches: messages, their acknowledgement, and the answer to a ping."""
        safe = self._session.safe()  # read first: a message's consequences precede its acknowledgement
        parts: list[bytes] = []
        size_bytes = 0
        for number, message in self._outgoing.after(self._sent):
            parts.append(encode_numbered(number, message))
            self._sent = number
            size_bytes += len(parts[-1])
            if size_bytes > MAX_BATCH_BYTES:
                yield b"".join(parts)
                parts = []
                size_bytes = 0
        if safe > self._acknowledged:
            self._acknowledged = safe
            parts.append(encode_text(messages.ServerAck(safe)))
        if self._session.ping is not None:
            ping = self._session.ping
            self._session.ping = None
            parts.append(encode_text(messages.Pong(*ping, self._session.now_ns())))
        if parts:
            yield b"".join(parts)
