"""Events: everything that a session reports. The recorder logs each event; `event_rules` checks their order.

Times are integer nanoseconds on the monotonic clock since the session's segment started.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from minihuman.experiment.plan.session_plan import EpisodePlan, KeyMap, SessionPlan
from minihuman.moved import forward_names
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose

Outcome = Literal["goal", "timeout", "failure", "abandoned", "agent_failed", "ended"]
KeyVerdict = Literal[
    "accepted",  # it made a step of the world, or moved the session on
    "unmapped",  # it has no meaning here
    "spare",  # it is in the key pool, but has no action
    "repeat",  # the system's auto-repeat, where it does not count
    "queued",  # in real time: its action waits for the next tick
    "not_playing",  # it has a meaning, but the session took no actions, as in a pause or during feedback
    "release",  # a key came up
    "typing",  # it types into a text, which TextTyped reports
    "held_before_focus",  # it was down before the window had the focus, so nobody pressed it here
    "shortcut",  # Ctrl, Alt or Meta was down: the system's or the browser's
    "release_at_focus_loss",  # the window lost the focus with the key down; when the finger left it is unknown
]
PointerUse = Literal[
    "pressed",
    "moved",
    "released",
    "held_before_focus",  # pressed before the window had the focus: the click that brought it
    "cancelled",  # a release that no finger made
]
UNPRESSED_VERDICTS = ("repeat", "held_before_focus", "shortcut")  # of key events that are no press for this task
EndCause = Literal["", "max_s", "block_max_s", "agent_failed", "partner_left"]  # "" if a step ended the episode
ModelCallState = Literal[
    "asked",
    "answered",
    "failed",  # the server or the network gave no answer
    "unknown",  # the program was killed before an answer was stored; counted as paid
]
ModelVerdict = Literal["", "valid", "invalid"]
SkipReason = Literal["criterion", "time", "design", "given_up", "partner_left", "no_partner", "replaced"]
PartEnd = Literal["done", "failed", "again", "over"]
PauseReason = Literal["participant", "focus_lost", "quit_question", "abort_question", "experimenter"]
EndReason = Literal[
    "complete",
    "screened_out",
    "declined",  # consent was refused: nothing is on the disk, unless the consent came after play
    "aborted",
    "quit",
    "window_closed",
    "signal",
    "timed_out",  # no input for as long as the study waits
    "connection_lost",
    "disk_full",
    "world_error",
    "player_failed",  # the simulated participant crashed, or gave no answer
    "internal_error",
]

# The beginning of a note of kind "page" on a page whose clock cannot be trusted.
CLOCK_NOTE = "the page's time"
# The reasons after which a session has nothing left to do.
FINAL_END_REASONS: frozenset[str] = frozenset({"complete", "screened_out", "declined"})


@dataclass(frozen=True, slots=True)
class TimedEvent:
    """An event of a session, with its time."""

    t_ns: int


class EpisodeBeginning:
    """An event at which an episode begins: a reset, or a return to a state that an earlier episode was in."""

    __slots__ = ()
    if TYPE_CHECKING:  # an abstract class would be slow to test each event for

        @property
        def begins_at(self) -> tuple[int, int]:
            """Return the episode's index, and the step after which it begins: 0 for a reset."""


class EpisodeStep:
    """An event that is a step of the episode that began last, with the episode's index and the action's number."""

    __slots__ = ()
    if TYPE_CHECKING:

        @property
        def episode(self) -> int:
            """Return the episode's index."""

        @property
        def action(self) -> int:
            """Return the number of the action."""


class EpisodeEnding:
    """An event after which the episode that began last has no more steps."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class SessionStarted(TimedEvent):
    """The first event: the whole plan, and facts about the machine (versions, platform, display; no names)."""

    plan: SessionPlan
    facts: dict[str, str]


@dataclass(frozen=True, slots=True)
class KeyMapDrawn(TimedEvent):
    """A key map came into force."""

    episode: int
    key_map: KeyMap


@dataclass(frozen=True, slots=True)
class EpisodeStarted(TimedEvent, EpisodeBeginning):
    """The world was reset. Pose and map are None if the world does not provide them."""

    plan: EpisodePlan
    action_names: tuple[str, ...]  # the world's, by action number
    mission: str
    map: Map | None
    pose: Pose | None
    state_hash: int
    observation_hash: int
    onset: bool = False  # the first picture shows a stimulus onset

    @property
    def begins_at(self) -> tuple[int, int]:
        """Return the episode's index, and step 0, its reset."""
        return self.plan.episode, 0


@dataclass(frozen=True, slots=True)
class KeyPressed(TimedEvent):
    """A key went down or up, whether or not it has an action, with the session's verdict.

    ``t_ns`` is when the session handled the key. A press that arrives while a picture is being drawn has to wait: the
    press itself happened at ``t_ns - waited_ns``.
    """

    key: str
    symbol: str
    down: bool
    action: int | None
    verdict: KeyVerdict
    phase: str
    waited_ns: int = 0  # from the press to t_ns, where it had to wait


@dataclass(frozen=True, slots=True)
class Stepped(TimedEvent, EpisodeStep):
    """The world made a step. This is the last event of the step."""

    episode: int
    step: int  # 1 for the first
    action: int
    key: str  # the causing key, "" for a tick's no-op
    key_t_ns: int  # when that key arrived; without a key, the tick's t_ns
    reward: float
    return_: float
    terminated: bool
    truncated: bool
    pose: Pose | None
    rt_ms: float | None  # causing key minus the flip of the picture it answers; None without a key or a flip
    state_hash: int
    observation_hash: int
    onset: bool = False  # the picture after it shows a stimulus onset
    action_vector: tuple[float, ...] = ()  # the flattened action if actions are vectors; ``action`` is then its name
    success: bool | None = None  # whether the world reports success, if the outcome rule uses it; None if unknown
    info_json: str = ""  # the entries of the world's ``info`` that the plan keeps, as JSON; "" if it keeps none


@dataclass(frozen=True, slots=True, eq=False)
class ObservationStored(TimedEvent):
    """An observation of the world, if the protocol records them; it follows an episode's start or precedes its step."""

    episode: int
    step: int  # that it follows, 0 for the reset
    observation: Any  # the world's own: an array, a text, a number, or a dict or tuple of them

    def __eq__(self, other: object) -> bool:
        """Compare observations by their hash, since arrays compare element by element."""
        return isinstance(other, ObservationStored) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[int, int, int, int]:
        return (self.t_ns, self.episode, self.step, hash64(self.observation))


@dataclass(frozen=True, slots=True)
class FrameShown(TimedEvent):
    """A picture of the world reached the display."""

    episode: int
    step: int  # the step whose result it shows, 0 for the reset
    submit_ns: int
    flip_ns: int
    picture_hash: int = 0  # the picture's `hash_picture`; 0 for built-in worlds, whose pictures can be drawn again


@dataclass(frozen=True, slots=True)
class EpisodeEnded(TimedEvent, EpisodeEnding):
    """An episode ended with an outcome."""

    episode: int
    outcome: Outcome
    steps: int
    return_: float
    state_hash: int
    cause: EndCause = ""  # what ended the episode if no step did


@dataclass(frozen=True, slots=True)
class EpisodesSkipped(TimedEvent):
    """Planned episodes were skipped and will not be played."""

    first: int
    count: int
    reason: SkipReason


@dataclass(frozen=True, slots=True)
class Scored(TimedEvent):
    """An episode earned points; the event holds them and the session's total."""

    episode: int
    points: float
    total: float


@dataclass(frozen=True, slots=True)
class ClauseDone(TimedEvent):
    """A step fulfilled a clause of the episode's instruction. It precedes the event of the step."""

    episode: int
    step: int
    clause: int  # of the instruction as it is read, from 0
    text: str


@dataclass(frozen=True, slots=True)
class PartStarted(TimedEvent):
    """A part of the session began."""

    part: int  # index into the plan's parts
    kind: str
    name: str


@dataclass(frozen=True, slots=True)
class PartEnded(TimedEvent):
    """A part of the session ended; the event names the part that follows."""

    part: int
    end: PartEnd
    next: int  # index of the part that follows; one past the last part if none does


@dataclass(frozen=True, slots=True)
class PageShown(TimedEvent):
    """A page of a text reached the display."""

    part: int
    page: int  # 1 for the first
    pages: int
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class TextTyped(TimedEvent):
    """The input method or the keyboard layout produced text."""

    text: str


@dataclass(frozen=True, slots=True)
class TextChanged(TimedEvent):
    """The participant changed the text in a field: the whole text, code point for code point, once it settled."""

    part: int
    item: str  # the item's name
    text: str
    changes: tuple[str, ...] = ()  # the kinds of changes: see `TextChange` of the inputs
    keys: int = 0  # how many keys were pressed in the field; which ones is not recorded
    waited_ns: int = 0  # from the first of these changes to t_ns


@dataclass(frozen=True, slots=True)
class PointerUsed(TimedEvent):
    """A pointer went down, moved while down, or came up at ``t_ns - waited_ns``; x and y are 0 to 1 of the picture."""

    what: PointerUse
    x: float
    y: float
    target: str  # the name of the target in which the pointer went down; "" for none
    along: float  # 0 to 1 from the target's start, in reading direction
    waited_ns: int = 0  # as a key's


@dataclass(frozen=True, slots=True)
class AxisMoved(TimedEvent):
    """An axis moved at ``t_ns - waited_ns``; right and down are positive.

    A gamepad's axis is at ``value`` from then on: -1 to 1, 0 in its dead zone. The mouse moved by ``value`` pixels.
    """

    axis: str
    value: float
    waited_ns: int = 0  # as a key's


@dataclass(frozen=True, slots=True)
class AnswerChanged(TimedEvent):
    """The participant changed an answer before giving it."""

    part: int
    item: str
    value: str  # JSON


@dataclass(frozen=True, slots=True)
class Answered(TimedEvent):
    """The participant gave an answer."""

    part: int
    part_name: str
    item: str  # the item's name
    kind: str
    attempt: int  # 1 for the first time that the questions are asked
    value: str  # JSON: a code, a list of codes, a number, a text, or null if the question was skipped
    words: str  # the answer as the participant saw it: the option's text, the number
    shown_ns: int  # when the question reached the display; 0 if unknown
    first_ns: int  # when the answer was first changed; 0 if it was not
    changes: int
    right: bool | None  # whether the answer is correct; None if there is no correct answer


@dataclass(frozen=True, slots=True)
class Paused(TimedEvent):
    """Play was paused. Time in a pause is not playing time."""

    reason: PauseReason


@dataclass(frozen=True, slots=True)
class Resumed(TimedEvent):
    """Play resumed after a pause."""


@dataclass(frozen=True, slots=True)
class Noted(TimedEvent):
    """A fact logged as readable text: consent, keyboard check, focus, phase change, abort reason or error."""

    kind: str
    text: str

    @property
    def is_about_clock(self) -> bool:
        """Return whether the note says that the times of a browser's page are not reliable."""
        return self.kind == "page" and self.text.startswith(CLOCK_NOTE)


@dataclass(frozen=True, slots=True)
class Sampled(TimedEvent):
    """A device of the protocol delivered a sample, such as a gaze position, a pulse or a trigger."""

    t_ns: int  # when it was taken, so that a sample may be older than the event before it
    device: str  # the device's name in the protocol
    values: tuple[float, ...]  # one per channel, in the protocol's order; NaN for a channel without a measurement
    text: str = ""  # a measurement that is a text, such as a trigger box's code


@dataclass(frozen=True, slots=True)
class Linked(TimedEvent):
    """The offset of a browser's clock from its server's, estimated from the fastest of the latest round trips."""

    offset_ns: int  # the server's time minus the session's, both since the segment began
    error_ns: int  # the largest error of the offset, in either direction
    rtt_ns: int  # the latest round trip
    least_rtt_ns: int  # the fastest of the latest round trips
    drift_ppm: float | None  # how much faster the server's clock runs; None until it can be estimated


@dataclass(frozen=True, slots=True)
class SessionEnded(TimedEvent):
    """The last event: the session ended."""

    reason: EndReason
    detail: str
    episodes_completed: int


@dataclass(frozen=True, slots=True)
class ActivityEvent(TimedEvent):
    """An event of one kind of activity, which adds its fields.

    A field whose name ends in ``_ns`` is a session time; 0 if unknown.
    """

    @property
    def words_to_others(self) -> str:
        """Return the text that the participant wrote to other participants; "" for most kinds of events."""
        return ""


@dataclass(frozen=True, slots=True)
class DesignDecided(ActivityEvent):
    """A design decided on an episode, which resolves what the plan left open. It precedes the episode's reset."""

    part: int
    episode: int  # the next episode; after the block's last episode, one past it
    design: str  # as the protocol names it
    version: int
    options: dict[str, Any]  # the world's options beside the block's own
    seed: int | None  # of the reset; None for the plan's seed
    stop: bool  # whether the block is over, by the design or after its last episode
    estimates: dict[str, float]
    posterior: int  # 64-bit digest of the values from which the decision follows


@dataclass(frozen=True, slots=True)
class ModelCall(ActivityEvent):
    """A request to a language model was sent or answered.

    It is logged before the request is sent, and again with the answer before that has an effect. The session waits for
    the answer: both events have the screen's time, and ``latency_ms`` is how much later the answer counts.
    """

    call: int  # 1 for the session's first
    state: ModelCallState
    episode: int  # index of the episode that is played or comes next
    step: int  # the step after which the screen is shown; 0 outside episodes
    screen: str  # "play", "page" or "question"
    attempt: int  # 1, or more after an invalid answer to the same screen
    prompt_sha256: str  # of the messages, pictures by their digests
    picture_sha256: str  # of the latest picture's pixels; "" without one
    provider: str  # the protocol's label
    model: str  # the requested model's name; in an answer, the name that the server gives
    temperature: float
    max_tokens: int
    prompt_tokens: int = 0  # as the server counts them; estimated without an answer
    completion_tokens: int = 0
    price: float = 0.0  # by the protocol's prices, in its currency
    latency_ms: float = 0.0
    answer: str = ""  # the whole text
    reasoning: str = ""  # the model's reasoning, if the server reports it
    finish_reason: str = ""
    verdict: ModelVerdict = ""
    reading: str = ""  # how a valid answer was read: "key 3", "choose 2", "text ...", "wait", "skip", "button go_on"
    error: str = ""  # why there is no answer: "HTTP 429", "timeout"


Event = (
    SessionStarted
    | KeyMapDrawn
    | EpisodeStarted
    | KeyPressed
    | Stepped
    | ObservationStored
    | FrameShown
    | EpisodeEnded
    | EpisodesSkipped
    | Scored
    | ClauseDone
    | PartStarted
    | PartEnded
    | PageShown
    | TextTyped
    | TextChanged
    | PointerUsed
    | AxisMoved
    | AnswerChanged
    | Answered
    | Paused
    | Resumed
    | Noted
    | Sampled
    | Linked
    | SessionEnded
    | ActivityEvent
)


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
