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
    """The fields that may not change after the first enrolment, and what to do instead."""

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
    citation: str  # of the publication from which it comes; "" if there is none
    topics: list[str]  # what it shows: "team", "agent", "two days", "online", "adaptive", ...


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


class CopiedFile(msgspec.Struct, frozen=True):
    """A file of an imported folder, as it has been written."""

    path: str  # in the desk's folder
    bytes: int


class CodeFile(msgspec.Struct, frozen=True):
    """A Python file beside a protocol."""

    name: str
    text: str


class TrustQuestion(msgspec.Struct, frozen=True):
    """What a study would run or read if it were trusted."""

    untrusted: str  # folders and modules; "" if all is trusted
    files: list[CodeFile]
    sha256: str  # of the code, by which an answer refers to what was seen


class TrustRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The user's trust in a study whose code they have seen."""

    sha256: str


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
