"""A kind of question: what an item says, the answer while it is given, and how a kind is registered.

A kind is one folder: a module with its `QuestionKind`, which the entry-point group ``minihuman.questions`` names, and
``words.toml``, which says in each language how the question is answered. What is shown of an answer is a widget
(`minihuman.experiment.machine.screens`), a value that windows and the page know how to draw.
"""

import abc
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from minihuman.errors import ProtocolError
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import AnswerWidget
from minihuman.plugins import QUESTION_GROUP, load_plugin, remember_by_name

AnswerType = Literal["code", "codes", "order", "rating", "number", "text"]
AnswerValue = str | int | float | list[str | int] | None


class QuestionItemSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One question."""

    name: str  # in the log and the table
    kind: str
    ask: str  # what the participant reads
    options: tuple[str, ...] = ()  # choice, choices; likert: a word for each point
    codes: tuple[str | int, ...] = ()  # what the table holds for each option; absent: 1, 2, ...
    low: str = ""  # likert, slider: the words at the ends
    high: str = ""
    points: int = 7  # likert without options
    minimum: float = 0.0  # slider, number
    maximum: float = 100.0
    step: float = 1.0
    show_value: bool = False  # slider: the number is on the screen
    whole: bool = True  # number: no decimals
    unit: str = ""  # number
    longest: int = 2000  # text: characters
    required: bool = True
    right: str | int | float | tuple[str | int, ...] | None = None  # the right answer's code or value
    settings: dict[str, Any] | msgspec.UnsetType = msgspec.UNSET  # a kind's own fields; not in plans without any
    statements: dict[str, str] | msgspec.UnsetType = msgspec.UNSET  # likert: a matrix, a row for each
    only_if: dict[str, tuple[str | int | float, ...]] | msgspec.UnsetType = msgspec.UNSET  # earlier item -> answers

    @property
    def asked(self) -> dict[str, str]:
        """The name of each answer in the log, and what it answers: one, but for a matrix."""
        if not self.statements:
            return {self.name: self.ask}
        return {f"{self.name}_{name}": f"{self.ask} {text}".strip() for name, text in self.statements.items()}

    @property
    def all_codes(self) -> tuple[str | int, ...]:
        """A code for each option or point, of a kind that has no codes of its own (`list_codes`)."""
        return self.codes or tuple(range(1, (len(self.options) or self.points) + 1))

    @property
    def right_answers(self) -> tuple[str | int | float, ...]:
        """Every right answer; empty where none is right or wrong."""
        if self.right is None:
            return ()
        if isinstance(self.right, tuple):
            return self.right
        return (self.right,)


@dataclass(frozen=True, slots=True)
class Click:
    """A press of the pointer on a target of a widget; ``along`` as in `PointerPressed`."""

    target: str
    along: float = 0.5


class AnswerDraft(abc.ABC):
    """An answer that is not given yet.

    Its state is numbers, texts, and lists, sets and dicts of them, so that a browser's session can be copied.

    Args:
        question: what is asked.
        settings: the item's ``settings`` as the kind's own type; None if the kind has none.
        rtl: whether text runs from right to left.
        language: how numbers are written; None reads them by the first rules, as old logs do.
    """

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        self.question = question
        self.settings = settings
        self.rtl = rtl
        self.language = language

    @abc.abstractmethod
    def key(self, press: KeyDown) -> bool:
        """Take a key; return whether it means anything here."""

    def type_text(self, text: str) -> None:  # noqa: B027 - most kinds take no text
        """Take text."""

    def point_at(self, target: str, along: float, *, down: bool) -> None:  # noqa: B027 - a text field needs no click
        """Take a pointer that went down on a target (``down``), or moved after that."""

    @property
    @abc.abstractmethod
    def value(self) -> AnswerValue:
        """The answer as it is now; None if there is none."""

    @property
    @abc.abstractmethod
    def display_text(self) -> str:
        """The answer as the participant sees it."""

    @property
    def answers(self) -> tuple[tuple[str, AnswerValue, str], ...]:
        """The name, value and words to log once the answer is given; several for a matrix."""
        return ((self.question.name, self.value, self.display_text),)

    @abc.abstractmethod
    def widget(self) -> AnswerWidget:
        """Build what windows and the page draw."""

    @abc.abstractmethod
    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> Click | str | None:
        """Give the next input of a simulated participant: a click, text to type, or None when the answer can be given.

        Args:
            choose: draws a number below its argument.
            attends: draws whether the participant gives the right answer, where there is one.
        """

    @property
    def error(self) -> tuple[str, dict[str, Any]] | None:
        """The reason why the answer cannot be given: the key of an interface word and its fields."""
        if self.question.required and self.value is None:
            return ("note.required", {})
        return None


ItemErrors = Iterator[tuple[str, str]]  # a field of the item, and what is wrong with it


def _no_errors(item: QuestionItemSpec) -> ItemErrors:
    yield from ()


@dataclass(frozen=True, slots=True)
class QuestionKind:
    """A kind of question, as it is registered.

    Attributes:
        name: the protocol's word for it.
        draft: the answer while it is given.
        answer_type: an option's code, several codes, several codes in an order that counts, a code that has a mean,
            a number, or text.
        check: yields what is wrong with an item of a protocol.
        settings: the type of the item's ``settings``; None if the kind has none.
        prompt: says how to answer, where neither ``words.toml`` in the kind's folder nor the interface's words have
            ``prompt.NAME``.
        takes_text: whether keys that the draft does not take are typed text.
        codes: returns the codes of an answer from the item's ``settings``; None if they are those of its ``options``.
        example: the fields that an item needs beside ``name``, ``kind`` and ``ask``; contract tests ask it so.
    """

    name: str
    draft: Callable[..., AnswerDraft]
    answer_type: AnswerType
    check: Callable[[QuestionItemSpec], ItemErrors] = _no_errors
    settings: type[msgspec.Struct] | None = None
    prompt: str = ""
    takes_text: bool = False
    codes: Callable[[Any], tuple[str | int, ...]] | None = None
    example: Mapping[str, Any] = field(default_factory=dict)


@remember_by_name
def find_question_kind(name: str) -> QuestionKind:
    """Find the kind of question of that name.

    Raises:
        ProtocolError: if none is installed.
    """
    kind = load_plugin(QUESTION_GROUP, name, ProtocolError, noun="question kind")
    if not isinstance(kind, QuestionKind):
        raise ProtocolError(
            f"question kind {name!r} is of type {type(kind).__name__}; register an instance of "
            "minihuman.ext.QuestionKind"
        )
    return kind


def build_draft(question: QuestionItemSpec, *, rtl: bool, language: str | None = None) -> AnswerDraft:
    """Build an empty answer to a question; ``language`` as in `AnswerDraft`."""
    kind = find_question_kind(question.kind)
    return kind.draft(question, _read_settings(kind, question), rtl=rtl, language=language)


def _read_settings(kind: QuestionKind, question: QuestionItemSpec) -> Any:
    if kind.settings is None:
        return None
    return msgspec.convert(question.settings or {}, kind.settings)


def list_codes(question: QuestionItemSpec) -> tuple[str | int, ...]:
    """List the codes that an answer to a question can have: the kind's own, or one for each option or point."""
    kind = find_question_kind(question.kind)
    if kind.codes is None:
        return question.all_codes
    return kind.codes(_read_settings(kind, question))


def check_item(item: QuestionItemSpec) -> ItemErrors:
    """Yield what is wrong with a question of a protocol."""
    try:
        kind = find_question_kind(item.kind)
    except ProtocolError as error:
        yield "kind", f"is {item.kind!r}: {error}"
        return
    if kind.settings is not None:
        try:
            msgspec.convert(item.settings or {}, kind.settings)
        except msgspec.ValidationError as error:
            yield "settings", f"of kind {item.kind!r}: {error}"
            return
    elif item.settings:
        yield "settings", f"is given, but a {item.kind} has none"
    if item.statements is not msgspec.UNSET and item.kind != "likert":
        yield "statements", f"is given, but a {item.kind} has none; use kind = 'likert'"
    has_codes = kind.answer_type in ("code", "codes", "order", "rating")
    if item.options and not has_codes:
        yield "options", f"is given, but a {item.kind} has none"
    if kind.codes is not None:
        for field in ("options", "codes"):
            if getattr(item, field):
                yield field, f"is given, but a {item.kind} has its own; give them in settings"
    elif item.codes and len(item.codes) != (n_options := len(item.options) or item.points):
        yield "codes", f"has {len(item.codes)} for {n_options} options; give one an option"
    errors = list(kind.check(item))
    yield from errors
    if not has_codes or (errors and kind.codes is not None):  # codes of wrong settings mean nothing
        return
    codes = list_codes(item)
    for right in item.right_answers:
        if right not in codes:
            yield "right", f"is {right!r}, which is not an option's code; codes: {', '.join(map(str, codes))}"


def check_range(item: QuestionItemSpec) -> ItemErrors:
    """Yield what is wrong with an item's range of numbers."""
    if item.minimum >= item.maximum or item.step <= 0:
        yield "minimum", f"to maximum is {item.minimum:g} to {item.maximum:g} in steps of {item.step:g}, which is none"


def is_correct(question: QuestionItemSpec, value: AnswerValue) -> bool | None:
    """Tell whether an answer is the right one; None where there is none."""
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
    """Parse the number on a digit key from 1 to 9, of the keypad too; 0 for any other key, and for the key "0".

    Options are numbered from 1, so that ``if digit := parse_digit(key)`` asks whether a key can be one of them.
    """
    plain = key.removeprefix("kp_")
    if plain.isdecimal() and len(plain) == 1:
        return int(plain)
    return 0


def parse_option(target: str) -> int | None:
    """Parse the number of the option that a target names; None if it names none."""
    kind, _, number = target.partition(":")
    if kind == "option" and number.isdecimal():
        return int(number)
    return None


def horizontal_step(key: str, *, rtl: bool) -> int:
    """Return how far an arrow key moves in reading order: 1, -1, or 0 for any other key."""
    by = {"left": -1, "right": 1}.get(key, 0)
    if rtl:
        return -by
    return by
