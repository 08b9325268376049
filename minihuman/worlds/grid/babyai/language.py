"""The language of instructions as values: verbs, descriptions of objects, and the ways to join clauses.

An instruction is one clause (`GoTo`, `Open`, `Pickup`, `PutNext`), two in any order (`And`), or one of these before or
after another (`Before`, `After`), as in Minigrid's levels. `str()` of an instruction is its sentence, and `parse`
converts a sentence back.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, ClassVar

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS

PLACES = ("left", "right", "front", "behind")  # by number
PLACE_WORDS = ("on your left", "on your right", "in front of you", "behind you")
NOUNS = ("door", "key", "ball", "box")


@dataclass(frozen=True, slots=True)
class ObjectDescription:
    """A description of objects, such as "a red ball" or "the door on your left". A field of None matches anything."""

    kind: str | None = None
    colour: str | None = None
    place: str | None = None  # a side of the agent's first pose, within the agent's first room
    many: bool | None = None  # whether several objects match ("a"), just one ("the"), or it is not known yet (None)

    def __post_init__(self) -> None:
        """Raise a WorldError unless the kind, the colour and the place exist or are None."""
        for name, words in (("kind", NOUNS), ("colour", COLOURS), ("place", PLACES)):
            value = getattr(self, name)
            if isinstance(value, str) and value not in words:  # in a level's function it may be a random variable
                raise WorldError(f"unknown {name} {value!r}; use one of {', '.join(words)}")

    def __str__(self) -> str:
        words = ["a" if self.many else "the", self.colour, self.kind or "object"]
        if self.place is not None:
            words.append(PLACE_WORDS[PLACES.index(self.place)])
        return " ".join(word for word in words if word)


@dataclass(frozen=True, slots=True)
class Clause:
    """Base class of clauses, each of which has one verb."""

    thing: ObjectDescription

    words: ClassVar[str]

    def __str__(self) -> str:
        return f"{self.words} {self.thing}"


@dataclass(frozen=True, slots=True)
class GoTo(Clause):
    """The clause to go to an object: stand next to it and face it."""

    words: ClassVar[str] = "go to"


@dataclass(frozen=True, slots=True)
class Open(Clause):
    """The clause to open a door. With ``strict``, opening or closing another door is a failure."""

    words: ClassVar[str] = "open"
    strict: bool = False

    def __post_init__(self) -> None:
        """Raise a WorldError if the object to open is described as another kind than a door."""
        if self.thing.kind not in ("door", None) and isinstance(self.thing.kind, str):
            raise WorldError(f"'open {self.thing}': only doors can be opened")


@dataclass(frozen=True, slots=True)
class Pickup(Clause):
    """The clause to pick up an object. With ``strict``, picking up another one is a failure."""

    words: ClassVar[str] = "pick up"
    strict: bool = False

    def __post_init__(self) -> None:
        """Raise a WorldError if the object to pick up is described as a door."""
        if self.thing.kind == "door":
            raise WorldError(f"'pick up {self.thing}': a door cannot be picked up")


@dataclass(frozen=True, slots=True)
class PutNext(Clause):
    """The clause to put an object next to another. With ``strict``, every pick-up is a failure."""

    words: ClassVar[str] = "put"
    other: ObjectDescription = ObjectDescription()
    strict: bool = False

    def __post_init__(self) -> None:
        """Raise a WorldError if the object to move is described as a door."""
        if self.thing.kind == "door":
            raise WorldError(f"'put {self.thing} ...': a door cannot be carried")

    def __str__(self) -> str:
        return f"put {self.thing} next to {self.other}"


@dataclass(frozen=True, slots=True)
class And:
    """Two clauses that can be carried out in any order."""

    left: Clause
    right: Clause

    def __str__(self) -> str:
        return f"{self.left} and {self.right}"


Part = Clause | And


@dataclass(frozen=True, slots=True)
class Before:
    """The part ``left``, then the part ``right``. With ``strict``, completing ``right`` first is a failure."""

    left: Part
    right: Part
    strict: bool = False

    def __str__(self) -> str:
        return f"{self.left}, then {self.right}"


@dataclass(frozen=True, slots=True)
class After:
    """The part ``left`` after the part ``right``. With ``strict``, completing ``left`` first is a failure."""

    left: Part
    right: Part
    strict: bool = False

    def __str__(self) -> str:
        return f"{self.left} after you {self.right}"


Instruction = Part | Before | After


def parts(instruction: Instruction) -> tuple[Part, ...]:
    """Return the parts of an instruction in the order of its sentence."""
    if isinstance(instruction, Before | After):
        return (instruction.left, instruction.right)
    return (instruction,)


def clauses(instruction: Instruction) -> tuple[Clause, ...]:
    """Return the clauses of an instruction in the order of its sentence."""
    return tuple(_clauses(instruction))


def _clauses(instruction: Instruction) -> Iterator[Clause]:
    for part in parts(instruction):
        if isinstance(part, And):
            yield from (part.left, part.right)
        else:
            yield part


def as_tree(instruction: Any) -> dict[str, Any]:
    """Return an instruction as nested dicts, for JSON.

    Each dict has the class's name under "do", except for descriptions, and the fields that are set.
    """
    tree: dict[str, Any] = {} if isinstance(instruction, ObjectDescription) else {"do": type(instruction).__name__}
    for field in fields(instruction):
        value = getattr(instruction, field.name)
        if value is not None and value is not False:
            tree[field.name] = value if isinstance(value, str | bool) else as_tree(value)
    return tree


def parse(sentence: str) -> Instruction:
    """Return the instruction that a sentence states. The articles "a" and "the" may be omitted.

    Raises:
        WorldError: if the sentence does not belong to the language.
    """
    text = " ".join(sentence.split())
    for words, make in ((", then ", Before), (" after you ", After)):
        if words in text:
            left, _, right = text.partition(words)
            return make(_parse_part(left, sentence), _parse_part(right, sentence))
    return _parse_part(text, sentence)


def _parse_part(text: str, sentence: str) -> Part:
    if " and " in text:
        left, _, right = text.partition(" and ")
        return And(_parse_clause(left, sentence), _parse_clause(right, sentence))
    return _parse_clause(text, sentence)


def _parse_clause(text: str, sentence: str) -> Clause:
    if text.startswith("put ") and " next to " in text:
        thing, _, other = text.removeprefix("put ").partition(" next to ")
        return PutNext(_parse_description(thing, sentence), _parse_description(other, sentence))
    for make in (GoTo, Open, Pickup):
        if text.startswith(make.words + " "):
            return make(_parse_description(text.removeprefix(make.words + " "), sentence))
    raise WorldError(
        f"mission {sentence!r}: {text!r} does not begin with a verb; use go to, open, pick up or put ... next to"
    )


def _parse_description(text: str, sentence: str) -> ObjectDescription:
    """Return the description of an object; ``sentence`` is the whole sentence, for the error."""
    phrase = text
    place = None
    many = None
    for name, words in zip(PLACES, PLACE_WORDS, strict=True):
        if phrase.endswith(" " + words):
            phrase = phrase.removesuffix(" " + words)
            place = name
    words_left = phrase.split(" ")
    if words_left[0] in ("a", "the"):
        many = words_left.pop(0) == "a"
    if words_left and words_left[0] in COLOURS:
        colour = words_left.pop(0)
    else:
        colour = None
    if len(words_left) != 1 or words_left[0] not in (*NOUNS, "object"):
        raise WorldError(
            f"mission {sentence!r}: {text!r} names no object; use a colour of {', '.join(COLOURS)}, a kind of "
            f"{', '.join(NOUNS)} or object, and a place of {', '.join(PLACE_WORDS)}"
        )
    return ObjectDescription(None if words_left[0] == "object" else words_left[0], colour, place, many)
