"""The messages between page and server: their fields, limits and version. No I/O.

The page's types are generated from here: `python -m minihuman.web.page_types` writes `page/messages.d.ts`.

Times are nanoseconds on the session's clock. The page repeats its messages until they are acknowledged, which happens
when they are on the disk; the server repeats its messages until the page has them. Each numbered message of the page
has a time later than that of the message before it, so that the log's last time shows which messages it contains.
Physical keys are named by `KeyboardEvent.code`; a key without a name of ours is `code_...`.
"""

from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta

from minihuman.errors import MinihumanError
from minihuman.experiment.keys import MOUSE_AXES, PAD_AXES, TOUCH_AXES
from minihuman.experiment.machine.inputs import (
    MAX_FIELD_CHARACTERS,
    KeyReleaseCause,
    PointerCause,
    PressCause,
    TextChange,
)
from minihuman.experiment.machine.page_alterations import AlterationKind
from minihuman.web.held_messages import HeldInputs, HeldRules, VectorRules
from minihuman.web.screen_types import PageType, ScreenValues

MESSAGE_VERSION = 9

MAX_MOTION_PX = 4096  # of the mouse in one message
Ns = Annotated[int, Meta(ge=0, le=2**53)]
Number = Annotated[int, Meta(ge=0, le=2**31)]
ShortText = Annotated[str, Meta(max_length=64)]
LongText = Annotated[str, Meta(max_length=2000)]
FieldText = Annotated[str, Meta(max_length=MAX_FIELD_CHARACTERS)]
KeyName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_]{1,32}$")]
Digest = Annotated[str, Meta(pattern=r"^([0-9a-f]{16})?$")]
Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]
BrowserFacts = dict[ShortText, bool | float | Annotated[str, Meta(max_length=200)]]
Texts = dict[str, str]
ScreenDict = Annotated[dict[str, Any], PageType(ScreenValues)]


class MessageError(MinihumanError, ValueError):
    """A message that the study's own page never sends."""


class KeyMessage(msgspec.Struct, tag="key", tag_field="t", forbid_unknown_fields=True):
    """A press or release of a key, with the event's own time as ``stamp``."""

    key: KeyName
    down: bool
    stamp: Ns
    symbol: ShortText = ""
    repeat: bool = False
    trusted: bool = True  # False if a script made the event
    # the digest of the step that the page computed, 16 hexadecimal digits; "" if it computed none
    digest: Digest = ""
    cause: PressCause | KeyReleaseCause = "finger"


class DisplayedMessage(msgspec.Struct, tag="shown", tag_field="t", forbid_unknown_fields=True):
    """The report that a screen, or the picture of an episode's step, reached the display."""

    submit: Ns
    flip: Ns
    screen: Number = 0  # the server's number of the screen; 0 if the page showed it ahead of the server
    name: Ns = 0  # the name of a screen that the page showed ahead of the server
    episode: int = -1
    step: int = -1
    node: int = -1


class TickMessage(msgspec.Struct, tag="tick", tag_field="t", forbid_unknown_fields=True):
    """A tick at the time that the session asked for."""

    digest: Digest = ""  # as in ``KeyMessage``


class TextMessage(msgspec.Struct, tag="typed", tag_field="t", forbid_unknown_fields=True):
    """Text produced by the keyboard layout or the input method."""

    text: LongText


class FieldMessage(msgspec.Struct, tag="field", tag_field="t", forbid_unknown_fields=True):
    """The whole text of a field, after changes that began at ``began``."""

    text: FieldText
    name: Annotated[str, Meta(max_length=200)]  # the field's
    changes: Annotated[tuple[TextChange, ...], Meta(max_length=len(get_args(TextChange)))] = ()
    keys: Number = 0  # pressed in the field for it
    began: Ns = 2**53  # the default stands for the message's time


class PointerMessage(msgspec.Struct, tag="pointer", tag_field="t", forbid_unknown_fields=True):
    """A press, movement or release of the mouse or a finger, with the event's own time as ``stamp``."""

    what: Literal["pressed", "moved", "released"]
    x: Fraction
    y: Fraction
    target: ShortText = ""
    along: Fraction = 0.0
    stamp: Ns = 2**53  # the default stands for none, as from pages of earlier versions
    cause: PointerCause = "finger"


class AxisMessage(msgspec.Struct, tag="axis", tag_field="t", forbid_unknown_fields=True):
    """A movement of an axis of a gamepad or of a stick on the screen, with its own time as ``stamp``."""

    axis: Literal[PAD_AXES + TOUCH_AXES]  # type: ignore[valid-type]
    value: Annotated[float, Meta(ge=-1.0, le=1.0)]
    stamp: Ns = 2**53


class MouseMotionMessage(msgspec.Struct, tag="motion", tag_field="t", forbid_unknown_fields=True):
    """A motion of the captured mouse, in whole pixels to the right or down, with the event's own time as ``stamp``."""

    axis: Literal[MOUSE_AXES]  # type: ignore[valid-type]
    pixels: Annotated[int, Meta(ge=-MAX_MOTION_PX, le=MAX_MOTION_PX)]
    stamp: Ns = 2**53


class GamepadMessage(msgspec.Struct, tag="pad", tag_field="t", forbid_unknown_fields=True):
    """The report that a gamepad was detected for the first time."""

    id: ShortText
    axes: Number
    buttons: Number


class FocusMessage(msgspec.Struct, tag="focus", tag_field="t", forbid_unknown_fields=True):
    """The report that the page lost or gained the keyboard focus, or was hidden or shown again."""

    focused: bool


class RoundTripMessage(msgspec.Struct, tag="link", tag_field="t", forbid_unknown_fields=True):
    """The fastest of the latest round trips: its ends by the page's clock, the times in between by the server's."""

    sent: Ns
    received: int
    answered: int
    back: Ns
    latest: Ns  # the duration of the latest round trip


class SoundMessage(msgspec.Struct, tag="sound", tag_field="t", forbid_unknown_fields=True):
    """The report that a sound began, by the sound device's clock."""

    cue: Ns
    scheduled: Ns
    onset: Ns
    uncertainty: Ns  # of the onset


class CommandEcho(msgspec.Struct, tag="asked", tag_field="t", forbid_unknown_fields=True):
    """The report that the experimenter's command reached the page, at the message's time."""

    number: Number


class LateInputMessage(msgspec.Struct, tag="unheard", tag_field="t", forbid_unknown_fields=True):
    """Inputs of a segment that had ended before the server received them."""

    text: LongText


class PageAlteration(msgspec.Struct, tag="altered", tag_field="t", forbid_unknown_fields=True):
    """The report that a browser, an extension or a setting changed what the page shows, or how it is used."""

    what: AlterationKind
    detail: ShortText = ""  # such as the language of a translation


PageMessage = (
    KeyMessage
    | DisplayedMessage
    | TickMessage
    | TextMessage
    | FieldMessage
    | PointerMessage
    | AxisMessage
    | MouseMotionMessage
    | GamepadMessage
    | FocusMessage
    | RoundTripMessage
    | SoundMessage
    | CommandEcho
    | LateInputMessage
    | PageAlteration
)


TransportName = Literal["websocket", "http"]  # by what a page speaks


class Hello(msgspec.Struct, tag="hello", tag_field="t", forbid_unknown_fields=True):
    """The page's first message on every socket."""

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
    facts: Annotated[BrowserFacts, Meta(max_length=40)] = {}


class NumberedMessage(msgspec.Struct, tag="n", tag_field="t", forbid_unknown_fields=True):
    """A numbered message of the page's stream."""

    n: Annotated[int, Meta(ge=1, le=2**31)]
    at: Annotated[int, Meta(ge=1, le=2**53)]
    what: PageMessage


class PageAck(msgspec.Struct, tag="heard", tag_field="t", forbid_unknown_fields=True):
    """The acknowledgement that the page has all of the server's messages up to ``n``."""

    n: Number


class Ping(msgspec.Struct, tag="ping", tag_field="t", forbid_unknown_fields=True):
    """A request for the server's time."""

    sent: Ns
    acted: bool = False  # something was typed since the last one, which settles later


class Farewell(msgspec.Struct, tag="bye", tag_field="t", forbid_unknown_fields=True):
    """The report that the page is being closed, or gives way to another page."""

    left: bool  # for another page


class Welcome(msgspec.Struct, tag="welcome", tag_field="t"):
    """The answer to a hello: where both message streams stand, and the session's time."""

    segment: str
    life: str  # names the server's numbering
    again: bool  # the stream resumes; else it starts anew
    heard: int  # the last of the page's messages that was taken
    now: int  # the session's time, about
    keys: Texts  # a browser's name of a key's place -> ours
    touch: Texts  # our name of each key that the study is played with -> what a button for it says
    token: str  # of a link made just now, to come back by; "" if the page had one
    words: Texts  # what the page says around a session
    taken: int  # the time of the last of the page's messages that the session has, acknowledged or not
    gamepad: bool  # whether the study is played with one
    sign_ms: int  # the longest time in which the page sends nothing
    sounds: list[str] = []  # the digests of the session's sounds


class Refusal(msgspec.Struct, tag="refused", tag_field="t"):
    """The server's refusal of a page, which does not reconnect by itself."""

    reason: str
    words: str  # what the page says
    leave: str = ""  # the words of the link back
    url: str = ""  # to where the visitor was recruited; "": nowhere


class ServerAck(msgspec.Struct, tag="acked", tag_field="t"):
    """The acknowledgement that all of the page's messages up to ``through`` are on the disk."""

    through: int


class Pong(msgspec.Struct, tag="pong", tag_field="t"):
    """The answer to a ping, with times by the server's clock."""

    sent: int
    received: int
    answered: int


class ScreenSound(msgspec.Struct):
    """A sound that begins with a screen."""

    cue: int  # its number in the session
    digest: str


class ScreenMessage(msgspec.Struct, tag="screen", tag_field="t"):
    """A screen of the session, as values for the page."""

    id: int
    through: int  # the page's messages that led to it
    at: int  # the session's time then
    tick: int | None  # when the session wants a tick
    screen: ScreenDict
    name: int = 0  # of what is shown, and where in the session
    sounds: list[ScreenSound] = []  # of a screen whose kind does not play its own


class PrefetchedScreen(msgspec.Struct):
    """A screen to which an input may lead."""

    name: int
    screen: ScreenDict
    after: int | None  # ns from the input until the session wants a tick
    episode: int = -1  # that begins with it
    scene: int = -1  # in which it begins


class ScreenPrefetch(msgspec.Struct, tag="onward", tag_field="t"):
    """Screens outside of episodes that may come next, and the inputs that lead from one to another."""

    screens: list[PrefetchedScreen]
    edges: list[tuple[int, str, int]]  # screen, "key:enter", "point:go_on" or "tick", screen


class FilmFrame(msgspec.Struct, tag="frame", tag_field="t"):
    """A picture of a film on the screen, drawn after the screen was sent."""

    name: int  # of the screen
    side: int  # which of its films
    place: int  # the picture's place in the film
    picture: int


class GridPosition(msgspec.Struct, tag="grid", tag_field="world"):
    """The position of a grid world after a step."""

    step: int
    row: list[int]  # run lengths: each number, followed by how often it is repeated
    rng_state: list[str]  # six whole numbers of 64 bits


class GridState(GridPosition, tag="grid", tag_field="world"):
    """A grid world's state, from which the page computes the steps that follow."""

    view_size: int
    full: bool  # the picture is of the whole world
    in_view: bool  # and drawn as Minigrid draws it
    atlas: str  # the name of its tiles


class FirstPersonPosition(msgspec.Struct, tag="first_person", tag_field="world"):
    """The position of a first-person world after a step; arrays are little-endian."""

    step: int
    things: bytes
    numbers: bytes
    rng_state: list[str]


class FirstPersonState(FirstPersonPosition, tag="first_person", tag_field="world"):
    """A first-person world's state, from which the page computes the steps that follow."""

    walls: bytes
    rooms: bytes
    edges: bytes
    looks: int  # things of its scene
    scene: str  # the name of its tables
    textures: list[str]  # the names of the textures
    size: tuple[int, int]  # of the picture, pixels
    n_actions: int  # that are not moves of another kind
    uses: list[int]  # the action of each value of the component "use", from 1


WorldState = GridState | FirstPersonState
WorldPosition = GridPosition | FirstPersonPosition


JointPace = Literal["", "turns", "ticks"]


class EpisodeRules(msgspec.Struct, tag="rules", tag_field="t"):
    """The effects of keys and time in the current episode, which let the page go ahead of the session."""

    episode: int
    actions: dict[str, int]  # key -> action
    real_time: bool
    period: int
    noop: int | None
    auto_repeat: bool
    most_steps: int
    held: bool  # whether the last picture stays for a while
    keep: int  # pictures before this number are no longer needed, except those on a screen
    computed: WorldState | None = None  # where the page computes it; else scenes are sent ahead
    motion: float = 0.0  # ms from a picture that the page computes to the next
    team: JointPace = ""  # whose joint steps the server closes
    vectors: VectorRules | None = None  # where the page computes vectors
    combines: HeldRules | None = None  # where the page computes, and held keys combine


class ArraysMessage(msgspec.Struct, tag="arrays", tag_field="t"):
    """Arrays that the page keeps under a name, their digest: grid tiles, a first-person scene or a texture."""

    name: str
    arrays: list[tuple[str, str, int]]  # name, NumPy's name of its numbers, bytes
    packed: bytes  # all of them, by zlib


class StateCorrection(msgspec.Struct, tag="state", tag_field="t"):
    """The session's position in an episode that the page computes, from which the page may have diverged."""

    through: int
    episode: int
    state: WorldPosition
    inputs: HeldInputs | None = None  # where held keys combine


class EpisodeState(msgspec.Struct, tag="now", tag_field="t"):
    """The session's current state in an episode."""

    through: int
    tick: int | None
    episode: int = -1
    step: int = -1
    node: int = -1
    who: str = ""  # the controller, "agent" or "person"; "" in an episode that no agent plays
    action: int = -1  # the agent's next action, unless the person takes over; in a team, the own action of an open step
    limit: int | None = None  # in an agent's episode, the time from which keys have no effect
    pace: int = 0  # ns that the server has taken for a step lately


class AgentControl(msgspec.Struct, tag="beside", tag_field="t"):
    """The controls of an episode that an agent plays: the effects of keys and time, and the texts below the picture."""

    episode: int
    period: int  # ns from the picture of one of its steps to the next step
    takes_over: bool  # by a key that has an action
    hand_back: str  # the key; "" where control cannot be handed back
    good: str  # the keys that rate it; "" where it is not rated
    bad: str
    flash: int  # ns for which a rating is shown
    apart: int  # the shortest time between two presses of a held key that count, in ns
    controller_texts: Texts  # controller -> text


class LookAheadUpdate(msgspec.Struct, tag="ahead", tag_field="t"):
    """Scenes that may come next, with their pictures, and the actions that lead from one to another."""

    episode: int
    nodes: list[tuple[int, int]]  # scene, picture
    edges: list[tuple[int, int, int, bool]]  # scene, action, scene, whether the episode ends by it


class CommandMessage(msgspec.Struct, tag="ask", tag_field="t"):
    """The experimenter's command; the page answers with the time at which it arrived."""

    number: int


class SessionOver(msgspec.Struct, tag="over", tag_field="t"):
    """The end of a session whose log is on the disk, and the address to which the participant goes next."""

    end: str
    words: str
    your_code: str  # what stands before the code
    code: str  # "" for none
    leave: str  # what leads to the address
    url: str  # "" for none


class PictureMessage(msgspec.Struct, frozen=True):
    """A picture that the page keeps under its number."""

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
