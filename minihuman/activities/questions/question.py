"""Question kinds: the specification of a question, the draft of its answer, and the registration of a kind.

A kind is one folder with a module that defines its `QuestionKind`, registered in the entry-point group
``minihuman.questions``, and a ``words.toml`` that says in each language how the question is answered. Its answer is
displayed by a widget (`minihuman.experiment.machine.screens`), a value that windows and the page know how to draw.
"""

import abc
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from minihuman.errors import ProtocolError
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import AnswerWidget
from minihuman.plugins import QUESTION_GROUP, list_plugin_names, load_plugin, remember_by_name

AnswerType = Literal["code", "codes", "order", "rating", "number", "text"]
AnswerValue = str | int | float | list[str | int] | None


class QuestionItemSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One question of a questionnaire, as the protocol specifies it."""

    name: str  # in the log and the table
    kind: str
    ask: str  # what the participant reads
    options: tuple[str, ...] = ()  # `QuestionKind.item_fields` says which of these a kind uses
    codes: tuple[str | int, ...] = ()  # what the table holds for each option; absent: 1, 2, ...
    low: str = ""  # the words at the ends of a scale
    high: str = ""
    points: int = 7  # of a scale without options
    minimum: float = 0.0
    maximum: float = 100.0
    step: float = 1.0
    show_value: bool = False  # the number is on the screen
    whole: bool = True  # no decimals
    unit: str = ""
    longest: int = 2000  # characters
    required: bool = True
    right: str | int | float | tuple[str | int, ...] | None = None  # the right answer's code or value
    settings: dict[str, Any] | msgspec.UnsetType = msgspec.UNSET  # a kind's own fields; not in plans without any
    statements: dict[str, str] | msgspec.UnsetType = msgspec.UNSET  # an answer for each
    only_if: dict[str, tuple[str | int | float, ...]] | msgspec.UnsetType = msgspec.UNSET  # earlier item -> answers

    @property
    def asked(self) -> dict[str, str]:
        """Return a text for each answer that the question logs, by the answer's name in the log.

        A question with statements logs one answer per statement, and some kinds one per component; others log one.
        """
        texts = self.statements or _list_components(self)
        if not texts:
            return {self.name: self.ask}
        return {f"{self.name}_{name}": f"{self.ask} {text}".strip() for name, text in texts.items()}

    @property
    def all_codes(self) -> tuple[str | int, ...]:
        """Return the code of each option or point, for kinds that define no other codes (see `list_codes`)."""
        return self.codes or tuple(range(1, (len(self.options) or self.points) + 1))

    @property
    def right_answers(self) -> tuple[str | int | float, ...]:
        """Return every right answer; empty if no answer is right or wrong."""
        if self.right is None:
            return ()
        if isinstance(self.right, tuple):
            return self.right
        return (self.right,)


@dataclass(frozen=True, slots=True)
class Click:
    """A press of the pointer on a target of a widget; ``along`` is defined as in `PointerPressed`."""

    target: str
    along: float = 0.5


class AnswerDraft(abc.ABC):
    """An answer while the participant is giving it.

    Its state consists of numbers, texts, and lists, sets and dicts of them, so that a session in a browser can be
    copied.

    Args:
        question: the question's specification.
        settings: the question's ``settings``, converted to the kind's own type; None if the kind has none.
        rtl: whether text runs from right to left.
        language: the language in which numbers are written; None parses them by the rules of old logs.
    """

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        self.question = question
        self.settings = settings
        self.rtl = rtl
        self.language = language
        self.has_native_field = False  # the window edits the text, and sends it whole; `build_draft` sets it
        self.limit_note = ""  # for a native field

    @abc.abstractmethod
    def key(self, press: KeyDown) -> bool:
        """Handle a key press and return whether the key has a meaning for this question."""

    def type_text(self, text: str) -> None:  # noqa: B027 - most kinds take no text
        """Handle typed text."""

    def put_text(self, text: str) -> bool:
        """Replace the text in a native field; return False if the draft has no such field."""
        return False

    def point_at(self, target: str, along: float, *, down: bool) -> None:  # noqa: B027 - a text field needs no click
        """Handle the pointer on a target such as "option:2": a press (``down``), or a move after one.

        ``along`` is the pointer's place on the target, as in `PointerPressed`.
        """

    @property
    @abc.abstractmethod
    def value(self) -> AnswerValue:
        """Return the answer so far; None if there is none."""

    @property
    @abc.abstractmethod
    def display_text(self) -> str:
        """Return the answer so far, as the participant sees it."""

    @property
    def model_request(self) -> str:
        """Return what a language model is asked to answer with; "" for the sentence of the widget.

        Verification composes a log's prompts again, so a kind that has been used must keep its sentence.
        """
        return ""

    @property
    def answers(self) -> tuple[tuple[str, AnswerValue, str], ...]:
        """Return the name, value and text of each answer to log; the names are those of `QuestionItemSpec.asked`.

        Kinds of questions that log several answers override this; their ``value`` holds the values of all answers.
        """
        return ((self.question.name, self.value, self.display_text),)

    @abc.abstractmethod
    def widget(self) -> AnswerWidget:
        """Build the widget that windows and the page draw."""

    @abc.abstractmethod
    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> Click | str | None:
        """Return the next input of a simulated participant: a click, text to type, or None once the answer is complete.

        It is called again after each input, and changes nothing of the draft itself.

        Args:
            choose: draws a whole number from 0 up to but not including its argument.
            attends: draws whether the participant gives the right answer, if there is one.
        """

    @property
    def error(self) -> tuple[str, dict[str, Any]] | None:
        """Return why the answer cannot be given, as an interface text's key and its fields; None if it can."""
        if self.question.required and self.value is None:
            return ("note.required", {})
        return None


ItemErrors = Iterator[tuple[str, str]]  # a field of the question, and what is wrong with it


def _no_errors(question: QuestionItemSpec) -> ItemErrors:
    yield from ()


def needs_no_server(question: QuestionItemSpec) -> Iterator[str]:
    """Yield nothing, for a kind whose questions a page without a server can ask."""
    yield from ()


ANSWER_TYPES_WITH_CODES = ("code", "codes", "order", "rating")


@dataclass(frozen=True, slots=True)
class QuestionKind:
    """A kind of question, as it is registered.

    Attributes:
        name: the kind's name in protocols.
        draft: builds the draft of an answer.
        answer_type: the type of answers: an option's code, several codes, several codes in a meaningful order, a code
            that has a mean, a number, or text.
        check: yields the errors of a question in a protocol.
        item_fields: the fields of a question that the kind uses, of those that not every kind has: protocols' reference
            and forms name them, and `minihuman check` says which others have no effect. None if the kind does not say.
        settings: the type of a question's ``settings``; None if the kind has none.
        prompt: the text that says how to answer, for a kind without ``prompt.NAME`` in the ``words.toml`` of its folder
            or among the interface texts.
        takes_text: whether keys that the draft does not handle are typed text.
        codes: returns the codes of an answer from a question's ``settings``; None if they are those of its ``options``.
        example: the fields that a question needs besides ``name``, ``kind`` and ``ask``; contract tests use them.
        has_statements: whether a question can have ``statements``, each with a separate answer.
        components: returns the text of each answer by its name, from a question's ``settings``, for a kind whose
            questions always have several answers, such as the two dimensions of a grid; None for any other.
        find_server_needs: yields what in a question needs a server, each as a clause about the part that asks it; None
            if a page without a server cannot ask any. That page has a screen for each answer.
        is_judged_by_page: whether a page without a server judges the answers by rules, as they are too many for a
            screen each.
    """

    name: str
    draft: Callable[..., AnswerDraft]
    answer_type: AnswerType
    check: Callable[[QuestionItemSpec], ItemErrors] = _no_errors
    item_fields: tuple[str, ...] | None = field(default=None, kw_only=True)
    settings: type[msgspec.Struct] | None = None
    prompt: str = ""
    takes_text: bool = False
    codes: Callable[[Any], tuple[str | int, ...]] | None = None
    example: Mapping[str, Any] = field(default_factory=dict)
    has_statements: bool = False
    components: Callable[[Any], Mapping[str, str]] | None = None
    find_server_needs: Callable[[QuestionItemSpec], Iterator[str]] | None = None
    is_judged_by_page: bool = False


@remember_by_name
def find_question_kind(name: str) -> QuestionKind:
    """Return the question kind of a given name.

    Raises:
        ProtocolError: if no kind of that name is installed, or the entry point is no `QuestionKind`.
    """
    kind = load_plugin(QUESTION_GROUP, name, ProtocolError, noun="question kind")
    if not isinstance(kind, QuestionKind):
        raise ProtocolError(
            f"question kind {name!r} is of type {type(kind).__name__}; register an instance of "
            "minihuman.ext.QuestionKind"
        )
    return kind


def build_draft(
    question: QuestionItemSpec, *, rtl: bool, language: str | None = None, limit_note: str = ""
) -> AnswerDraft:
    """Build the empty draft of an answer to a question.

    Args:
        question: the question, as the protocol specifies it.
        rtl: whether text runs from right to left.
        language: the language in which numbers are written, as in `AnswerDraft`.
        limit_note: what a native field says about a text that is too long, with ``{longest}``; "" if the session edits
            texts by keys, as it did under the first text rules.
    """
    kind = find_question_kind(question.kind)
    draft = kind.draft(question, _read_settings(kind, question), rtl=rtl, language=language)
    draft.has_native_field = kind.takes_text and bool(limit_note)
    draft.limit_note = limit_note
    return draft


def _read_settings(kind: QuestionKind, question: QuestionItemSpec) -> Any:
    """Return a question's settings, converted to the kind's own type; None if the kind has none.

    Raises:
        msgspec.ValidationError: if the settings do not fit that type.
    """
    if kind.settings is None:
        return None
    return msgspec.convert(question.settings or {}, kind.settings)


def _list_components(question: QuestionItemSpec) -> Mapping[str, str]:
    """Return the text of each component of an answer by its name.

    Empty if the kind has no components, is not installed, or cannot read the question's settings.
    """
    try:
        kind = find_question_kind(question.kind)
        if kind.components is None:
            return {}
        return kind.components(_read_settings(kind, question))
    except (ProtocolError, msgspec.ValidationError):  # `check_item` names it; the plug-in of an old log may be gone
        return {}


def list_codes(question: QuestionItemSpec) -> tuple[str | int, ...]:
    """Return the codes that an answer to a question can have: the kind's own, or one for each option or point.

    Raises:
        ProtocolError: if the question's kind is not installed.
    """
    kind = find_question_kind(question.kind)
    if kind.codes is None:
        return question.all_codes
    return kind.codes(_read_settings(kind, question))


def check_item(question: QuestionItemSpec) -> ItemErrors:
    """Yield the errors of a question in a protocol, each as a field's name and what is wrong with it."""
    try:
        kind = find_question_kind(question.kind)
    except ProtocolError as error:
        yield "kind", f"is {question.kind!r}: {error}"
        return
    settings_errors = list(_check_settings(kind, question))
    yield from settings_errors
    if settings_errors and kind.settings is not None:  # the kind cannot judge a question whose settings it cannot read
        return
    if question.statements is not msgspec.UNSET and not kind.has_statements:
        usable_kinds = " or ".join(map(repr, _list_kinds_with_statements()))
        yield "statements", f"is given, but a question of kind {question.kind!r} has none; use kind = {usable_kinds}"
    yield from _check_options(kind, question)
    errors = list(kind.check(question))
    yield from errors
    if question.right is not None and len(question.asked) > 1:
        answers = ", ".join(question.asked)
        yield "right", f"is one answer, but the question has {len(question.asked)}: {answers}; remove it"
    elif kind.answer_type in ANSWER_TYPES_WITH_CODES:
        has_unreliable_codes = kind.codes is not None and bool(errors)  # the kind's codes follow from wrong settings
        if not has_unreliable_codes:
            yield from _check_right_answers(question)


def _list_kinds_with_statements() -> list[str]:
    """Return the names of the built-in kinds whose questions can have statements."""
    names = list_plugin_names(QUESTION_GROUP, built_in=True)
    return [name for name in names if find_question_kind(name).has_statements]


def _check_settings(kind: QuestionKind, question: QuestionItemSpec) -> ItemErrors:
    """Yield an error if a question's settings do not fit its kind."""
    if kind.settings is None:
        if question.settings:
            yield "settings", f"is given, but a question of kind {question.kind!r} has none"
        return
    try:
        msgspec.convert(question.settings or {}, kind.settings)
    except msgspec.ValidationError as error:
        yield "settings", f"of kind {question.kind!r}: {error}"


def _check_options(kind: QuestionKind, question: QuestionItemSpec) -> ItemErrors:
    """Yield the errors of a question's options and codes: given without use, or not as many codes as options."""
    if question.options and kind.answer_type not in ANSWER_TYPES_WITH_CODES:
        yield "options", f"is given, but a question of kind {question.kind!r} has none"
    if kind.codes is not None:
        for field in ("options", "codes"):
            if getattr(question, field):
                yield field, f"is given, but a question of kind {question.kind!r} has its own; give them in settings"
        return
    n_options = len(question.options) or question.points
    if question.codes and len(question.codes) != n_options:
        yield "codes", f"has {len(question.codes)} for {n_options} options; give one an option"


def _check_right_answers(question: QuestionItemSpec) -> ItemErrors:
    """Yield an error for each right answer that is no code of an option."""
    codes = list_codes(question)
    for right in question.right_answers:
        if right not in codes:
            yield "right", f"is {right!r}, which is not an option's code; codes: {', '.join(map(str, codes))}"


def check_range(question: QuestionItemSpec) -> ItemErrors:
    """Yield an error if a question's range of numbers is empty or its step is not above 0."""
    if question.minimum >= question.maximum or question.step <= 0:
        span = f"{question.minimum:g} to {question.maximum:g}"
        yield "minimum", f"to maximum is {span} in steps of {question.step:g}, which is none"


def is_correct(question: QuestionItemSpec, value: AnswerValue) -> bool | None:
    """Return whether a question's answer is right; None if the question has no right answer.

    Texts are compared without regard to case and surrounding blanks. Several codes are compared without regard to their
    order, unless the kind's answer is an order.
    """
    if question.right is None:
        return None
    if isinstance(value, list):
        if find_question_kind(question.kind).answer_type == "order":
            return value == list(question.right_answers)
        return set(value) == set(question.right_answers)
    if isinstance(question.right, tuple):
        return value in question.right
    if isinstance(value, str) and isinstance(question.right, str):
        return value.strip().casefold() == question.right.strip().casefold()
    return value == question.right


def parse_digit(key: str) -> int:
    """Return the number on a digit key, including the keypad's; 0 for any other key, and for the key "0".

    Options are numbered from 1, so that ``if digit := parse_digit(key)`` tests whether a key can select one.
    """
    symbol = key.removeprefix("kp_")
    if symbol.isdecimal() and len(symbol) == 1:
        return int(symbol)
    return 0


def parse_option(target: str) -> int | None:
    """Return the index of the option that a pointer's target such as "option:2" names; None for other targets."""
    kind, _, number = target.partition(":")
    if kind == "option" and number.isdecimal():
        return int(number)
    return None


def horizontal_step(key: str, *, rtl: bool) -> int:
    """Return how far an arrow key moves in reading order: 1, -1, or 0 for any other key.

    ``rtl`` says that text runs from right to left.
    """
    step = {"left": -1, "right": 1}.get(key, 0)
    if rtl:
        return -step
    return step


def _list_kinds_using(field_name: str) -> list[str]:
    """Return the names of the built-in kinds that list a field of `QuestionItemSpec` among the fields they use."""
    names = list_plugin_names(QUESTION_GROUP, built_in=True)
    return [name for name in names if field_name in (find_question_kind(name).item_fields or ())]


def describe_useless_fields(question: QuestionItemSpec) -> Iterator[str]:
    """Yield a text for each field of a question that has no effect: other kinds use it, but its own kind does not."""
    used_fields = find_question_kind(question.kind).item_fields
    if used_fields is None:  # a plug-in need not say what it uses
        return
    for spec_field in msgspec.structs.fields(QuestionItemSpec):
        is_given = getattr(question, spec_field.name) != spec_field.default
        if is_given and spec_field.name not in used_fields and _list_kinds_using(spec_field.name):
            uses = ", ".join(used_fields) or "none of the fields of other kinds"
            yield f"{spec_field.name} has no effect on a question of kind {question.kind!r}, which uses {uses}"
