"""The messages between page and server: their fields, limits and version, the numbered streams of them, and what the
server refuses: pages of other origins, floods, huge messages. No I/O; times come in as arguments.

Times are ns on the session's clock. The page repeats its messages until they are acknowledged, which happens when they
are on the disk; the server repeats its own until the page has them. A numbered message of the page has a time of its
own, later than the one before, so that the log's last time shows what is in it. A stream outlives its sockets: a gap is
an error, since a socket keeps its order. Key positions are `KeyboardEvent.code`; one unknown to us is `code_...`.
"""

import struct
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Generic, Literal, TypeVar
from urllib.parse import urlsplit

import msgspec
from msgspec import Meta

from minihuman.errors import MinihumanError
from minihuman.experiment.keys import DIGITS, FUNCTION, LETTERS, PAD_AXES

KEY_CODES: Mapping[str, str] = (
    {f"Digit{digit}": digit for digit in DIGITS}
    | {f"Key{letter.upper()}": letter for letter in LETTERS}
    | {f"Numpad{digit}": f"kp_{digit}" for digit in DIGITS}
    | {name.upper(): name for name in FUNCTION}
    | {f"Arrow{name.capitalize()}": name for name in ("up", "down", "left", "right")}
    | {"NumpadEnter": "kp_enter", "NumpadAdd": "kp_plus", "NumpadSubtract": "kp_minus"}
    | {"NumpadMultiply": "kp_multiply", "NumpadDivide": "kp_divide", "NumpadDecimal": "kp_period"}
    | {"Space": "space", "Enter": "enter", "Escape": "escape", "Tab": "tab", "Backspace": "backspace"}
    | {"Insert": "insert", "Delete": "delete", "Home": "home", "End": "end"}
    | {"PageUp": "page_up", "PageDown": "page_down"}
    | {"Minus": "minus", "Equal": "equals", "BracketLeft": "left_bracket", "BracketRight": "right_bracket"}
    | {"Backslash": "backslash", "Semicolon": "semicolon", "Quote": "quote", "Backquote": "grave"}
    | {"Comma": "comma", "Period": "period", "Slash": "slash"}
    | {"ShiftLeft": "left_shift", "ShiftRight": "right_shift", "ControlLeft": "left_ctrl"}
    | {"ControlRight": "right_ctrl", "AltLeft": "left_alt", "AltRight": "right_alt"}
    | {"CapsLock": "caps_lock", "NumLock": "num_lock"}
)

MESSAGE_VERSION = 6
MAX_PAGE_MESSAGE_BYTES = 16 * 1024  # of a message of the page's
_PICTURE = struct.Struct("<IIBBHH")  # stream number, picture number, encoding, spare, width, height
_PART = struct.Struct("<BI")  # of several messages in one: 0 for text and 1 for a picture, bytes

Ns = Annotated[int, Meta(ge=0, le=2**53)]
Number = Annotated[int, Meta(ge=0, le=2**31)]
ShortText = Annotated[str, Meta(max_length=64)]
LongText = Annotated[str, Meta(max_length=2000)]
KeyName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_]{1,32}$")]
Digest = Annotated[str, Meta(pattern=r"^([0-9a-f]{16})?$")]
Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]


class MessageError(MinihumanError, ValueError):
    """A message that our page never sends."""


class KeyMessage(msgspec.Struct, tag="key", tag_field="t", forbid_unknown_fields=True):
    """A key went down or came up at ``stamp``, by the event's own time."""

    key: KeyName
    down: bool
    stamp: Ns
    symbol: ShortText = ""
    repeat: bool = False
    trusted: bool = True  # False: a script made it, no keyboard
    # of the step that the page made by itself, 16 hexadecimal digits; "" where it made none
    digest: Digest = ""


class DisplayedMessage(msgspec.Struct, tag="shown", tag_field="t", forbid_unknown_fields=True):
    """A screen, or in an episode a step's picture, reached the display."""

    submit: Ns
    flip: Ns
    screen: Number = 0  # as the server numbered it; 0: the page went there ahead of it
    name: Ns = 0  # of the screen that the page went to
    episode: int = -1
    step: int = -1
    node: int = -1


class TickMessage(msgspec.Struct, tag="tick", tag_field="t", forbid_unknown_fields=True):
    """The time came at which the session asked for a tick."""

    digest: Digest = ""  # as a key's


class TextMessage(msgspec.Struct, tag="typed", tag_field="t", forbid_unknown_fields=True):
    """The keyboard's layout or the input method made text."""

    text: LongText


class PointerMessage(msgspec.Struct, tag="pointer", tag_field="t", forbid_unknown_fields=True):
    """Mouse or finger, at ``stamp``, by the event's own time."""

    what: Literal["pressed", "moved", "released"]
    x: Fraction
    y: Fraction
    target: ShortText = ""
    along: Fraction = 0.0
    stamp: Ns = 2**53  # none: pages of before, which did not tell


class AxisMessage(msgspec.Struct, tag="axis", tag_field="t", forbid_unknown_fields=True):
    """An axis of a gamepad moved, at ``stamp``, by the gamepad's own time."""

    axis: Literal[PAD_AXES]  # type: ignore[valid-type]
    value: Annotated[float, Meta(ge=-1.0, le=1.0)]
    stamp: Ns = 2**53


class GamepadMessage(msgspec.Struct, tag="pad", tag_field="t", forbid_unknown_fields=True):
    """A gamepad was seen for the first time."""

    id: ShortText
    axes: Number
    buttons: Number


class FocusMessage(msgspec.Struct, tag="focus", tag_field="t", forbid_unknown_fields=True):
    """The page lost or found the keyboard, or was hidden or seen again."""

    focused: bool


class RoundTripMessage(msgspec.Struct, tag="link", tag_field="t", forbid_unknown_fields=True):
    """The quickest of the latest messages there and back: its ends by the page's clock, in between the server's."""

    sent: Ns
    received: int
    answered: int
    back: Ns
    latest: Ns  # how long the last one took


class CommandEcho(msgspec.Struct, tag="asked", tag_field="t", forbid_unknown_fields=True):
    """The experimenter's command reached the page, at the message's time."""

    number: Number


class LateInputMessage(msgspec.Struct, tag="unheard", tag_field="t", forbid_unknown_fields=True):
    """Inputs of a segment that had ended before the server received them."""

    text: LongText


PageMessage = (
    KeyMessage
    | DisplayedMessage
    | TickMessage
    | TextMessage
    | PointerMessage
    | AxisMessage
    | GamepadMessage
    | FocusMessage
    | RoundTripMessage
    | CommandEcho
    | LateInputMessage
)


class Hello(msgspec.Struct, tag="hello", tag_field="t", forbid_unknown_fields=True):
    """The first message on every socket."""

    version: int
    token: Annotated[str, Meta(max_length=200)] = ""
    platform: Annotated[dict[ShortText, Annotated[str, Meta(max_length=200)]], Meta(max_length=12)] = {}
    stream: ShortText = ""  # names the page's numbering; another after each reload
    first: Number = 1  # the first message that was not acknowledged
    life: ShortText = ""  # the server's numbering that the page follows; "" after a reload
    heard: Number = 0  # the last message of that numbering that it has
    segment: ShortText = ""  # the segment that its times belong to
    last: Ns = 0  # its last time
    kernels: ShortText = ""  # the digest of the worlds' rules that it has compiled; "" for none
    facts: Annotated[dict[ShortText, bool | float | Annotated[str, Meta(max_length=200)]], Meta(max_length=40)] = {}


class NumberedMessage(msgspec.Struct, tag="n", tag_field="t", forbid_unknown_fields=True):
    """A message of the page's stream."""

    n: Annotated[int, Meta(ge=1, le=2**31)]
    at: Annotated[int, Meta(ge=1, le=2**53)]
    what: PageMessage


class PageAck(msgspec.Struct, tag="heard", tag_field="t", forbid_unknown_fields=True):
    """The page has all of the server's messages up to this."""

    n: Number


class Ping(msgspec.Struct, tag="ping", tag_field="t", forbid_unknown_fields=True):
    """Ask for the server's time."""

    sent: Ns


_FROM_PAGE = msgspec.json.Decoder(Hello | NumberedMessage | PageAck | Ping)
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


def decode_page_message(text: str | bytes) -> Hello | NumberedMessage | PageAck | Ping:
    """A message of the page's.

    Raises:
        MessageError: if it is none, or over its limits.
    """
    if len(text) > MAX_PAGE_MESSAGE_BYTES:
        raise MessageError(
            f"a message has {len(text)} bytes; at most {MAX_PAGE_MESSAGE_BYTES} are allowed; reload the page"
        )
    try:
        if text[:1] in ("[", b"["):
            return _expand(_SHORT.decode(text))
        message: Hello | NumberedMessage | PageAck | Ping = _FROM_PAGE.decode(text)
        return message
    except (msgspec.DecodeError, LookupError, TypeError, ValueError, RecursionError) as error:
        raise MessageError(f"a message from a page cannot be decoded ({error}); reload the page") from error


def _expand(short: Any) -> NumberedMessage:
    at_ns, kind = 1000 * short.at, type(short)
    if kind is _Tick:
        return NumberedMessage(short.n, at_ns, TickMessage(short.digest))
    if (short.ago if kind is _Press else max(short.flip, short.submit)) > short.at:
        raise ValueError("a time is before the session's start")
    if kind is _Press:
        stamp_ns = at_ns - 1000 * short.ago
        what = KeyMessage(short.key, short.down == 1, stamp_ns, short.symbol, short.repeat, digest=short.digest)
        return NumberedMessage(short.n, at_ns, what)
    flip_ns, submit_ns = at_ns - 1000 * short.flip, at_ns - 1000 * short.submit
    shown = DisplayedMessage(submit_ns, flip_ns, episode=short.episode, step=short.step, node=short.node)
    return NumberedMessage(short.n, at_ns, shown)


class Welcome(msgspec.Struct, tag="welcome", tag_field="t"):
    """The answer to a hello: whose turn it is in both streams, and the session's time."""

    segment: str
    life: str  # names the server's numbering
    again: bool  # the stream resumes; else it starts anew
    heard: int  # the last of the page's messages that was taken
    now: int  # the session's time, about
    keys: dict[str, str]  # a browser's name of a key's place -> ours
    touch: dict[str, str]  # our name of each key that the study is played with -> what a button for it says
    token: str  # of a link made just now, to come back by; "" if the page had one
    words: dict[str, str]  # what the page says around a session
    taken: int  # the time of the last of the page's messages that the session has: it may not be acknowledged
    gamepad: bool  # whether the study is played with one


class Refusal(msgspec.Struct, tag="refused", tag_field="t"):
    """The server refuses the page, which does not come again by itself."""

    reason: str
    words: str  # what the page says
    leave: str = ""  # the words of the link back
    url: str = ""  # to where the visitor was recruited; "": nowhere


class ServerAck(msgspec.Struct, tag="acked", tag_field="t"):
    """All of the page's messages up to this are on the disk."""

    through: int


class Pong(msgspec.Struct, tag="pong", tag_field="t"):
    """The answer to a ping, by the server's clock."""

    sent: int
    received: int
    answered: int


class ScreenMessage(msgspec.Struct, tag="screen", tag_field="t"):
    """A screen, as `drawn` makes it."""

    id: int
    through: int  # the page's messages that led to it
    at: int  # the session's time then
    tick: int | None  # when the session wants a tick
    screen: dict[str, Any]
    name: int = 0  # of what is shown, and where in the session


class PrefetchedScreen(msgspec.Struct):
    """A screen that an input may lead to."""

    name: int
    screen: dict[str, Any]
    after: int | None  # ns from the input until the session wants a tick
    episode: int = -1  # that begins with it
    scene: int = -1  # in which it begins


class ScreenPrefetch(msgspec.Struct, tag="onward", tag_field="t"):
    """What would come outside of episodes: screens, and which input leads from one to another."""

    screens: list[PrefetchedScreen]
    edges: list[tuple[int, str, int]]  # screen, "key:enter", "point:go_on" or "tick", screen


class FilmFrame(msgspec.Struct, tag="frame", tag_field="t"):
    """A picture of the film on the screen, drawn since the screen was sent."""

    name: int  # of the screen
    side: int  # which of its films
    place: int  # in it
    picture: int


class GridPosition(msgspec.Struct, tag="grid", tag_field="world"):
    """Where a grid world is after a step."""

    step: int
    row: list[int]  # a number and how often it comes, and so on
    rng_state: list[str]  # six whole numbers of 64 bits


class GridState(GridPosition, tag="grid", tag_field="world"):
    """A grid world's state, for the page to compute the steps that follow it."""

    view_size: int
    full: bool  # the picture is of the whole world
    in_view: bool  # and drawn as Minigrid draws it
    atlas: str  # the name of its tiles


class FirstPersonPosition(msgspec.Struct, tag="first_person", tag_field="world"):
    """Where a first-person world is after a step; arrays are little-endian."""

    step: int
    things: bytes
    numbers: bytes
    rng_state: list[str]


class FirstPersonState(FirstPersonPosition, tag="first_person", tag_field="world"):
    """A first-person world's state, for the page to compute the steps that follow it."""

    walls: bytes
    rooms: bytes
    edges: bytes
    looks: int  # things of its scene
    scene: str  # the name of its tables
    textures: list[str]  # the names of the textures
    size: tuple[int, int]  # of the picture, pixels


WorldState = GridState | FirstPersonState
WorldPosition = GridPosition | FirstPersonPosition


class EpisodeRules(msgspec.Struct, tag="rules", tag_field="t"):
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
    computed: WorldState | None = None  # where the page computes it; else scenes are sent ahead
    motion: float = 0.0  # ms from a picture that the page computes to the next
    team: Literal["", "turns", "ticks"] = ""  # whose joint steps the server closes


class ArraysMessage(msgspec.Struct, tag="arrays", tag_field="t"):
    """Tiles of grid worlds, a first-person scene or a texture, for the page to keep under their name, a digest."""

    name: str
    arrays: list[tuple[str, str, int]]  # name, NumPy's name of its numbers, bytes
    packed: bytes  # all of them, by zlib


class StateCorrection(msgspec.Struct, tag="state", tag_field="t"):
    """Where the session is in an episode that the page computes, which may be elsewhere."""

    through: int
    episode: int
    state: WorldPosition


class EpisodeState(msgspec.Struct, tag="now", tag_field="t"):
    """Where the session stands in an episode."""

    through: int
    tick: int | None
    episode: int = -1
    step: int = -1
    node: int = -1
    who: str = ""  # steers, "agent" or "person"; "" where an agent never does
    action: int = -1  # that the agent makes next, unless the person takes over; a team's: own, of a step that is open
    limit: int | None = None  # beside an agent: from when on keys do nothing
    pace: int = 0  # ns that a step has taken the server lately


class AgentControl(msgspec.Struct, tag="beside", tag_field="t"):
    """An agent plays an episode: what keys and time do then, and the texts below the picture."""

    episode: int
    period: int  # ns from the picture of one of its steps to the next step
    takes_over: bool  # by a key that has an action
    hand_back: str  # the key; "" where control cannot be handed back
    good: str  # the keys that rate it; "" where it is not rated
    bad: str
    flash: int  # ns that such a press is seen
    apart: int  # ns in which a held key counts once
    controller_texts: dict[str, str]  # controller -> text


class LookAheadUpdate(msgspec.Struct, tag="ahead", tag_field="t"):
    """What would come: scenes with their pictures, and which action leads from one to another."""

    episode: int
    nodes: list[tuple[int, int]]  # scene, picture
    edges: list[tuple[int, int, int, bool]]  # scene, action, scene, whether the episode ends by it


class CommandMessage(msgspec.Struct, tag="ask", tag_field="t"):
    """The experimenter asks for something; the page says when that was."""

    number: int


class SessionOver(msgspec.Struct, tag="over", tag_field="t"):
    """The session's log is on the disk; where to go from here."""

    end: str
    words: str
    your_code: str  # what stands before the code
    code: str  # "" for none
    leave: str  # what leads to the address
    url: str  # "" for none


class PictureMessage(msgspec.Struct, frozen=True):
    """A picture, for the page to keep under its number."""

    number: int
    encoding: int  # 0: zlib of RGB, 1: JPEG, 2: the numbers of its tiles, uint32, row by row
    width: int
    height: int
    data: bytes


ServerMessage = (
    ScreenMessage
    | FilmFrame
    | ArraysMessage
    | EpisodeRules
    | StateCorrection
    | AgentControl
    | EpisodeState
    | LookAheadUpdate
    | ScreenPrefetch
    | CommandMessage
    | SessionOver
)
_ENCODER = msgspec.json.Encoder()


class _NumberedServerMessage(msgspec.Struct):
    n: int
    m: ServerMessage


def encode_numbered(number: int, message: ServerMessage | PictureMessage) -> bytes:
    """A message of the server's stream, as part of a batch."""
    if isinstance(message, PictureMessage):
        head = _PICTURE.pack(number, message.number, message.encoding, 0, message.width, message.height)
        return _PART.pack(1, len(head) + len(message.data)) + head + message.data
    return encode_text(_NumberedServerMessage(number, message))


def encode_unnumbered(message: Welcome | Refusal | Pong) -> str:
    """A message beside the stream."""
    return _ENCODER.encode(message).decode()


def encode_text(message: _NumberedServerMessage | ServerAck | Pong) -> bytes:
    """A message as the bytes of a text, to be sent together with others."""
    text = _ENCODER.encode(message)
    return _PART.pack(0, len(text)) + text


Message = TypeVar("Message")


class OutgoingStream(Generic[Message]):
    """This side's messages, from 1 on."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, Message]] = deque()
        self.last_number = 0  # of the last message

    @property
    def kept(self) -> int:
        """How many messages are not acknowledged yet."""
        return len(self._kept)

    def add(self, message: Message) -> None:
        """Number a message and keep it until it is acknowledged."""
        self.last_number += 1
        self._kept.append((self.last_number, message))

    def acknowledge(self, number: int) -> None:
        """Forget the messages up to a number: the other side has them.

        Raises:
            MessageError: if that number was never sent.
        """
        if number > self.last_number:
            raise MessageError(
                f"message {number} was acknowledged, but the last one sent is {self.last_number}; reload the page"
            )
        while self._kept and self._kept[0][0] <= number:
            self._kept.popleft()

    def after(self, number: int) -> Iterator[tuple[int, Message]]:
        """The kept messages behind a number."""
        return (kept for kept in tuple(self._kept) if kept[0] > number)


class IncomingStream:
    """The other side's messages, received up to a number."""

    def __init__(self, received: int = 0) -> None:
        self.received = received

    def take(self, number: int) -> bool:
        """Whether a message is new.

        Raises:
            MessageError: if one before it is missing.
        """
        if number > self.received + 1:
            raise MessageError(
                f"message {number} arrived after message {self.received}; the messages in between are missing; reload "
                "the page"
            )
        new = number == self.received + 1
        self.received = max(self.received, number)
        return new


MAX_MESSAGE_BYTES = 16 * 1024
MESSAGES_PER_S = 200.0  # 60 steps a second with their pictures and keys are some 150
MESSAGE_BURST = 200
HELLO_TIMEOUT_S = 10.0  # a socket without a hello by then is closed
MAX_TARGET_BYTES = 2_048  # of a request's path and query
MAX_WAITING = 200  # sockets without a hello
PREFETCH_BACKLOG = 300  # unacknowledged messages above which nothing is prefetched
MAX_BACKLOG = 3_000  # and above which the page starts anew

_POLICY = (  # nothing from anywhere else; blob: is for pictures that came over the socket, wasm for the worlds' rules
    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; img-src 'self' blob: data:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: tuple[tuple[str, str], ...] = (
    ("content-security-policy", _POLICY),
    ("cross-origin-opener-policy", "same-origin"),  # these three make clocks of 5 µs of 100
    ("cross-origin-embedder-policy", "require-corp"),
    ("cross-origin-resource-policy", "same-origin"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("permissions-policy", "camera=(), microphone=(), geolocation=()"),
    ("cache-control", "no-store"),
)


@dataclass(slots=True)
class RateLimit:
    """How many messages a socket may still send: a rate per second, and a burst."""

    now_s: float  # of the last message
    left: float = MESSAGE_BURST

    def take(self, now_s: float) -> bool:
        """Whether a message that comes now is within it."""
        self.left = min(MESSAGE_BURST, self.left + (now_s - self.now_s) * MESSAGES_PER_S)
        self.now_s = now_s
        if self.left < 1:
            return False
        self.left -= 1
        return True


def is_same_origin(origin: str | None, host: str | None) -> bool:
    """Whether a socket's Origin is the page that this server gave: the same host and port.

    A proxy in front hands both on as the browser sent them.
    """
    if not origin or not host:
        return False
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower() and not parts.path
