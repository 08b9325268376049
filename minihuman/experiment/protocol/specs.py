"""Tables of a protocol file: pages, questions, activities, orders, sessions, about, analysis, devices and web.

Each table is a frozen struct; `check_*` returns the values that have the right type but cannot be right. Includes
the questionnaires shipped with the package (NASA-TLX, demographics).
"""

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar, Literal, Protocol, TypeVar

import msgspec

from minihuman.activities.pages.plan import ExampleSpec
from minihuman.activities.questions.question import QuestionItemSpec
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.designs import DesignSpec
from minihuman.experiment.protocol.validation_errors import FieldError, select_errors


class AllocationSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How places are drawn, beyond the groups' ratios."""

    stratify_by: str = ""  # "part.item", or "part" for how many of its questions are right at the first try
    strata: dict[str, tuple[str | int, ...]] = {}  # name -> codes taken together; absent: a stratum an option
    cut_points: tuple[
        float, ...
    ] = ()  # of a number: below the first, from it to below the second, ..., the last or more
    design: DesignSpec | None = None  # assigns each participant's group from those before, instead of the list
    stopping: DesignSpec | None = None  # ends enrolment from the participants before


GroupOverrides = dict[str, dict[str, Any]]  # group -> fields that are others for it


class PageSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part that is read: a consent, instructions, the last words."""

    name: str
    text: str = ""
    title: str = ""
    asks_consent: bool = False  # the last page asks for agreement, which is logged with the text's SHA-256
    closing: bool = False  # the session's last words: closing the window over them leaves the session complete
    images: tuple[str, ...] = ()  # PNG files beside the protocol, one a page from the first
    example: ExampleSpec | None = None  # a world's picture on the first page
    group_overrides: GroupOverrides = {}


class QuestionnaireSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part that is answered."""

    name: str
    title: str = ""
    items: tuple[QuestionItemSpec, ...] = ()
    form: str = ""  # a shipped form instead of items: "nasa-tlx", "demographics"
    shuffle: bool = False  # the items come in an order of the participant's own
    max_attempts: int = 1  # where items have right answers
    wrong_answer_text: str = ""  # said after wrong answers, while tries are left
    return_to: str = ""  # the part to which wrong answers lead back; "" asks again at once
    on_failure: Literal["go_on", "end"] = "go_on"  # after the last try
    group_overrides: GroupOverrides = {}


class ActivitySpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a kind that a plug-in brings; its own fields are in ``plan``."""

    name: str
    kind: str  # registered in the entry-point group minihuman.activities
    settings: dict[str, Any] = {}


class OrderSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Some parts in an order that depends on the participant. Its name stands for them in a list of parts."""

    name: str
    parts: tuple[str | tuple[str, ...], ...]  # a list of parts stays together: a block and its questionnaire
    order: Literal["fixed", "shuffled", "latin-square"] = "latin-square"

    @property
    def units(self) -> tuple[tuple[str, ...], ...]:
        """What changes places: lists of parts, most of them of one."""
        return tuple((unit,) if isinstance(unit, str) else unit for unit in self.parts)


class SessionSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A session: its parts, and how many days after the one before it may be."""

    name: str
    parts: tuple[str, ...]
    days_after_previous: tuple[int, int] | None = None  # earliest and latest
    completion_code: str = ""  # for who completes it in a browser; "": web.completion_codes.complete


class _OverridablePart(Protocol):
    __struct_fields__: ClassVar[tuple[str, ...]]

    @property
    def group_overrides(self) -> GroupOverrides: ...


class _NamedPart(Protocol):
    @property
    def name(self) -> str: ...


Overridable = TypeVar("Overridable", bound=_OverridablePart)  # a block, a page, a questionnaire


def apply_overrides(part: Overridable, group: str) -> Overridable:
    """A part with the fields that are others for a group.

    Raises:
        msgspec.ValidationError: if one of them holds what it cannot.
    """
    own = part.group_overrides.get(group)
    if not own:
        return part
    fields = {name: getattr(part, name) for name in part.__struct_fields__ if name != "group_overrides"}
    return msgspec.convert({**msgspec.to_builtins(fields), **own}, type(part))


def check_each(
    field: str, parts: Sequence[Overridable], complaints: Callable[[Overridable], Iterable[FieldError]]
) -> Iterator[FieldError]:
    """Every (path, complaint) about parts, as they are for all.

    Args:
        field: of the protocol, which has the parts.
        parts: what it has.
        complaints: about one part, with the field of it that each is about.
    """
    for number, part in enumerate(parts):
        yield from ((f"$.{field}[{number}].{name}", what) for name, what in complaints(part))


def check_each_override(
    field: str, parts: Sequence[Overridable], complaints: Callable[[Overridable], Iterable[FieldError]]
) -> Iterator[FieldError]:
    """Every (path, complaint) about parts with the fields that are others for a group, but for those about all."""
    for number, part in enumerate(parts):
        for_all = list(complaints(part))
        for group, own in part.group_overrides.items():
            if {"name", "group_overrides"} & own.keys():
                continue
            try:
                its = apply_overrides(part, group)
            except msgspec.ValidationError:  # which is a complaint of its own
                continue
            for name, what in complaints(its):
                if (name, what) not in for_all:
                    yield f"$.{field}[{number}].group_overrides.{group}.{name}", what


ColumnType = Literal["text", "integer", "number", "boolean"]


_ORCID = re.compile(r"\d{4}-\d{4}-\d{4}-\d{3}[\dX]")


_DOI = re.compile(r"10\.\d{4,9}/\S+")


_LICENCE = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*|https?://\S+")


_COLUMN = re.compile(r"[a-z][a-z0-9_]*")


class AuthorSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An author of the study; never a participant."""

    name: str  # as in print: "Ada Lovelace"
    orcid: str = ""  # "0000-0002-1825-0097"
    email: str = ""
    affiliation: str = ""


class ParticipantColumnSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A column of ``participants.csv`` in the study's folder: what the laboratory knows of people beside their play."""

    name: str  # "age", "handedness"
    description: str
    type: ColumnType = "text"
    unit: str = ""  # "year"
    levels: dict[str, str] = {}  # each word that may stand there, and what it means; empty: anything


class AboutSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The study as a publication. Every field may be left out; an export says which ones a standard misses."""

    title: str = ""
    description: str = ""
    authors: tuple[AuthorSpec, ...] = ()
    licence: str = ""  # an SPDX identifier ("CC-BY-4.0") or the licence's address
    funding: tuple[str, ...] = ()
    ethics_approvals: tuple[str, ...] = ()  # approvals: board and number
    institution: str = ""
    department: str = ""
    address: str = ""  # of the institution
    keywords: tuple[str, ...] = ()
    doi: str = ""  # of the data, "10.1234/abcd"
    references: tuple[str, ...] = ()  # works to read or cite
    how_to_acknowledge: str = ""  # how users of the data should acknowledge it
    task_description: str = ""  # what participants did, in one sentence
    participant_columns: tuple[ParticipantColumnSpec, ...] = ()


def check_about(about: AboutSpec) -> list[FieldError]:
    """Every (path, complaint) about values that have the right type but cannot be."""
    found = select_errors(
        [
            (
                about.licence and not _LICENCE.fullmatch(about.licence),
                "$.about.licence",
                f"is {about.licence!r}; use an SPDX identifier such as 'CC-BY-4.0', or an address",
            ),
            (
                about.doi and not _DOI.fullmatch(about.doi),
                "$.about.doi",
                f"is {about.doi!r}; write it as 10.1234/abcd, without https://doi.org/",
            ),
        ]
    )
    for number, author in enumerate(about.authors):
        path = f"$.about.authors[{number}]"
        orcid = author.orcid
        email = author.email
        looks = "which is not an ORCID; an ORCID looks like 0000-0002-1825-0097"
        found += select_errors(
            [
                (not author.name.strip(), f"{path}.name", "is empty; write it as in print"),
                (orcid and not is_orcid(orcid), f"{path}.orcid", f"is {orcid!r}, {looks}"),
                (email and "@" not in email, f"{path}.email", f"is {email!r}, which is not an e-mail address"),
            ]
        )
    found += [
        (f"$.about.{field}[{number}]", "is empty; remove it")
        for field in ("funding", "ethics_approvals", "keywords", "references")
        for number, text in enumerate(getattr(about, field))
        if not text.strip()
    ]
    names = [column.name for column in about.participant_columns]
    for number, column in enumerate(about.participant_columns):
        path = f"$.about.participant_columns[{number}]"
        name = column.name
        is_name = _COLUMN.fullmatch(name) and name not in ("participant", "participant_id")
        found += select_errors(
            [
                (not is_name, f"{path}.name", f"is {name!r}; use lower-case letters, digits and '_'"),
                (name in names[:number], f"{path}.name", f"is {name!r} again; give each its own name"),
                (not column.description.strip(), f"{path}.description", "is empty; say what the column holds"),
            ]
        )
    return found


def is_orcid(text: str) -> bool:
    """Whether it is written as an ORCID and its check digit (ISO 7064, mod 11-2) is right."""
    if not _ORCID.fullmatch(text):
        return False
    digits = text.replace("-", "")
    total = 0
    for digit in digits[:-1]:
        total = (total + int(digit)) * 2
    check = (12 - total % 11) % 11
    return digits[-1] == ("X" if check == 10 else str(check))


_NAMED_MEASURE = re.compile(r"[a-z][a-z0-9_-]*:.+")  # an answer's, of teaching, or of a lab's own package


# What groups can be compared on: columns of the table "blocks", one value a participant.
COMPARABLE_MEASURES = (
    *("log_excess_steps_mean", "spl_mean", "success", "reward_mean", "steps_at_limit_mean", "excess_steps_mean"),
    *("reward_first", "reward_slope", "playing_s_mean", "response_median_ms", "path_efficiency_mean"),
    *("ineffective_share", "all_keys_discovered_s", "log_steps_ratio_mean", "reaction_median_ms"),
)


class AnalysisSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The measures that count, and how near two groups have to be to count as alike."""

    primary_measure: str = ""  # one measure, judged by itself; "": all are corrected together
    secondary_measures: tuple[str, ...] = ()  # corrected together, for how many there are
    equivalence_margin: float | None = None  # groups whose primary measures differ by less than this are alike
    block: str = ""  # that groups are compared on; "": the last that all of them play
    conditions: tuple[str, ...] = ()  # that are compared within a participant: blocks, or the levels of "label:NAME"
    covariates: tuple[str, ...] = ()  # that the primary measure is also compared adjusted for

    @property
    def condition_label(self) -> str:
        """The label of trials whose levels are the conditions; "" where they are blocks."""
        (name,) = self.conditions if len(self.conditions) == 1 else ("",)
        if name.startswith("label:"):
            return name.removeprefix("label:")
        return ""

    def find_plugin_measures(self) -> tuple[str, ...]:
        """The named measures that are no column of the table of blocks, each once."""
        named = (self.primary_measure, *self.secondary_measures, *self.covariates)
        return tuple(dict.fromkeys(name for name in named if ":" in name))


def check_analysis(
    analysis: AnalysisSpec, blocks: tuple[str, ...], *, practice: tuple[str, ...] = ()
) -> list[FieldError]:
    """Every (path, complaint) about an analysis that cannot be made."""
    primary = analysis.primary_measure
    conditions = analysis.conditions
    block = analysis.block
    margin = analysis.equivalence_margin
    known = f"there are {', '.join(COMPARABLE_MEASURES)}"
    played = f"blocks: {', '.join(blocks)}"
    measures = (
        ("primary_measure", (primary,)),
        ("secondary_measures", analysis.secondary_measures),
        ("covariates", analysis.covariates),
    )
    found = select_errors(
        [
            *(
                (
                    name and name not in COMPARABLE_MEASURES and not _NAMED_MEASURE.fullmatch(name),
                    field,
                    f"is {name!r}, which is not a measure; {known}",
                )
                for field, names in measures
                for name in names
            ),
            *(
                (name not in blocks, "conditions", f"has {name!r}, which is not a block; {played}")
                for name in conditions
                if not analysis.condition_label
            ),
            (
                not analysis.condition_label and (len(conditions) == 1 or len(set(conditions)) < len(conditions)),
                "conditions",
                "compares blocks with each other; name two or more, each once, or one label as 'label:NAME'",
            ),
            (analysis.covariates and not primary, "covariates", "adjust the primary measure; name one"),
            (
                primary and primary in analysis.secondary_measures,
                "secondary_measures",
                f"names {primary!r}, which is the primary measure already",
            ),
            (
                margin is not None and not margin > 0,
                "equivalence_margin",
                f"is {margin}; groups are alike within more than 0",
            ),
            (
                margin is not None and not primary,
                "equivalence_margin",
                "is of the primary measure; name one",
            ),
            (block and block not in blocks, "block", f"is {block!r}, which is not a block; {played}"),
            (block in practice, "block", f"is {block!r}, which has analysed = false; name another block"),
        ]
    )
    return [(f"$.analysis.{field}", what) for field, what in found]


NAME_PATTERN = re.compile(r"[a-z0-9][a-z0-9_-]{0,63}")


NAME_RULE = "use lower-case letters, digits, '-' and '_'"


def check_names(field: str, named: Sequence[_NamedPart]) -> list[FieldError]:
    """Every (path, complaint) about the names of what a field of the protocol holds."""
    names = [one.name for one in named]
    found = []
    for number, name in enumerate(names):
        path = f"$.{field}[{number}].name"
        found += select_errors(
            [
                (not NAME_PATTERN.fullmatch(name), path, f"is {name!r}; {NAME_RULE}"),
                (name in names[:number], path, f"is {name!r} again; give each its own name"),
            ]
        )
    return found


class DeviceSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A device whose samples go into the session's log, stamped on the session's clock."""

    name: str  # of its samples in the log: lower-case letters, digits, "-" and "_"
    plugin: str  # the plug-in that brings it; what follows a ":" is its own ("lsl:EyeTracker")
    channels: tuple[str, ...] = ()  # what each of a sample's numbers is
    units: tuple[str, ...] = ()  # of each, "" for none; none at all where no channel has one
    required: bool = True  # without it the session does not begin; else the facts in the log say that it is missing


def check_devices(devices: tuple[DeviceSpec, ...]) -> list[FieldError]:
    """Every (path, complaint) about values that have the right type but cannot be."""
    found = check_names("devices", devices)
    for number, device in enumerate(devices):
        path = f"$.devices[{number}]"
        channels = device.channels
        units = device.units
        found += select_errors(
            [
                (not device.plugin, f"{path}.plugin", "is empty; name a plug-in, such as lsl:NAME"),
                (
                    units and len(units) != len(channels),
                    f"{path}.units",
                    f"has {len(units)} for {len(channels)} channels",
                ),
                (len(set(channels)) < len(channels), f"{path}.channels", "names one twice"),
            ]
        )
    return found


Browser = Literal["chrome", "edge", "firefox", "safari"]


RecruitmentPlatform = Literal["prolific", "sona", "mturk"]


ImageEncoding = Literal["auto", "lossless", "jpeg"]


_CODE = re.compile(r"[A-Za-z0-9_-]{0,64}")


CODE_RULE = "use letters, digits, '-' and '_', at most 64"


def is_completion_code(code: str) -> bool:
    """Whether a code can be in an address."""
    return _CODE.fullmatch(code) is not None


class CompletionCodesSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a participant takes back to where they were recruited, by how their session ended; "" shows no code."""

    complete: str = ""
    declined: str = ""  # did not agree
    screened_out: str = ""  # browser, window, line or keyboard, or a criterion not reached
    failed_check: str = ""  # wrong answers, where the questions say failed = "end"
    timed_out: str = ""  # the participant was away for as long as the study waits
    quit: str = ""  # ended it themselves


ModelModality = Literal["picture", "text", "both"]


class ModelSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a model that takes a participant's place is shown, and what it may cost."""

    modality: ModelModality = "both"
    size_px: tuple[int, int] = (640, 480)  # of the screen's picture, width and height
    history: int = 8  # earlier screens, in words, and answers in each request
    invalid: Literal["retry", "no_op", "end"] = "retry"  # after an answer that is none
    retries: int = 2  # invalid answers in a row, and requests without an answer, that may be followed by another
    temperature: float = 0.0
    max_tokens: int = 256  # of an answer
    request_fields: tuple[Literal["temperature", "max_tokens", "max_completion_tokens"], ...] = (
        "temperature",
        "max_tokens",
    )  # settings that a request holds
    unknown: Literal["repeat", "end"] = "repeat"  # after a kill, for a call without a stored answer
    timeout_s: float = 120.0  # of an answer
    provider: str = ""  # who runs it, in the study's words
    price_prompt: float = 0.0  # per million tokens
    price_completion: float = 0.0
    currency: str = ""
    max_price: float = 0.0  # of a session; 0: no limit
    max_session_tokens: int = 0
    max_session_s: float = 0.0  # of waiting for answers


def check_model(model: ModelSpec) -> list[FieldError]:
    """Every (path, complaint) about values that have the right type but cannot be."""
    bounds: tuple[tuple[str, float, float], ...] = (
        *(("history", 0, 1_000), ("retries", 0, 100), ("temperature", 0, 10), ("max_tokens", 1, 1_000_000)),
        *(("timeout_s", 1, 86_400), ("price_prompt", 0, 1e6), ("price_completion", 0, 1e6), ("max_price", 0, 1e9)),
        *(("max_session_tokens", 0, 1e12), ("max_session_s", 0, 1e7)),
    )
    return select_errors(
        [
            (
                not all(64 <= side <= 4096 for side in model.size_px),
                "$.model.size_px",
                f"is {list(model.size_px)}; use 64 to 4096 px a side",
            ),
            *_list_bound_rules("model", model, bounds),
            (
                model.max_price and not (model.price_prompt or model.price_completion),
                "$.model.max_price",
                "limits nothing without price_prompt and price_completion; give them",
            ),
        ]
    )


def _list_bound_rules(
    table: str, spec: msgspec.Struct, bounds: Iterable[tuple[str, float, float]]
) -> list[tuple[bool, str, str]]:
    """A rule for each field of a table that has a least and a greatest value."""
    return [
        (
            not least <= getattr(spec, field) <= most,
            f"$.{table}.{field}",
            f"is {getattr(spec, field):g}; use {least:g} to {most:g}",
        )
        for field, least, most in bounds
    ]


class WebSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the study runs in a browser; without this table it runs there all the same."""

    image_size_px: tuple[int, int] = (
        640,
        480,
    )  # of the world's picture, width and height; shown enlarged, never stretched
    image_encoding: ImageEncoding = "auto"  # auto: grid worlds lossless, first-person ones as JPEG
    reconnect_timeout_s: float = 600.0  # so long a lost line may take to come back before the session ends
    idle_timeout_s: float = 1800.0  # so long nothing may be pressed; 0: for ever
    allowed_browsers: tuple[Browser, ...] = ()  # that may take part; (): any
    max_rtt_ms: float = 0.0  # the slowest line that may, there and back; 0: any
    min_window_size_px: tuple[int, int] = (0, 0)  # the smallest window that may, width and height
    require_keyboard: bool = True  # devices with only a touch screen may not take part
    open_access: bool = False  # who comes without a link and from no platform gets a slot, too
    recruitment_platforms: tuple[RecruitmentPlatform, ...] = ()  # that people may come from; () asks for links
    max_concurrent_sessions: int = 200  # seats
    max_unconsented_per_address: int = 20  # of people without a link who played nothing; raise it for a lab
    require_signed_arrival: bool = False  # who comes from a platform needs a signature; see web/arrival_signature.py
    completion_codes: CompletionCodesSpec = CompletionCodesSpec()
    redirect: str = ""  # where the page leads at the end; {code} and {id}, the platform's id, are filled in


def check_web(online: WebSpec) -> list[FieldError]:
    """Every (path, complaint) about values that have the right type but cannot be."""
    codes = msgspec.structs.asdict(online.completion_codes)
    complete = online.completion_codes.complete
    given = list(codes.values())
    sizes = (("image_size_px", 16, 4096), ("min_window_size_px", 0, 8192))
    bounds = (
        *(("reconnect_timeout_s", 0, 86_400), ("idle_timeout_s", 0, 86_400), ("max_rtt_ms", 0, 60_000)),
        *(("max_concurrent_sessions", 1, 10_000), ("max_unconsented_per_address", 1, 10_000)),
    )
    return select_errors(
        [
            *(
                (
                    not all(least <= side <= most for side in getattr(online, field)),
                    f"$.web.{field}",
                    f"is {list(getattr(online, field))}; use {least} to {most} px a side",
                )
                for field, least, most in sizes
            ),
            *_list_bound_rules("web", online, bounds),
            *(
                (not is_completion_code(code), f"$.web.completion_codes.{name}", f"is {code!r}; {CODE_RULE}")
                for name, code in codes.items()
            ),
            (
                complete and given.count(complete) > 1,
                "$.web.completion_codes.complete",
                "is another end's code, too; give completion one of its own",
            ),
            (
                online.redirect and not online.redirect.startswith("https://"),
                "$.web.redirect",
                f"is {online.redirect!r}; it starts with https://",
            ),
            (
                set(re.findall(r"\{([^}]*)\}", online.redirect)) - {"code", "id"},
                "$.web.redirect",
                "has a bad placeholder; use {code} and {id}",
            ),
        ]
    )


SHIPPED_FORMS = ("nasa-tlx", "demographics")


class ShippedForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A title and questions."""

    title: str
    items: tuple[QuestionItemSpec, ...]


def load_form(name: str, language: str) -> ShippedForm:
    """A form in a language.

    Raises:
        ProtocolError: if there is none in it.
    """
    tree = _tree(name)
    if language not in tree["words"]:
        languages = ", ".join(tree["words"])
        raise ProtocolError(
            f"the form {name!r} exists in {languages} but not in {language!r}; write out its items in the protocol"
        )
    words = tree["words"][language]
    items = [{**item, **words["items"][item["name"]]} for item in tree["items"]]
    return msgspec.convert({"title": words["title"], "items": items}, ShippedForm)


@cache
def _tree(name: str) -> dict[str, Any]:
    text = files("minihuman.experiment").joinpath("protocol", "forms", f"{name}.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
