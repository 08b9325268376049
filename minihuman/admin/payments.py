"""Bonus payments to participants: the points of each session, converted to the currency of its protocol."""

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.recruitment import PlatformId, Recruitment
from minihuman.admin.session_index import read_session_index
from minihuman.errors import AllocationError, LogError
from minihuman.experiment.machine.events import Scored
from minihuman.experiment.machine.points import compute_bonus
from minihuman.log.read.session_reader import read_log


@dataclass(frozen=True, slots=True)
class Payment:
    """The payment for one session of one participant."""

    participant: str
    session: int
    platform: str  # "" for participants who came by a link or to the lab
    id: str  # on that platform
    end: str  # why the session ended
    points: float
    bonus: float
    currency: str
    waited_min: float  # minutes in lobbies, which the bonus includes


def compute_payments(study_dir: Path) -> Iterator[Payment]:
    """Yield the payment for each recorded session, in the order of paths, without participants who withdrew.

    Raises:
        LogError: if there is no such folder, a log cannot be read, or a session is recorded twice.
        AllocationError: if the protocol of a session has no [bonus].
    """
    ids = Recruitment(study_dir).ids()
    enrolled = {line.participant for line in read_enrolled(study_dir)}
    log_paths: dict[tuple[str, int], Path] = {}  # the first log of each participant's session
    for row in read_session_index(study_dir):
        folder_code = row.path.relative_to(study_dir).parts[0]
        if row.summary is None and folder_code in enrolled:
            raise LogError(f"{row.path} cannot be read, so its payment is unknown: {row.problem}")
        if row.summary is None or row.summary.participant not in enrolled:
            continue
        session_key = (row.summary.participant, row.summary.session)
        first_path = log_paths.setdefault(session_key, row.path)
        if first_path != row.path:
            raise LogError(f"{row.path} and {first_path} record the same session; move one of them out of {study_dir}")
        yield _compute_payment(row.path, ids)


def _compute_payment(path: Path, ids: Mapping[str, PlatformId]) -> Payment:
    """Compute the payment for the session whose log is at ``path``; ``ids`` are platform ids by participant.

    Raises:
        AllocationError: if the session's protocol has no [bonus].
        LogError: if the log cannot be read.
    """
    log = read_log(path.parent)  # the folder, as a truncated segment may follow the finished log
    bonus = log.plan.bonus
    if bonus is None:
        raise AllocationError(f"{path}: the session's protocol has no [bonus], so there is nothing to pay")
    code = log.plan.participant.id
    points = next((event.total for event in reversed(log.part_events) if isinstance(event, Scored)), 0.0)
    platform_id = ids.get(code) or PlatformId(code, platform="", id="")
    has_base_pay = log.stranded or log.end_reason == "screened_out"
    return Payment(
        code,
        log.plan.session,
        platform_id.platform,
        platform_id.id,
        log.end_reason,
        points,
        round(compute_bonus(bonus, points, log.waited_ns, has_base_pay), 2),
        bonus.currency,
        log.waited_ns / 60e9,
    )


def format_payments_csv(payments: Iterator[Payment]) -> str:
    """Return payments as CSV text with a header of the field names; numbers with a fraction have two decimals."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(Payment)])
    writer.writerows(tuple(map(_format_cell, astuple(payment))) for payment in payments)
    return text.getvalue()


def _format_cell(cell: str | int | float) -> str | int:
    if isinstance(cell, float):
        return f"{cell:.2f}"
    return cell


def format_platform_payments(payments: Iterator[Payment], platform: str) -> str:
    """Format one platform's payments as lines of ``id,amount``, the form that Prolific accepts.

    An amount is the sum over a person's sessions; sums of zero are left out.
    """
    sums: dict[str, float] = {}
    for payment in payments:
        if payment.platform == platform:
            sums[payment.id] = sums.get(payment.id, 0.0) + payment.bonus
    return "".join(f"{person},{amount:.2f}\n" for person, amount in sums.items() if amount > 0)
