"""Plans of texts that are shown page by page."""

from typing import Any

import msgspec

from minihuman.experiment.plan.session_plan import PartPlan


class ExampleSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A picture of a world in which some objects have labels."""

    world: str
    options: dict[str, Any] = {}
    seed: int = 0
    marks: dict[str, str] = {}  # "agent" or a thing's name -> what is written beside it


class PagePlan(PartPlan, frozen=True):
    """A text in pages, which were divided by measured height when the plan was made."""

    title: str
    pages: tuple[str, ...]
    agree: bool = False  # Enter on the last page means agreement
    sha256: str = ""  # of the whole text that is agreed to
    closing: bool = False  # the session's last words
    pictures: tuple[bytes, ...] = ()  # PNG, one a page from the first; more pages than pictures have none
    example: ExampleSpec | None = None  # drawn on the first page
    pagination: int | msgspec.UnsetType = msgspec.UNSET  # by which rules; unset for a single page, and in older logs

    @property
    def asks_consent(self) -> bool:
        """Return whether the participant must agree to the text."""
        return self.agree

    @property
    def closes_session(self) -> bool:
        """Return whether the text closes the session."""
        return self.closing
