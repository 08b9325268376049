"""Pages in plans that were recorded before plans had parts: the consent text and the closing text."""

from collections.abc import Iterator

from minihuman.activities.pages.plan import PagePlan
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan
from minihuman.experiment.words import InterfaceWords


def find_early_pages(plan: SessionPlan) -> Iterator[tuple[int, PlannedPart]]:
    """Yield the pages of an early plan, each with its position in the session."""
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    if plan.consent_text and plan.segment == 1:
        text = plan.consent_text.strip()
        page = PagePlan(words["consent.title"], (text,), agree=True, sha256=plan.consent_sha256)
        yield 0, PlannedPart("page", "consent", page)
    if plan.closing_text:
        page = PagePlan(words["closing.title"], (plan.closing_text.strip(),), closing=True)
        yield 3, PlannedPart("page", "closing", page)
