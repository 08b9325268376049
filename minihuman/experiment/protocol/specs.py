"""Tables of a protocol file: pages, questions, activities, orders, sessions and devices, with overrides for a group.

Each table is a frozen struct; each `check_*` function yields the errors of values that have the right type. The module
also loads the questionnaires shipped with the package (NASA-TLX, demographics). Tables with modules of their own
(about, analysis, model, web) are imported here, so that this module offers all of them.
"""

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar, Literal, Protocol, TypeVar

import msgspec

from minihuman.activities.pages.plan import ExampleSpec
from minihuman.activities.questions.question import QuestionItemSpec, describe_useless_fields
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.designs import DesignSpec
from minihuman.experiment.protocol.about_spec import (
    AboutSpec as AboutSpec,
    AuthorSpec as AuthorSpec,
    ColumnType as ColumnType,
    ParticipantColumnSpec as ParticipantColumnSpec,
    check_about as check_about,
    is_orcid as is_orcid,
)
from minihuman.experiment.protocol.analysis_spec import (
    COMPARABLE_MEASURES as COMPARABLE_MEASURES,
    AnalysisSpec as AnalysisSpec,
    check_analysis as check_analysis,
)
from minihuman.experiment.protocol.model_spec import (
    ModelModality as ModelModality,
    ModelSpec as ModelSpec,
    check_model as check_model,
)
from minihuman.experiment.protocol.validation_errors import FieldError
from minihuman.experiment.protocol.web_spec import (
    CODE_RULE as CODE_RULE,
    Browser as Browser,
    CompletionCodesSpec as CompletionCodesSpec,
    ImageEncoding as ImageEncoding,
    RecruitmentPlatform as RecruitmentPlatform,
    WebSpec as WebSpec,
    check_web as check_web,
    is_completion_code as is_completion_code,
)


class AllocationSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of allocation, apart from the groups' ratios."""

    stratify_by: str = ""  # "part.item", or "part" for the number of questions answered correctly at the first attempt
    strata: dict[str, tuple[str | int, ...]] = {}  # name -> codes of a stratum; if absent, each option is a stratum
    cut_points: tuple[float, ...] = ()  # lower bounds of the strata of a number, apart from the lowest stratum
    design: DesignSpec | None = None  # an adaptive design that assigns groups instead of the list
    stopping: DesignSpec | None = None  # an adaptive design that ends enrolment


GroupOverrides = dict[str, dict[str, Any]]  # group -> its values of fields


class PageSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A text to read: consent, instructions or the closing text."""

    name: str
    text: str = ""
    title: str = ""
    asks_consent: bool = False  # the last page asks for agreement, which is logged with the text's SHA-256
    closing: bool = False  # whether this is the closing text, on which closing the window completes the session
    images: tuple[str, ...] = ()  # PNG files beside the protocol, one per page from the first
    example: ExampleSpec | None = None  # a world's picture on the first page
    group_overrides: GroupOverrides = {}


class QuestionnaireSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A questionnaire: a list of questions to answer."""

    name: str
    title: str = ""
    items: tuple[QuestionItemSpec, ...] = ()
    form: str = ""  # a shipped form instead of items: "nasa-tlx", "demographics"
    shuffle: bool = False  # whether each participant has an order of their own
    max_attempts: int = 1  # at items that have correct answers
    wrong_answer_text: str = ""  # shown after wrong answers while attempts are left
    return_to: str = ""  # the part to which wrong answers lead back; "" to ask again at once
    on_failure: Literal["go_on", "end"] = "go_on"  # after the last attempt
    group_overrides: GroupOverrides = {}


class ActivitySpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a plug-in's kind of activity, with that kind's settings."""

    name: str
    kind: str  # registered in the entry-point group minihuman.activities
    settings: dict[str, Any] = {}


class OrderSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Some parts in an order that depends on the participant. The order's name stands for them in a list of parts."""

    name: str
    parts: tuple[str | tuple[str, ...], ...]  # a list of parts stays together, such as a block and its questionnaire
    order: Literal["fixed", "shuffled", "latin-square"] = "latin-square"

    @property
    def units(self) -> tuple[tuple[str, ...], ...]:
        """Return the units that the order permutes: tuples of part names, which stay together."""
        return tuple((unit,) if isinstance(unit, str) else unit for unit in self.parts)


class SessionSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A session: its parts, and the days allowed between it and the previous one."""

    name: str
    parts: tuple[str, ...]
    days_after_previous: tuple[int, int] | None = None  # earliest and latest
    completion_code: str = ""  # for completing it in a browser; "" for web.completion_codes.complete


class _OverridablePart(Protocol):
    __struct_fields__: ClassVar[tuple[str, ...]]

    @property
    def group_overrides(self) -> GroupOverrides: ...


class _NamedPart(Protocol):
    @property
    def name(self) -> str: ...


Overridable = TypeVar("Overridable", bound=_OverridablePart)  # a block, a page, a questionnaire


def apply_overrides(part: Overridable, group: str) -> Overridable:
    """Return a part with a group's overrides; the part itself if the group has none.

    Raises:
        msgspec.ValidationError: if an override has an invalid value.
    """
    overrides = part.group_overrides.get(group)
    if not overrides:
        return part
    fields = {name: getattr(part, name) for name in part.__struct_fields__ if name != "group_overrides"}
    return msgspec.convert({**msgspec.to_builtins(fields), **overrides}, type(part))


def check_each(
    field: str, parts: Sequence[Overridable], find_errors: Callable[[Overridable], Iterable[FieldError]]
) -> Iterator[FieldError]:
    """Yield a (path, message) for each error that parts have without any group's overrides.

    Args:
        field: the protocol's field that contains the parts.
        parts: the parts.
        find_errors: yields a (field, message) for each error of a part.
    """
    for number, part in enumerate(parts):
        yield from ((f"$.{field}[{number}].{name}", message) for name, message in find_errors(part))


def check_each_override(
    field: str, parts: Sequence[Overridable], find_errors: Callable[[Overridable], Iterable[FieldError]]
) -> Iterator[FieldError]:
    """Yield a (path, message) for each error that parts have only with a group's overrides.

    The arguments are those of `check_each`.
    """
    for number, part in enumerate(parts):
        base_errors = list(find_errors(part))
        for group, overrides in part.group_overrides.items():
            if {"name", "group_overrides"} & overrides.keys():  # reported elsewhere as an error
                continue
            try:
                part_of_group = apply_overrides(part, group)
            except msgspec.ValidationError:  # the override's own check reports it
                continue
            for name, message in find_errors(part_of_group):
                if (name, message) not in base_errors:
                    yield f"$.{field}[{number}].group_overrides.{group}.{name}", message


NAME_PATTERN = re.compile(r"[a-z0-9][a-z0-9_-]{0,63}")
NAME_RULE = "use lower-case letters, digits, '-' and '_'"


def check_names(field: str, parts: Sequence[_NamedPart]) -> Iterator[FieldError]:
    """Yield the errors of the names in a list of parts; ``field`` is the protocol's field that contains them."""
    names = [part.name for part in parts]
    for number, name in enumerate(names):
        path = f"$.{field}[{number}].name"
        if not NAME_PATTERN.fullmatch(name):
            yield path, f"is {name!r}; {NAME_RULE}"
        if name in names[:number]:
            yield path, f"is {name!r} again; give each its own name"


class DeviceSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A device whose samples are logged with the session's clock."""

    name: str  # the device of the samples in the log: lower-case letters, digits, "-" and "_"
    plugin: str  # the plug-in's name, and after a ":" the plug-in's own argument ("lsl:EyeTracker")
    channels: tuple[str, ...] = ()  # the name of each of a sample's numbers
    units: tuple[str, ...] = ()  # the unit of each channel, "" for none; empty if no channel has a unit
    required: bool = True  # whether no session begins without it; otherwise the log's facts note that it is missing


def check_devices(devices: tuple[DeviceSpec, ...]) -> Iterator[FieldError]:
    """Yield an error for each value in the tables [[devices]] that has the right type but is not valid."""
    yield from check_names("devices", devices)
    for number, device in enumerate(devices):
        path = f"$.devices[{number}]"
        channels = device.channels
        if not device.plugin:
            yield f"{path}.plugin", "is empty; name a plug-in, such as lsl:NAME"
        if device.units and len(device.units) != len(channels):
            yield f"{path}.units", f"has {len(device.units)} for {len(channels)} channels; give one per channel"
        if len(set(channels)) < len(channels):
            yield f"{path}.channels", "names a channel twice; give each its own name"


SHIPPED_FORMS = ("nasa-tlx", "demographics")


class ShippedForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A questionnaire shipped with the package: a title and questions."""

    title: str
    items: tuple[QuestionItemSpec, ...]


def list_question_kinds(questionnaires: Sequence[QuestionnaireSpec], groups: Sequence[str]) -> tuple[str, ...]:
    """Return the kinds of question in a study's questionnaires, with the overrides of its groups, each kind once.

    The kinds are in the order in which they first appear.
    """
    kinds: list[str] = []
    for questionnaire in questionnaires:
        for group in ("", *groups):
            try:
                group_questionnaire = apply_overrides(questionnaire, group)
            except msgspec.ValidationError:
                continue  # the override's own check reports it
            kinds += [question.kind for question in group_questionnaire.items]
            if group_questionnaire.form in SHIPPED_FORMS:
                kinds += [question["kind"] for question in _read_form(group_questionnaire.form)["items"]]
    return tuple(dict.fromkeys(kinds))


def list_useless_item_fields(questionnaires: Sequence[QuestionnaireSpec]) -> Iterator[str]:
    """Yield a line for each field that a question has but that has no effect, because its kind does not use it."""
    for questionnaire in questionnaires:
        for question in questionnaire.items:
            for text in describe_useless_fields(question):
                yield f"questions {questionnaire.name!r}: {question.name!r}: {text}"


def load_form(name: str, language: str) -> ShippedForm:
    """Return the shipped questionnaire of a given name, one of `SHIPPED_FORMS`, in a language.

    Raises:
        ProtocolError: if the form is not available in the language.
    """
    tree = _read_form(name)
    if language not in tree["words"]:
        languages = ", ".join(tree["words"])
        raise ProtocolError(
            f"the form {name!r} exists in {languages} but not in {language!r}; write out its items in the protocol"
        )
    words = tree["words"][language]
    items = [{**item, **words["items"][item["name"]]} for item in tree["items"]]
    return msgspec.convert({"title": words["title"], "items": items}, ShippedForm)


@cache
def _read_form(name: str) -> dict[str, Any]:
    text = files("minihuman.experiment").joinpath("protocol", "forms", f"{name}.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
