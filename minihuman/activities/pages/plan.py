"""Plans of texts in pages."""

from typing import Any

import msgspec


class ExampleSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A picture of a world, with words at some of its things."""

    world: str
    options: dict[str, Any] = {}
    seed: int = 0
    marks: dict[str, str] = {}  # "agent" or a thing's name -> what is written beside it


class PagePlan(msgspec.Struct, frozen=True):
    """A text in pages, broken by measured height when the plan was made."""

    title: str
    pages: tuple[str, ...]
    agree: bool = False  # Enter on the last page means agreement
    sha256: str = ""  # of the whole text that is agreed to
    closing: bool = False  # the session's last words
    pictures: tuple[bytes, ...] = ()  # PNG, one a page from the first; more pages than pictures have none
    example: ExampleSpec | None = None  # drawn on the first page
