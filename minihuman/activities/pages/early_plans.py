"""Pages in plans that were recorded before plans had parts: the consent text and the closing text."""

from collections.abc import Iterator

from minihuman.activities.pages.plan import PagePlan
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan
from minihuman.experiment.words import InterfaceWords

_CONSENT_POSITION = 0  # in an early session: before the keyboard check and the blocks
_CLOSING_POSITION = 3  # after the blocks


def find_early_pages(plan: SessionPlan) -> Iterator[tuple[int, PlannedPart]]:
    """Yield the pages of a plan from before plans had parts, each with its position among the session's parts."""
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    if plan.consent_text and plan.segment == 1:
        text = plan.consent_text.strip()
        page = PagePlan(words["consent.title"], (text,), agree=True, sha256=plan.consent_sha256)
        yield _CONSENT_POSITION, PlannedPart("page", "consent", page)
    if plan.closing_text:
        page = PagePlan(words["closing.title"], (plan.closing_text.strip(),), closing=True)
        yield _CLOSING_POSITION, PlannedPart("page", "closing", page)
