"""The enrolment of imported sessions: why a slot is taken, and what a study of imported sessions may hold."""

from collections.abc import Iterable
from pathlib import Path

from minihuman.admin.enrolment_entries import SlotTaken
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.storage.system import now_text
from minihuman.web.page_data.page_episodes import PageDataError


def require_only_imported(taken_slots: Iterable[SlotTaken], study: Path, source: str) -> None:
    """Require that all sessions of a study were imported from one kind of source.

    Args:
        taken_slots: the slots of the study's enrolment log.
        study: the study's folder.
        source: the text with which the reasons of slots begin that were taken by imports from this source.

    Raises:
        PageDataError: if a session was run here, or imported from another source.
    """
    for slot in taken_slots:
        if not slot.reason.startswith(source):
            raise PageDataError(
                f"{study} has {slot.participant}, whose session was run here or imported from other data; "
                "import into a study's folder of its own"
            )


def build_imported_slot(plan: SessionPlan, index: int, reason: str, *, list_length: int) -> SlotTaken:
    """Return the entry of the enrolment log for the participant of an imported session.

    Args:
        plan: the session's plan.
        index: the slot's index in the allocation list, from 0.
        reason: the source and the digest of the imported data.
        list_length: the length of the allocation list whose digest the plan has.
    """
    participant = plan.participant
    return SlotTaken(
        plan.allocation_sha256 or "",
        list_length,
        index,
        participant.id,
        participant.group,
        overridden=False,
        at=now_text(),
        reason=reason,
        outcome_rules=plan.outcome_rules,
    )
