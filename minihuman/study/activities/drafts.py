"""Answers in the making: what keys, text and pointer do to each kind of item. Knows no order, time or log."""

import abc
import math
from typing import Any, Literal

import msgspec

from minihuman.study.inputs import KeyDown
from minihuman.study.screens import Choices, Entry, Item, Scale, Slider

ItemKind = Literal["likert", "slider", "choice", "choices", "number", "text", "long_text"]
Value = str | int | float | list[str | int] | None


class Question(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One question."""

    name: str  # in the log and the table
    kind: ItemKind
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

    @property
    def all_codes(self) -> tuple[str | int, ...]:
        """A code for each option or point."""
        return self.codes or tuple(range(1, (len(self.options) or self.points) + 1))


class Draft(abc.ABC):
    """An answer that is not given yet."""

    def __init__(self, asked: Question, *, rtl: bool) -> None:
        self.asked = asked
        self.rtl = rtl

    @abc.abstractmethod
    def key(self, press: KeyDown) -> bool:
        """Take a key; whether it means anything here."""

    def typed(self, text: str) -> None:  # noqa: B027 - most kinds take no text
        """Take text."""

    @abc.abstractmethod
    def point(self, target: str, along: float, *, down: bool) -> None:
        """Take a pointer that went down in a spot, or moved after that."""

    @property
    @abc.abstractmethod
    def value(self) -> Value:
        """The answer as it is now; None: there is none."""

    @property
    @abc.abstractmethod
    def words(self) -> str:
        """The answer as the participant sees it."""

    @abc.abstractmethod
    def item(self) -> Item:
        """What is to be seen of it."""

    @property
    def complaint(self) -> tuple[str, dict[str, Any]] | None:
        """Why it cannot be given: a word's key and its fields."""
        return ("note.required", {}) if self.asked.required and self.value is None else None


class ChoiceDraft(Draft):
    """One or several of some options, below each other."""

    def __init__(self, asked: Question, *, rtl: bool) -> None:
        super().__init__(asked, rtl=rtl)
        self._many = asked.kind == "choices"
        self._chosen: frozenset[int] = frozenset()
        self._at = 0

    def key(self, press: KeyDown) -> bool:
        """Up and down move, a digit or the space bar chooses."""
        count = len(self.asked.options)
        if (digit := _digit(press.key)) and digit <= count:
            self._choose(digit - 1)
        elif press.key in ("up", "down"):
            by = 1 if press.key == "down" else -1
            untouched = not self._chosen and not self._many
            self._at = self._at if untouched and by > 0 else (self._at + by) % count
            if not self._many:
                self._choose(self._at)
        elif press.key == "space" and not press.repeat:
            self._choose(self._at)
        else:
            return False
        return True

    def point(self, target: str, along: float, *, down: bool) -> None:
        """Choose the option that was hit."""
        number = _option(target)
        if down and number is not None and number < len(self.asked.options):
            self._choose(number)

    def _choose(self, number: int) -> None:
        self._at = number
        self._chosen = self._chosen ^ {number} if self._many else frozenset({number})

    @property
    def value(self) -> Value:
        """The code, or the codes in the options' order."""
        codes = [self.asked.all_codes[number] for number in sorted(self._chosen)]
        if self._many:
            return codes if codes or not self.asked.required else None
        return codes[0] if codes else None

    @property
    def words(self) -> str:
        """The options' words."""
        return "; ".join(self.asked.options[number] for number in sorted(self._chosen))

    def item(self) -> Choices:
        """The options."""
        return Choices(self.asked.options, self._chosen, self._at, self._many)


class ScaleDraft(Draft):
    """A point in a row."""

    def __init__(self, asked: Question, *, rtl: bool) -> None:
        super().__init__(asked, rtl=rtl)
        self._count = len(asked.options) or asked.points
        self._chosen: int | None = None

    def key(self, press: KeyDown) -> bool:
        """Left and right move, a digit chooses."""
        if (digit := _digit(press.key)) and digit <= self._count:
            self._chosen = digit - 1
        elif by := _sideways(press.key, rtl=self.rtl):
            middle = (self._count - 1) // 2
            now = self._chosen
            self._chosen = middle if now is None else min(self._count - 1, max(0, now + by))
        else:
            return False
        return True

    def point(self, target: str, along: float, *, down: bool) -> None:
        """Choose the point that was hit."""
        number = _option(target)
        if down and number is not None and number < self._count:
            self._chosen = number

    @property
    def value(self) -> Value:
        """The point's code, 1 for the first unless the protocol says otherwise."""
        return None if self._chosen is None else self.asked.all_codes[self._chosen]

    @property
    def words(self) -> str:
        """The point's words, or its number."""
        if self._chosen is None:
            return ""
        return self.asked.options[self._chosen] if self.asked.options else str(self._chosen + 1)

    def item(self) -> Scale:
        """The points."""
        points = self.asked.options or tuple(str(number + 1) for number in range(self._count))
        return Scale(points, self.asked.low, self.asked.high, self._chosen)


class SliderDraft(Draft):
    """A place on a line, in steps. It has none until it is touched, so that its start suggests nothing."""

    def __init__(self, asked: Question, *, rtl: bool) -> None:
        super().__init__(asked, rtl=rtl)
        self._steps = max(1, round((asked.maximum - asked.minimum) / asked.step))
        self._at: int | None = None  # steps from the minimum

    def key(self, press: KeyDown) -> bool:
        """Left and right by a step, page keys by a tenth, home and end to the ends."""
        tenth = max(1, self._steps // 10)
        moves = {"page_up": tenth, "page_down": -tenth, "up": 1, "down": -1}
        if by := _sideways(press.key, rtl=self.rtl) or moves.get(press.key, 0):
            self._at = self._steps // 2 if self._at is None else min(self._steps, max(0, self._at + by))
        elif press.key in ("home", "end"):
            self._at = 0 if press.key == "home" else self._steps
        else:
            return False
        return True

    def point(self, target: str, along: float, *, down: bool) -> None:
        """Put the mark where the pointer is."""
        if target == "slider":
            self._at = min(self._steps, max(0, math.floor(along * self._steps + 0.5)))

    @property
    def value(self) -> Value:
        """The number at the mark."""
        if self._at is None:
            return None
        value = round(self.asked.minimum + self._at * self.asked.step, 9)
        return int(value) if value == int(value) else value

    @property
    def words(self) -> str:
        """The number."""
        return "" if self.value is None else f"{self.value:g}"

    def item(self) -> Slider:
        """The line and its mark."""
        along = None if self._at is None else self._at / self._steps
        shown = self.words if self.asked.show_value else ""
        return Slider(self.asked.low, self.asked.high, along, shown, min(self._steps, 20))


class EntryDraft(Draft):
    """Text, or a number typed as one."""

    def __init__(self, asked: Question, *, rtl: bool) -> None:
        super().__init__(asked, rtl=rtl)
        self._text = ""
        self._caret = 0

    def key(self, press: KeyDown) -> bool:
        """Move the caret, and take away; whatever else a key types comes as text."""
        before, after = self._text[: self._caret], self._text[self._caret :]
        match press.key:
            case "backspace":
                self._put(before[:-1], after)
            case "delete":
                self._put(before, after[1:])
            case "left" | "right":
                by = _sideways(press.key, rtl=self.rtl)
                self._caret = min(len(self._text), max(0, self._caret + by))
            case "home" | "end":
                self._caret = 0 if press.key == "home" else len(self._text)
            case "enter" | "kp_enter" if self.asked.kind == "long_text":
                self.typed("\n")
            case _:
                return False
        return True

    def typed(self, text: str) -> None:
        """Put text at the caret, as much of it as there is room for and may be."""
        kept = [c for c in text if c == "\n" or c.isprintable()]
        if self.asked.kind != "long_text":
            kept = [c for c in kept if c != "\n"]
        if self.asked.kind == "number":
            kept = [c for c in kept if c in "0123456789-.,"]
        room = self.asked.longest - len(self._text)
        self._put(self._text[: self._caret] + "".join(kept[: max(0, room)]), self._text[self._caret :])

    def _put(self, before: str, after: str) -> None:
        self._text, self._caret = before + after, len(before)

    def point(self, target: str, along: float, *, down: bool) -> None:
        """A field needs no click."""

    @property
    def value(self) -> Value:
        """The text without blanks around it, or the number; None for nothing, or for no number."""
        text = self._text.strip()
        if self.asked.kind != "number":
            return text or None
        try:
            number = float(text.replace(",", "."))
        except ValueError:
            return None
        if not math.isfinite(number):  # more digits than a number holds
            return None
        if self.asked.whole:
            return int(number) if number == int(number) else None
        return number

    @property
    def words(self) -> str:
        """The text itself."""
        return self._text.strip()

    @property
    def complaint(self) -> tuple[str, dict[str, Any]] | None:
        """Nothing typed, no number, or one out of range."""
        asked = self.asked
        if asked.kind != "number" or not self._text.strip():
            return super().complaint
        number = self.value
        if number is None:
            return "note.whole_number" if asked.whole else "note.number", {}
        assert isinstance(number, int | float)
        if not asked.minimum <= number <= asked.maximum:
            return "note.range", {"minimum": _plain(asked.minimum), "maximum": _plain(asked.maximum)}
        return None

    def item(self) -> Entry:
        """The field."""
        return Entry(self._text, self._caret, self.asked.kind == "long_text", self.asked.unit)


_DRAFTS: dict[ItemKind, type[Draft]] = {
    "choice": ChoiceDraft,
    "choices": ChoiceDraft,
    "likert": ScaleDraft,
    "slider": SliderDraft,
    "number": EntryDraft,
    "text": EntryDraft,
    "long_text": EntryDraft,
}


def draft_of(asked: Question, *, rtl: bool) -> Draft:
    """An empty answer to a question."""
    return _DRAFTS[asked.kind](asked, rtl=rtl)


def is_right(asked: Question, value: Value) -> bool | None:
    """Whether an answer is the right one; None where there is none."""
    if asked.right is None:
        return None
    if isinstance(value, list):
        right = asked.right if isinstance(asked.right, tuple) else (asked.right,)
        return set(value) == set(right)
    if isinstance(asked.right, tuple):
        return value in asked.right
    if isinstance(value, str) and isinstance(asked.right, str):
        return value.strip().casefold() == asked.right.strip().casefold()
    return value == asked.right


def _plain(value: float) -> str:
    """A number as people write it, without an exponent."""
    return f"{value:.9f}".rstrip("0").rstrip(".")


def _digit(key: str) -> int:
    plain = key.removeprefix("kp_")
    return int(plain) if plain.isdecimal() and len(plain) == 1 else 0


def _option(target: str) -> int | None:
    kind, _, number = target.partition(":")
    return int(number) if kind == "option" and number.isdecimal() else None


def _sideways(key: str, *, rtl: bool) -> int:
    by = {"left": -1, "right": 1}.get(key, 0)
    return -by if rtl else by
