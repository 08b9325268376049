"""The design of a study beyond its blocks: pages, questions, orders and sessions, as the protocol file has them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import msgspec

from minihuman.study.activities.drafts import Question
from minihuman.study.activities.pages import Example

if TYPE_CHECKING:
    from minihuman.study.protocol import Block

Override = dict[str, dict[str, Any]]  # group -> fields that are others for it
Complaint = tuple[str, str]  # where, and what is wrong there and the way out


class Text(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part that is read: a consent, instructions, the last words."""

    name: str
    text: str = ""
    title: str = ""
    agree: bool = False  # the last page asks for agreement, which is logged with the text's SHA-256
    closing: bool = False  # the session's last words: closing the window over them leaves the session complete
    pictures: tuple[str, ...] = ()  # PNG files beside the protocol, one a page from the first
    example: Example | None = None  # a world's picture on the first page
    for_group: Override = {}


class Questionnaire(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part that is answered."""

    name: str
    title: str = ""
    items: tuple[Question, ...] = ()
    form: str = ""  # a shipped form instead of items: "nasa-tlx", "demographics"
    shuffle: bool = False  # the items come in an order of the participant's own
    tries: int = 1  # where items have right answers
    wrong: str = ""  # said after wrong answers, while tries are left
    back_to: str = ""  # the part to which wrong answers lead back; "" asks again at once
    failed: Literal["go_on", "end"] = "go_on"  # after the last try
    for_group: Override = {}


class Other(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a kind that a plug-in brings; its own fields are in ``plan``."""

    name: str
    kind: str  # registered in the entry-point group minihuman.activities
    plan: dict[str, Any] = {}


class Order(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Some parts in an order that depends on the participant. Its name stands for them in a list of parts."""

    name: str
    parts: tuple[str, ...]
    order: Literal["fixed", "shuffled", "latin-square"] = "latin-square"


class Day(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A session: its parts, and how many days after the one before it may be."""

    name: str
    parts: tuple[str, ...]
    days_after: tuple[int, int] | None = None  # earliest and latest


Own = TypeVar("Own", "Block", Text, Questionnaire)


def as_for(part: Own, group: str) -> Own:
    """A part with the fields that are others for a group.

    Raises:
        msgspec.ValidationError: if one of them holds what it cannot.
    """
    own = part.for_group.get(group)
    if not own:
        return part
    fields = {name: getattr(part, name) for name in part.__struct_fields__ if name != "for_group"}
    return msgspec.convert({**msgspec.to_builtins(fields), **own}, type(part))


def of_each(field: str, parts: Sequence[Own], complaints: Callable[[Own], Iterable[Complaint]]) -> Iterator[Complaint]:
    """Every (path, complaint) about parts, as they are for all.

    Args:
        field: of the protocol, which has the parts.
        parts: what it has.
        complaints: about one part, with the field of it that each is about.
    """
    for number, part in enumerate(parts):
        yield from ((f"$.{field}[{number}].{name}", what) for name, what in complaints(part))


def of_each_group(
    field: str, parts: Sequence[Own], complaints: Callable[[Own], Iterable[Complaint]]
) -> Iterator[Complaint]:
    """Every (path, complaint) about parts with the fields that are others for a group, but for those about all."""
    for number, part in enumerate(parts):
        for_all = list(complaints(part))
        for group, own in part.for_group.items():
            if {"name", "for_group"} & own.keys():
                continue
            try:
                its = as_for(part, group)
            except msgspec.ValidationError:  # which is a complaint of its own
                continue
            for name, what in complaints(its):
                if (name, what) not in for_all:
                    yield f"$.{field}[{number}].for_group.{group}.{name}", what
