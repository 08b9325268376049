"""Encodes the server's messages, and decodes and checks the page's. No I/O.

Several of the server's messages are sent as one batch, and pictures are binary. Messages that a page sends with every
key are short arrays.
"""

import struct
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from minihuman.web.messages import (
    Digest,
    DisplayedMessage,
    Farewell,
    Hello,
    KeyMessage,
    KeyName,
    MessageError,
    NumberedMessage,
    PageAck,
    PictureMessage,
    Ping,
    Pong,
    Refusal,
    ServerAck,
    ServerMessage,
    ShortText,
    TickMessage,
    Welcome,
)

MAX_MESSAGE_BYTES = 16 * 1024  # of a page's message
_PICTURE = struct.Struct("<IIBBHH")  # stream number, picture number, encoding, spare, width, height
_PART = struct.Struct("<BI")  # the head of a part of a batch: 0 for text and 1 for a picture, size in bytes

_FROM_PAGE = msgspec.json.Decoder(Hello | NumberedMessage | PageAck | Ping | Farewell)
# Numbered messages that come with every key are arrays: kind, number, time in us, and these fields, absent ones at the
# end left out. Times of events are in us before the message's own.
_HEAD = [("n", Annotated[int, Meta(ge=1, le=2**31)]), ("at", Annotated[int, Meta(ge=1, le=2**43)])]
_AGO = Annotated[int, Meta(ge=-(2**43), le=2**43)]
_PRESS: list[Any] = [
    ("ago", _AGO),
    ("key", KeyName),
    ("down", Literal[0, 1]),
    ("digest", Digest, ""),
    ("symbol", ShortText, ""),
]
_SHOWN: list[Any] = [("flip", _AGO), ("submit", _AGO), ("episode", int), ("step", int), ("node", int, -1)]
_Press: Any = msgspec.defstruct(
    "_Press", [*_HEAD, *_PRESS, ("repeat", bool, False)], array_like=True, tag="k", forbid_unknown_fields=True
)
_Shown: Any = msgspec.defstruct("_Shown", [*_HEAD, *_SHOWN], array_like=True, tag="s", forbid_unknown_fields=True)
_Tick: Any = msgspec.defstruct(
    "_Tick", [*_HEAD, ("digest", Digest, "")], array_like=True, tag="t", forbid_unknown_fields=True
)
_SHORT: msgspec.json.Decoder[Any] = msgspec.json.Decoder(_Press | _Shown | _Tick)


def decode_page_message(text: str | bytes) -> Hello | NumberedMessage | PageAck | Ping | Farewell:
    """Decode a message from the page.

    Raises:
        MessageError: if the text is not a message, or exceeds its limits.
    """
    if len(text) > MAX_MESSAGE_BYTES:
        raise MessageError(f"a message has {len(text)} bytes; at most {MAX_MESSAGE_BYTES} are allowed; reload the page")
    try:
        if text[:1] in ("[", b"["):
            return _expand_message(_SHORT.decode(text))
        message: Hello | NumberedMessage | PageAck | Ping | Farewell = _FROM_PAGE.decode(text)
        return message
    except (msgspec.DecodeError, LookupError, TypeError, ValueError, RecursionError) as error:
        raise MessageError(f"a message from a page cannot be decoded ({error}); reload the page") from error


def _expand_message(short: Any) -> NumberedMessage:
    """Convert a message that was decoded from a short array, with times in microseconds, to a numbered message.

    Raises:
        ValueError: if a time is before the session's start.
    """
    at_ns = _NS_PER_US * short.at
    kind = type(short)
    if kind is _Tick:
        return NumberedMessage(short.n, at_ns, TickMessage(short.digest))
    if kind is _Press:
        _require_since_start(short.ago, short.at)
        stamp_ns = at_ns - _NS_PER_US * short.ago
        press = KeyMessage(short.key, short.down == 1, stamp_ns, short.symbol, short.repeat, digest=short.digest)
        return NumberedMessage(short.n, at_ns, press)
    _require_since_start(max(short.flip, short.submit), short.at)
    flip_ns = at_ns - _NS_PER_US * short.flip
    submit_ns = at_ns - _NS_PER_US * short.submit
    display = DisplayedMessage(submit_ns, flip_ns, episode=short.episode, step=short.step, node=short.node)
    return NumberedMessage(short.n, at_ns, display)


def _require_since_start(ago_us: int, at_us: int) -> None:
    """Raise ValueError if a time ``ago_us`` before a message's time ``at_us`` is before the session's start, at 0."""
    if ago_us > at_us:
        raise ValueError("a time is before the session's start")


_ENCODER = msgspec.json.Encoder()
_NS_PER_US = 1000


class _NumberedServerMessage(msgspec.Struct):
    n: int
    m: ServerMessage


def encode_numbered(number: int, message: ServerMessage | PictureMessage) -> bytes:
    """Encode a message of the server's stream, with its number in the stream, as a part of a batch."""
    if isinstance(message, PictureMessage):
        head = _PICTURE.pack(number, message.number, message.encoding, 0, message.width, message.height)
        return _PART.pack(1, len(head) + len(message.data)) + head + message.data  # 1: a picture
    return encode_text(_NumberedServerMessage(number, message))


def encode_unnumbered(message: Welcome | Refusal | Pong) -> str:
    """Encode as JSON a message that is not part of the server's numbered stream."""
    return _ENCODER.encode(message).decode()


def encode_text(message: _NumberedServerMessage | ServerAck | Pong) -> bytes:
    """Encode a message as JSON, as a text part of a batch."""
    return _frame_text(_ENCODER.encode(message))


def encode_part(text: str) -> bytes:
    """Encode the JSON of an unnumbered message as a part of a batch, for a transport that carries only batches."""
    return _frame_text(text.encode())


def _frame_text(text: bytes) -> bytes:
    return _PART.pack(0, len(text)) + text  # 0: text
