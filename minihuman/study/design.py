"""The design of a study beyond its blocks: pages, questions, orders and sessions, as the protocol file has them."""

from typing import Any, Literal

import msgspec

from minihuman.study.activities.drafts import Question
from minihuman.study.activities.pages import Example

Override = dict[str, dict[str, Any]]  # group -> fields that are others for it


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
