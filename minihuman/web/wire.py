"""What page and server say to each other: every message, its limits, and the version of it all. No I/O.

Times are ns on the session's clock, which is the page's. What the page says is numbered and said again until it is
acknowledged, which it is when it is on the disk; so is what the server says, until the page has it. Numbered messages
of the page have an ``at`` of their own, each later than the one before: the log's last time tells what is in it.
"""

import struct
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from minihuman.errors import MinihumanError

VERSION = 3
MOST_BYTES = 16 * 1024  # of a message of the page's
_PICTURE = struct.Struct("<IIBBHH")  # stream number, picture number, encoding, spare, width, height
_PART = struct.Struct("<BI")  # of several messages in one: 0 for text and 1 for a picture, bytes

Ns = Annotated[int, Meta(ge=0, le=2**53)]
Number = Annotated[int, Meta(ge=0, le=2**31)]
Word = Annotated[str, Meta(max_length=64)]
Text = Annotated[str, Meta(max_length=2000)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class WireError(MinihumanError, ValueError):
    """A message that no page of ours sends."""


class Key(msgspec.Struct, tag="key", tag_field="t", forbid_unknown_fields=True):
    """A key went down or came up at ``stamp``, by the event's own time."""

    key: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_]{1,32}$")]
    down: bool
    stamp: Ns
    symbol: Word = ""
    repeat: bool = False
    trusted: bool = True  # False: a script made it, no keyboard


class Show(msgspec.Struct, tag="shown", tag_field="t", forbid_unknown_fields=True):
    """A screen, or in an episode a step's picture, reached the display."""

    submit: Ns
    flip: Ns
    screen: Number = 0  # as the server told it; 0: the page went there ahead of it
    name: Ns = 0  # of the screen that the page went to
    episode: int = -1
    step: int = -1
    node: int = -1


class Time(msgspec.Struct, tag="tick", tag_field="t", forbid_unknown_fields=True):
    """Time passed: the session asked to be told."""


class Type(msgspec.Struct, tag="typed", tag_field="t", forbid_unknown_fields=True):
    """The keyboard's layout or the input method made text."""

    text: Text


class Point(msgspec.Struct, tag="pointer", tag_field="t", forbid_unknown_fields=True):
    """Mouse or finger."""

    what: Literal["pressed", "moved", "released"]
    x: Share
    y: Share
    target: Word = ""
    along: Share = 0.0


class Focus(msgspec.Struct, tag="focus", tag_field="t", forbid_unknown_fields=True):
    """The page lost or found the keyboard, or was hidden or seen again."""

    focused: bool


class Link(msgspec.Struct, tag="link", tag_field="t", forbid_unknown_fields=True):
    """The quickest of the latest messages there and back: its ends by the page's clock, in between the server's."""

    sent: Ns
    received: int
    answered: int
    back: Ns
    latest: Ns  # how long the last one took


class Echo(msgspec.Struct, tag="asked", tag_field="t", forbid_unknown_fields=True):
    """What the experimenter asks for reached the page, which says when."""

    number: Number


class Unheard(msgspec.Struct, tag="unheard", tag_field="t", forbid_unknown_fields=True):
    """What was done in a segment that had ended before the server heard of it."""

    text: Text


Said = Key | Show | Time | Type | Point | Focus | Link | Echo | Unheard


class Hello(msgspec.Struct, tag="hello", tag_field="t", forbid_unknown_fields=True):
    """The first message on every socket."""

    version: int
    token: Annotated[str, Meta(max_length=200)] = ""
    platform: Annotated[dict[Word, Annotated[str, Meta(max_length=200)]], Meta(max_length=12)] = {}
    stream: Word = ""  # names the page's numbering; the same over reloads
    first: Number = 1  # the first message that was not acknowledged
    life: Word = ""  # the server's numbering that the page follows; "" after a reload
    heard: Number = 0  # the last message of that numbering that it has
    segment: Word = ""  # the segment that its times belong to
    last: Ns = 0  # its last time
    facts: Annotated[dict[Word, bool | float | Annotated[str, Meta(max_length=200)]], Meta(max_length=40)] = {}


class Numbered(msgspec.Struct, tag="n", tag_field="t", forbid_unknown_fields=True):
    """A message of the page's stream."""

    n: Annotated[int, Meta(ge=1, le=2**31)]
    at: Annotated[int, Meta(ge=1, le=2**53)]
    what: Said


class Heard(msgspec.Struct, tag="heard", tag_field="t", forbid_unknown_fields=True):
    """The page has all of the server's messages up to this."""

    n: Number


class Ping(msgspec.Struct, tag="ping", tag_field="t", forbid_unknown_fields=True):
    """Is anybody there, and what time is it."""

    sent: Ns


_FROM_PAGE = msgspec.json.Decoder(Hello | Numbered | Heard | Ping)


def read(text: str | bytes) -> Hello | Numbered | Heard | Ping:
    """A message of the page's.

    Raises:
        WireError: if it is none, or over its limits.
    """
    if len(text) > MOST_BYTES:
        raise WireError(f"a message of {len(text)} bytes; {MOST_BYTES} are the most")
    try:
        message: Hello | Numbered | Heard | Ping = _FROM_PAGE.decode(text)
        return message
    except (msgspec.DecodeError, msgspec.ValidationError, UnicodeError, RecursionError) as error:
        raise WireError(f"no message of a page's: {error}") from error


class Welcome(msgspec.Struct, tag="welcome", tag_field="t"):
    """The answer to a hello: whose turn it is in both streams, and the session's time."""

    segment: str
    life: str  # names the server's numbering
    again: bool  # it goes on where the page knows it; else it begins with all there is to show
    heard: int  # the last of the page's messages that was taken
    now: int  # the session's time, about
    keys: dict[str, str]  # a browser's name of a key's place -> ours
    token: str  # of a link made for them just now, which brings them back; "" for whoever had one
    words: dict[str, str]  # what the page says around a session
    taken: int  # the time of the last of the page's messages that the session has: it may not be acknowledged


class Refused(msgspec.Struct, tag="refused", tag_field="t"):
    """Nothing here for this page; it does not come again by itself."""

    reason: str
    words: str


class Acked(msgspec.Struct, tag="acked", tag_field="t"):
    """All of the page's messages up to this are on the disk."""

    through: int


class Pong(msgspec.Struct, tag="pong", tag_field="t"):
    """The answer to a ping, by the server's clock."""

    sent: int
    received: int
    answered: int


class ToShow(msgspec.Struct, tag="screen", tag_field="t"):
    """A screen, as `drawn` makes it."""

    id: int
    through: int  # the page's messages that led to it
    at: int  # the session's time then
    tick: int | None  # when the session wants to be told the time
    screen: dict[str, Any]
    name: int = 0  # of what is shown, and where in the session


class Coming(msgspec.Struct):
    """A screen that an input may lead to."""

    name: int
    screen: dict[str, Any]
    after: int | None  # ns until the session wants to be told the time, from the input on
    episode: int = -1  # that begins with it
    scene: int = -1  # in which it begins


class Onward(msgspec.Struct, tag="onward", tag_field="t"):
    """What would come outside of episodes: screens, and which input leads from one to another."""

    screens: list[Coming]
    edges: list[tuple[int, str, int]]  # screen, "key:enter", "point:go_on" or "tick", screen


class Frame(msgspec.Struct, tag="frame", tag_field="t"):
    """A picture of a film on the screen, drawn since the screen was told."""

    name: int  # of the screen
    side: int  # which of its films
    place: int  # in it
    picture: int


class Rules(msgspec.Struct, tag="rules", tag_field="t"):
    """What keys and time do in the episode that is played: what the page needs to go ahead of the session."""

    episode: int
    actions: dict[str, int]  # key -> action
    real_time: bool
    period: int
    noop: int | None
    auto_repeat: bool
    most_steps: int
    held: bool  # the last picture stays for a while
    keep: int  # pictures before this number are of no use any more, but for those on a screen


class Now(msgspec.Struct, tag="now", tag_field="t"):
    """Where the session stands in an episode."""

    through: int
    tick: int | None
    episode: int = -1
    step: int = -1
    node: int = -1
    who: str = ""  # steers, "agent" or "person"; "" where an agent never does
    action: int = -1  # that the agent makes next, if nobody takes over
    limit: int | None = None  # beside an agent: from when on keys do nothing


class Beside(msgspec.Struct, tag="beside", tag_field="t"):
    """An agent plays an episode: what keys and time do then, and what is said below the picture."""

    episode: int
    period: int  # ns from the picture of one of its steps to the next step
    takes_over: bool  # by a key that has an action
    hand_back: str  # the key; "" where there is nobody to hand back to
    good: str  # the keys that rate it; "" where it is not rated
    bad: str
    flash: int  # ns that such a press is seen
    apart: int  # ns in which a held key counts once
    said: dict[str, str]  # who steers -> what is said


class Ahead(msgspec.Struct, tag="ahead", tag_field="t"):
    """What would come: scenes with their pictures, and which action leads from one to another."""

    episode: int
    nodes: list[tuple[int, int]]  # scene, picture
    edges: list[tuple[int, int, int, bool]]  # scene, action, scene, whether the episode ends by it


class Ask(msgspec.Struct, tag="ask", tag_field="t"):
    """The experimenter asks for something; the page says when that was."""

    number: int


class Over(msgspec.Struct, tag="over", tag_field="t"):
    """The session's log is on the disk; where to go from here."""

    end: str
    words: str
    your_code: str  # what stands before the code
    code: str  # "" for none
    leave: str  # what leads to the address
    url: str  # "" for none


class Picture(msgspec.Struct, frozen=True):
    """A picture, for the page to keep under its number."""

    number: int
    encoding: int  # 0: zlib of RGB, 1: JPEG
    width: int
    height: int
    data: bytes


Told = ToShow | Frame | Rules | Beside | Now | Ahead | Onward | Ask | Over
_ENCODER = msgspec.json.Encoder()


class _Carried(msgspec.Struct):
    n: int
    m: Told


def numbered(number: int, message: Told | Picture) -> bytes:
    """A message of the server's stream, as part of what goes over the line."""
    if isinstance(message, Picture):
        head = _PICTURE.pack(number, message.number, message.encoding, 0, message.width, message.height)
        return _PART.pack(1, len(head) + len(message.data)) + head + message.data
    return _text(_Carried(number, message))


def acked(through: int) -> bytes:
    """Word of what is on the disk, as part of what goes over the line with messages of the stream."""
    return _text(Acked(through))


def plain(message: Welcome | Refused | Pong) -> str:
    """A message beside the stream."""
    return _ENCODER.encode(message).decode()


def _text(message: _Carried | Acked) -> bytes:
    text = _ENCODER.encode(message)
    return _PART.pack(0, len(text)) + text
