"""What the builder's page and its server send each other, as JSON. No I/O.

A path is a list of steps from the root of the protocol: ``["blocks", 1, "options", "size"]``. Times are ISO 8601.
"""

from typing import Annotated, Any, Literal

import msgspec

Path = list[str | int]


class Mistake(msgspec.Struct, frozen=True):
    """An error that `check` reports, at its field."""

    path: Path  # of the field; [] for the file as a whole
    line: int  # of the file, from 1
    message: str  # what is wrong and the way out, without the path: "is 0; an episode count is 1 or more"


class Part(msgspec.Struct, frozen=True):
    """A part of a study: something that a session can contain."""

    name: str
    kind: str  # "page", "questions", "activity", "order", or a block's kind: "play", "trials", "team", ...
    path: Path  # of its table: ["blocks", 0]
    title: str  # what the study calls it; "" if it has no title
    used_in: list[str]  # the names of groups and sessions that list it; an order that lists it counts
    line: int


class Lane(msgspec.Struct, frozen=True):
    """The parts of one group in one session, in order, as the file lists them."""

    group: str
    session: str  # "" where the study has no [[sessions]]
    parts: list[str]  # names; an order's name stands for its parts
    path: Path  # of the list in the file: ["groups", 0, "blocks"], ["sessions", 1, "parts"]
    replaced: dict[str, str]  # part -> the part that this group has in its place; "" leaves it out


class Duration(msgspec.Struct, frozen=True):
    """An estimate of how long a session of a group takes, from the plan of one participant."""

    group: str
    session: str
    least_min: float
    most_min: float
    parts: dict[str, tuple[float, float]]  # part -> least and most minutes


class Pay(msgspec.Struct, frozen=True):
    """What a participant is paid."""

    currency: str
    base: float
    per_point: float
    most: float | None


class Restriction(msgspec.Struct, frozen=True):
    """A field that must not change, because participants have enrolled."""

    path: Path  # the field and all that is below it
    reason: str


class Restrictions(msgspec.Struct, frozen=True):
    """What enrolment has fixed, and the way out."""

    enrolled: int  # participants; 0 restricts nothing
    fields: list[Restriction]
    message: str  # for the top of the page: what is fixed and why; "" if nothing is


class Document(msgspec.Struct, frozen=True):
    """A protocol file that is open in the builder."""

    key: str  # in addresses: the file's path in the desk's folder
    name: str  # study.name, or the file's stem
    version: str  # SHA-256 of the file's bytes; "" and an edit of it is refused
    text: str  # the file, decoded
    tree: dict[str, Any]  # the file's values; {} if it is not valid TOML
    lines: dict[str, int]  # "blocks[1].episodes" -> line, of every field and table in the file
    parts: list[Part]
    lanes: list[Lane]
    mistakes: list[Mistake]  # of the file alone; `check` also creates the worlds
    restrictions: Restrictions
    durations: list[Duration]  # [] while there are mistakes
    pay: Pay | None
    can_undo: bool
    can_redo: bool
    trusted: bool  # false: worlds of modules that the user does not trust are neither loaded nor run
    read_only: list[Mistake]  # what the builder leaves alone, each with the reason


class Edit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A change of the file. Edits of one request are made together or not at all, in order.

    - `set`: give the field at ``path`` the ``value``; the field is added if the file lacks it.
    - `remove`: remove the field, table or array element at ``path``.
    - `insert`: insert the table ``value`` into an array of tables so that it gets ``path``, whose last step is a
      number; a number equal to the array's length appends.
    - `move`: move the element at ``path`` so that it gets the number ``to``.
    - `duplicate`: copy the element at ``path`` behind itself, with the fields of ``value`` replaced (a new name).
    - `rename`: give the part, group or session at ``path`` the name ``value``, and change every mention of it.
    - `replace_text`: make ``value`` the whole text of the file; ``path`` is [].
    """

    op: Literal["set", "remove", "insert", "move", "duplicate", "rename", "replace_text"]
    path: Path
    value: Any = None
    to: int = 0


class EditRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Edits of the version of a file that the page shows."""

    version: str
    edits: list[Edit]


class VersionRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A step back or forth in the file's history, from the version that the page shows."""

    version: str


RefusalReason = Literal["conflict", "restricted", "not_editable", "not_valid", "not_there", "exists", "not_trusted"]


class EditRefusal(msgspec.Struct, frozen=True):
    """Why a request was not carried out. The file is as before."""

    error: RefusalReason
    message: str  # what, with the way out
    path: Path = []
    line: int = 0
    document: Document | None = None  # of a conflict: the file as it is now


class StudyCard(msgspec.Struct, frozen=True):
    """A study of the folder, as the first view shows it."""

    key: str
    name: str
    title: str  # about.title, or the name
    language: str
    groups: list[str]
    parts: list[Part]
    lanes: list[Lane]
    minutes: tuple[float, float] | None  # of the longest first session, least and most; None if not known
    participants: int  # planned
    enrolled: int
    sessions: dict[str, int]  # "running", "ended", "unfinished", "unreadable" -> count
    mistakes: int
    problem: str  # why the file cannot be read; "" if it can
    has_protocol: bool  # false: recorded sessions without a file


class Template(msgspec.Struct, frozen=True):
    """A study that can be copied."""

    name: str
    title: str
    summary: str
    language: str
    minutes: tuple[float, float] | None
    files: list[str]  # that are copied with it
    group: Literal["start", "example", "trials"]


class Studies(msgspec.Struct, frozen=True):
    """The studies of the desk's folder."""

    folder: str  # its name
    studies: list[StudyCard]
    templates: list[Template]


class NewStudyRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A new study from a template, or from a study of the folder."""

    name: str  # any text; the study's name is made of it
    template: str = ""  # of `Template`
    source_key: str = ""  # or the key of a study, whose new version this is
    language: str = "en"


class Choice(msgspec.Struct, frozen=True):
    """A value that a field can have."""

    value: Any
    label: str


class FormField(msgspec.Struct, frozen=True):
    """A field of a table, as a form shows it."""

    name: str
    type: Annotated[
        Literal[
            "string", "text", "integer", "number", "boolean", "choice", "list", "pair", "table", "tables", "map", "any"
        ],
        "text is a string of several lines; pair is two numbers; map is a table with keys of the user's own",
    ]
    item: str  # of a list, pair or map: the type of its elements; else ""
    alternatives: list[str]  # types that are valid, too
    required: bool
    default: Any  # the value without the field; None if absent
    sentence: str  # Markdown
    example: Any
    unit: str  # "ms", "s", "px", "days", ""
    choices: list[Choice]
    references: Literal["", "part", "block", "group", "world", "key", "action", "file", "session"]  # what it names
    table: str  # of type table or tables: the form of these, as in `GET form?table=`
    common: bool  # required, or used in a shipped study of this kind: shown before the rest


class FieldForm(msgspec.Struct, frozen=True):
    """The form of a table."""

    table: str  # "blocks", "blocks.stimuli", "questions.items", "questions.items.likert"
    heading: str  # "[[blocks]]"
    summary: str
    fields: list[FormField]


class PartKind(msgspec.Struct, frozen=True):
    """A kind of part that can be added, or a kind of question."""

    kind: str
    table: str  # of the form and in the file: "blocks"
    summary: str
    new: dict[str, Any]  # the fields of a new one, valid but for its name


class Kinds(msgspec.Struct, frozen=True):
    """What can be added to a study."""

    parts: list[PartKind]
    questions: list[PartKind]
    languages: list[str]
    worlds: list[Choice]
    consents: dict[str, dict[str, Any]]  # by language: the fields of a page of consent


class MediaFile(msgspec.Struct, frozen=True):
    """A file beside the protocol."""

    name: str
    bytes: int
    media_type: str
    used_at: list[Path]  # the fields that name it


class Media(msgspec.Struct, frozen=True):
    """The files beside a protocol: pictures, sounds, tables of stimuli."""

    files: list[MediaFile]


class StimulusTable(msgspec.Struct, frozen=True):
    """A table of stimuli: a CSV file beside the protocol."""

    name: str
    version: str  # SHA-256 of the file's bytes
    columns: list[str]
    rows: list[list[str]]


class TableRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole content of a table, or rows as a spreadsheet copies them."""

    name: str
    version: str = ""  # that the page shows; "" for a new file
    columns: list[str] = []
    rows: list[list[str]] = []
    pasted: str = ""  # instead of columns and rows: lines with tabs between the cells, the first line with the names


class FieldDifference(msgspec.Struct, frozen=True):
    """A field in which two protocols differ."""

    path: Path  # in the second; in the first if the second lacks it
    before: Any  # None if the first lacks it
    after: Any  # None if the second lacks it


class Differences(msgspec.Struct, frozen=True):
    """What differs between a study and another: a new version and the one from which it was made."""

    key: str
    other: str
    differences: list[FieldDifference]


class CheckReport(msgspec.Struct, frozen=True):
    """What `minihuman check` says of a version."""

    version: str
    mistakes: list[Mistake]
    notices: list[str]
    plan: list[str]  # of one participant, line by line


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
    item: str
    kind: str
    answer: str  # as the participant saw it; "" where it was left out
    attempt: int  # more than 1 where the questions were asked again
    right: bool | None  # None where there is no right answer


class SessionDetails(msgspec.Struct, frozen=True):
    """What a session contains."""

    episodes: list[EpisodeSummary]
    answers: list[GivenAnswer]


class FloorThing(msgspec.Struct, frozen=True):
    """An object on a floor plan, in the plan's units."""

    name: str
    x: float
    z: float
    radius: float
    colour: str  # "#rrggbb"


class FloorPlan(msgspec.Struct, frozen=True):
    """A world seen from above: x to the right, z down the page."""

    unit: str  # "cell" or "m"
    bounds: tuple[float, float, float, float]  # x0, z0, x1, z1
    walls: list[tuple[float, float, float, float]]  # segments x0, z0, x1, z1
    things: list[FloorThing]


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
    floor: FloorPlan | None


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
    data: RecordedData  # as it is now


class ExportRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An export of a study into a new folder."""

    format: str


class DataExport(msgspec.Struct, frozen=True):
    """A folder into which a study was exported."""

    folder: str
    command: str
