"""What the page of recorded data and its server send each other, as JSON; `messages` has the rest. No I/O."""

from typing import Literal

import msgspec


class SessionNote(msgspec.Struct, frozen=True):
    """An annotation that is in force."""

    tag: str
    episode: int | None  # None for the whole session
    note: str


class RecordedSession(msgspec.Struct, frozen=True):
    """A recorded session of a study."""

    log: str  # the path of its log in the study's folder, which names it in requests
    participant: str  # the name of the log if it cannot be read
    group: str
    session: int
    state: str  # "ended", "running", "unfinished" or "unreadable"
    started_at: str
    episodes_completed: int
    episodes_planned: int
    minutes: float
    notes: list[SessionNote]
    problem: str  # why it cannot be read; "" if it can
    replay_command: str
    annotate_command: str  # without the tag and the reason; "" if the log cannot be read
    film_command: str  # without the episode


class QueryExample(msgspec.Struct, frozen=True):
    """A query to begin with."""

    about: str
    sql: str


class RecordedData(msgspec.Struct, frozen=True):
    """What a study has recorded, and what can be asked of it."""

    folder: str
    sessions: list[RecordedSession]
    examples: list[QueryExample]
    formats: list[str]  # of exports


class QueryRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A query of a study's tables."""

    sql: str


class QueryAnswer(msgspec.Struct, frozen=True):
    """The result of a query."""

    columns: list[str]
    rows: list[list[str]]  # the first ones
    n_rows: int  # all
    notes: list[str]  # such as logs that cannot be read
    command: str


class AnnotationRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An annotation of a session or an episode, or its revocation."""

    log: str
    tag: str
    note: str
    episode: int | None = None
    take_back: bool = False


class EpisodeSummary(msgspec.Struct, frozen=True):
    """A recorded episode: the last attempt at it."""

    number: int
    block: str
    world: str
    outcome: str
    steps: int
    reward: float  # summed


class GivenAnswer(msgspec.Struct, frozen=True):
    """An answer to a question."""

    part: str
    question: str
    kind: str
    answer: str  # as the participant saw it; "" where it was left out
    attempt: int  # more than 1 where the questions were asked again
    right: bool | None  # None where there is no right answer


class SessionDetails(msgspec.Struct, frozen=True):
    """What a session contains."""

    episodes: list[EpisodeSummary]
    answers: list[GivenAnswer]


class ReplayThing(msgspec.Struct, frozen=True):
    """An object on a floor plan, in the plan's units."""

    name: str
    x: float
    z: float
    radius: float
    colour: str  # "#rrggbb"


class ReplayMap(msgspec.Struct, frozen=True):
    """A world seen from above: x to the right, z down the page."""

    unit: str  # "cell" or "m"
    bounds: tuple[float, float, float, float]  # x0, z0, x1, z1
    walls: list[tuple[float, float, float, float]]  # segments x0, z0, x1, z1
    things: list[ReplayThing]


class ReplayStep(msgspec.Struct, frozen=True):
    """A step of an episode; the first one is the reset."""

    t_ms: float  # since the reset
    key: str  # that caused it
    action: str
    reward: float
    reaction_ms: float | None
    place: tuple[float, float] | None  # x, z; None where the world cannot tell
    yaw_rad: float | None  # 0 along +x, counter-clockwise seen from above


class EpisodeReplay(msgspec.Struct, frozen=True):
    """A recorded episode, step by step."""

    number: int
    mission: str
    outcome: str
    steps: list[ReplayStep]
    floor: ReplayMap | None


class DepartureRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A participant who leaves the study: withdrawn, with their data erased, or replaced, with their data kept."""

    participant: str  # the code
    kind: Literal["withdraw", "replace"]
    reason: str
    experimenter: str = ""


class Departure(msgspec.Struct, frozen=True):
    """What came of a departure."""

    lines: list[str]  # as the command prints them
    command: str
    recorded: RecordedData  # as it is now


class ExportRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An export of a study into a new folder."""

    format: str


class DataExport(msgspec.Struct, frozen=True):
    """A folder into which a study was exported."""

    folder: str
    command: str
