"""Events: everything a session says happened. The recorder writes each; nothing else is truth.

Times are integer ns on the monotonic clock since the session (segment) started.
"""

from dataclasses import dataclass
from typing import Any, Literal

from minihuman.study.plan import EpisodePlan, KeyMap, SessionPlan
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose

Outcome = Literal["goal", "timeout", "failure", "abandoned"]
Verdict = Literal[
    "accepted",  # it stepped the world, or moved the session on
    "unmapped",  # no meaning here
    "spare",  # in the pool, without an action, ignored
    "repeat",  # the system's auto-repeat, not asked for
    "queued",  # real_time: replaces or waits for the tick's action
    "not_playing",  # the session was not taking actions (paused, feedback, ...)
    "release",  # a key came up
    "typing",  # it types into a text; what it typed is TextTyped
]
EndCause = Literal["", "max_s", "block_max_s"]  # what else than a step ended an episode
SkipReason = Literal["criterion", "time", "given_up"]
PartEnd = Literal["done", "failed", "again", "over"]
PauseReason = Literal["participant", "focus_lost", "quit_question", "abort_question", "experimenter"]
EndReason = Literal[
    "complete",
    "screened_out",
    "declined",  # did not agree: nothing of it is on the disk, unless the consent came after play
    "aborted",
    "quit",
    "window_closed",
    "signal",
    "timed_out",  # nobody was there for as long as the study waits
    "connection_lost",
    "disk_full",
    "world_error",
    "internal_error",
]

SETTLED: frozenset[str] = frozenset({"complete", "screened_out", "declined"})  # ends after which nothing is left to do


@dataclass(frozen=True, slots=True)
class SessionStarted:
    """The first event: the whole plan, and the machine's facts (versions, platform, display; no names)."""

    t_ns: int
    plan: SessionPlan
    facts: dict[str, str]


@dataclass(frozen=True, slots=True)
class KeyMapDrawn:
    """A key map comes into force."""

    t_ns: int
    episode: int
    key_map: KeyMap


@dataclass(frozen=True, slots=True)
class EpisodeStarted:
    """The world was reset. Pose and map are None where the world cannot tell."""

    t_ns: int
    plan: EpisodePlan
    action_names: tuple[str, ...]  # the world's, by action number
    mission: str
    map: Map | None
    pose: Pose | None
    state_hash: int
    observation_hash: int


@dataclass(frozen=True, slots=True)
class KeyPressed:
    """A key went down or up, mapped or not, and what came of it.

    ``t_ns`` is when the session took it. A press that comes while a picture is being drawn waits for it: the press
    itself was at ``t_ns - waited_ns``.
    """

    t_ns: int
    key: str
    symbol: str
    down: bool
    action: int | None
    verdict: Verdict
    phase: str
    waited_ns: int = 0  # from the press to t_ns, where it had to wait


@dataclass(frozen=True, slots=True)
class Stepped:
    """One step of the world; the last event of its step."""

    t_ns: int
    episode: int
    step: int  # 1 for the first
    action: int
    key: str  # the causing key, "" for a tick's no-op
    key_t_ns: int  # when that key arrived; t_ns of the tick where none did
    reward: float
    return_: float
    terminated: bool
    truncated: bool
    pose: Pose | None
    rt_ms: float | None  # causing key minus the flip of the picture it answers; None without a key or a flip
    state_hash: int
    observation_hash: int


@dataclass(frozen=True, slots=True, eq=False)
class ObservationStored:
    """What the world gave to observe, where the protocol asks for it: after an episode's start, or before its step."""

    t_ns: int
    episode: int
    step: int  # that it follows, 0 for the reset
    observation: Any  # the world's own: an array, a text, a number, or a dict or tuple of them

    def __eq__(self, other: object) -> bool:
        """Whether the same was observed; arrays have no plain answer to that."""
        return isinstance(other, ObservationStored) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[int, int, int, int]:
        return (self.t_ns, self.episode, self.step, hash64(self.observation))


@dataclass(frozen=True, slots=True)
class FrameShown:
    """A picture of the world reached the display."""

    t_ns: int
    episode: int
    step: int  # the step whose result it shows, 0 for the reset
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class EpisodeEnded:
    """An episode ended, for the stated reason."""

    t_ns: int
    episode: int
    outcome: Outcome
    steps: int
    return_: float
    state_hash: int
    cause: EndCause = ""  # a time limit, where no step ended it


@dataclass(frozen=True, slots=True)
class EpisodesSkipped:
    """Planned episodes that are not going to be played."""

    t_ns: int
    first: int
    count: int
    reason: SkipReason


@dataclass(frozen=True, slots=True)
class Scored:
    """Points for an episode, and the session's total so far."""

    t_ns: int
    episode: int
    points: float
    total: float


@dataclass(frozen=True, slots=True)
class ClauseDone:
    """A step has done one clause of the episode's instruction; before the event of its step."""

    t_ns: int
    episode: int
    step: int
    clause: int  # of the instruction as it is read, from 0
    text: str


@dataclass(frozen=True, slots=True)
class PartStarted:
    """A part of the session begins."""

    t_ns: int
    part: int  # index into the plan's parts
    kind: str
    name: str


@dataclass(frozen=True, slots=True)
class PartEnded:
    """A part of the session is over, and which part is next."""

    t_ns: int
    part: int
    end: PartEnd
    next: int  # index of the part that follows; one past the last where none does


@dataclass(frozen=True, slots=True)
class PageShown:
    """A page of a text reached the display."""

    t_ns: int
    part: int
    page: int  # 1 for the first
    pages: int
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class TextTyped:
    """Text came from the input method or the keyboard's layout."""

    t_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class PointerUsed:
    """A pointer went down, moved while down, or came up; x and y are 0..1 of the drawn picture."""

    t_ns: int
    what: Literal["pressed", "moved", "released"]
    x: float
    y: float
    target: str
    along: float


@dataclass(frozen=True, slots=True)
class AnswerChanged:
    """An answer is another now, not given yet."""

    t_ns: int
    part: int
    item: str
    value: str  # JSON


@dataclass(frozen=True, slots=True)
class Answered:
    """An answer was given."""

    t_ns: int
    part: int
    part_name: str
    item: str  # the item's name
    kind: str
    attempt: int  # 1, or more where the questions were asked again
    value: str  # JSON: a code, a list of codes, a number, a text, or null where it was left out
    words: str  # what the participant saw of it: the option's words, the number
    shown_ns: int  # when the question reached the display; 0 if nobody said
    first_ns: int  # its first change; 0 if there was none
    changes: int
    right: bool | None  # None where there is no right answer


@dataclass(frozen=True, slots=True)
class Paused:
    """Play stopped; time in a pause is not playing time."""

    t_ns: int
    reason: PauseReason


@dataclass(frozen=True, slots=True)
class Resumed:
    """Play goes on."""

    t_ns: int


@dataclass(frozen=True, slots=True)
class Noted:
    """A fact worth a readable line: consent given, keyboard check, focus, phase change, abort reason, error."""

    t_ns: int
    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class Sampled:
    """A device of the protocol gave a sample: a gaze, a pulse, a trigger."""

    t_ns: int  # when it was taken, which is before it arrived: samples may be older than the event before them
    device: str  # its name in the protocol
    values: tuple[float, ...]  # one a channel, in the protocol's order; NaN where it has none
    text: str = ""  # what it says in words, a trigger box's code say


@dataclass(frozen=True, slots=True)
class Linked:
    """How a browser's clock lies to its server's, by the quickest of the latest messages there and back."""

    t_ns: int
    offset_ns: int  # the server's time minus the session's, both since the segment began
    error_ns: int  # the offset is right to so much, either way
    rtt_ns: int  # there and back, the last time
    least_rtt_ns: int  # the quickest of the latest
    drift_ppm: float | None  # how much faster the server's clock runs; None until it can be told


@dataclass(frozen=True, slots=True)
class SessionEnded:
    """The last event."""

    t_ns: int
    reason: EndReason
    detail: str
    episodes_completed: int


@dataclass(frozen=True, slots=True)
class KindEvent:
    """What one kind of activity says and no other; the kind adds its fields.

    A field whose name ends in ``_ns`` is a time of the session; 0 where nobody said.
    """

    t_ns: int


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
    | PointerUsed
    | AnswerChanged
    | Answered
    | Paused
    | Resumed
    | Noted
    | Sampled
    | Linked
    | SessionEnded
    | KindEvent
)
