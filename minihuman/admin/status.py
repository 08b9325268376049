"""Report a study's progress: the participant flow (CONSORT) in counts, and one line per session.

Counted from the enrolment log and the session index. The flow names no participant; of those who left before
anything was recorded it knows only the reason, from the line that freed their slot. It imports neither NumPy nor
MCAP.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.admin.enrolment_entries import (
    EnrolmentEntry,
    ParticipantWithdrawn,
    SlotFreed,
    SlotTaken,
    count_interventions,
    find_incomplete_logs,
    list_replaced,
    list_taken_slots,
    read_enrolled,
    read_enrolment_log,
)
from minihuman.admin.erasure_ledger import find_pending_machines
from minihuman.admin.recruitment import Recruitment
from minihuman.admin.session_index import SessionRow, find_double_sessions, read_session_index
from minihuman.admin.session_summary import SessionSummary
from minihuman.admin.unfinished_withdrawals import find_unfinished_withdrawals
from minihuman.log.paths import (
    PART_SUFFIX,
    SYSTEM_COMPANION,
    LogFolders,
    find_log_folders,
    find_system_companions,
    group_sessions,
    require_folder,
)
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.storage.outside_names import is_system_companion

if TYPE_CHECKING:
    from minihuman.dataset.annotations import Annotation

GroupCounts = Mapping[str, int]  # by group
_LEFT_BEFORE = {
    "declined": "did not agree",
    "screened_out": "screened out before a group was drawn",
    "player_failed": "simulated participants that failed before anything was recorded",
}
_LEFT = "left before anything was recorded"


@dataclass(frozen=True, slots=True)
class SessionFlow:
    """What became of one session; counts of participants by group."""

    began: GroupCounts
    complete: GroupCounts
    screened_out: GroupCounts
    unfinished: GroupCounts
    failed: GroupCounts  # simulated participants that crashed or gave no answer


@dataclass(frozen=True, slots=True)
class ParticipantFlow:
    """Counts of participants. Who declined and came again came twice: nothing is kept that could tell."""

    came: int
    before: Mapping[str, int]  # who left no data, by what they did
    allocated: GroupCounts
    withdrew: GroupCounts
    replaced: GroupCounts
    without_data: GroupCounts  # have a slot and no data
    courses: Mapping[int, SessionFlow]  # by session, from 1


def count_participant_flow(study_dir: Path) -> ParticipantFlow:
    """Count.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the register cannot be read.
    """
    lines = read_enrolment_log(study_dir)
    taken = {line.participant: line.group for line in list_taken_slots(lines)}
    gone = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    replaced = set(list_replaced(lines))
    found: dict[tuple[int, str], SessionSummary] = {}
    for row in read_session_index(study_dir):
        one = row.summary
        if one is not None and one.participant in taken.keys() - gone:
            if row.path.name.partition(".")[0] == f"{one.participant}_ses-{one.session:02d}":
                found[one.session, one.participant] = one  # not a copy beside it
            found.setdefault((one.session, one.participant), one)
    without_data = taken.keys() - gone - {participant for _, participant in found}
    return ParticipantFlow(
        came=sum(isinstance(line, SlotTaken) for line in lines),
        before=count_unrecorded_departures(lines),
        allocated=_by_group(taken, taken),
        withdrew=_by_group(taken, taken.keys() & gone),
        replaced=_by_group(taken, (taken.keys() & replaced) - gone),
        without_data=_by_group(taken, without_data),
        courses={number: _session_flow(number, found) for number in sorted({number for number, _ in found})},
    )


def count_unrecorded_departures(lines: Iterable[EnrolmentEntry]) -> dict[str, int]:
    """How many left no data, by what they did."""
    left = Counter(_LEFT_BEFORE.get(line.why, _LEFT) for line in lines if isinstance(line, SlotFreed))
    return {what: left[what] for what in (*_LEFT_BEFORE.values(), _LEFT) if left[what]}


def _by_group(groups: Mapping[str, str], codes: Collection[str]) -> GroupCounts:
    return Counter(groups[code] for code in codes if groups[code])


def _session_flow(number: int, found: Mapping[tuple[int, str], SessionSummary]) -> SessionFlow:
    here = [one for (session, _), one in found.items() if session == number]
    left = {"screened_out": "out", "player_failed": "failed"}
    states = [(one.group, left.get(one.end_reason, "complete" if one.complete else "unfinished")) for one in here]
    of = {
        state: Counter(group for group, its in states if its == state)
        for state in ("complete", "out", "unfinished", "failed")
    }
    began = Counter(one.group for one in here)
    return SessionFlow(began, of["complete"], of["out"], of["unfinished"], of["failed"])


def format_status(study_dir: Path, found: "StudyStatus | None" = None) -> Iterator[str]:
    """One line a session, then one a slot that was taken but never played, and who left; nobody is named who withdrew.

    Args:
        study_dir: the study's folder.
        found: its status, if it was read already.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the register cannot be read.
    """
    found = found or read_study_status(study_dir)
    yield f"{'participant':12} {'group':16} {'session':>7} {'episodes':>9} {'steps':>7}  state"
    logs = Counter(_session(row.summary) for row in found.sessions if row.summary)
    for row in found.sessions:
        many = logs[_session(row.summary)] if row.summary else 1
        if many > 1:
            copied = f", one of {many} logs of this session, of which one counts: {row.path}"
        else:
            copied = ""
        yield _line(row, is_running=bool(found.live) and row.path.parent in found.live) + copied
    for slot in read_enrolled(study_dir):
        if slot.participant in found.slots_without_data:
            yield f"{slot.participant:12} {slot.group:16} {'-':>7} {'-':>9} {'-':>7}  slot taken, nothing recorded"
    for what, count in found.left_without_data.items():
        yield f"{count} {what}"
    for code in found.replaced:
        yield f"{code:12} does not come back; the slot is offered again"
    if found.sources:
        yield "came online: " + ", ".join(f"{count} by {source}" for source, count in found.sources.items())
    if found.withdrew:
        yield f"{found.withdrew} withdrew and {'is' if found.withdrew == 1 else 'are'} excluded"
    if found.interventions:
        yield "audit trail: " + ", ".join(f"{count} {what}" for what, count in found.interventions.items())
    yield from (f"skipped {path}: {SYSTEM_COMPANION}" for path in found.companions)
    yield from found.useless_annotations
    yield from found.problems


def count_all_interventions(study_dir: Path, folders: LogFolders | None = None) -> dict[str, int]:
    """Count the enrolment log's interventions and the annotations of a study, by kind.

    Args:
        study_dir: the study's folder.
        folders: what ``find_log_folders`` found below it just now, if it was asked already.

    Raises:
        LogError: if a line is damaged.
    """
    counts = count_interventions(read_enrolment_log(study_dir))
    notes = [note for _, note in _read_all_annotations(find_log_folders(study_dir) if folders is None else folders)]
    if notes:
        missing = counts.pop("without a reason", 0) + sum(not note.note for note in notes)
        counts |= {"annotations": len(notes)} | ({"without a reason": missing} if missing else {})
    return counts


def _read_all_annotations(folders: LogFolders) -> Iterator[tuple[Path, "Annotation"]]:
    paths = [
        folder / name
        for folder, names in folders
        for name in names
        if name.endswith(".jsonl") and not is_system_companion(name)
    ]
    if paths:
        from minihuman.dataset.annotations import ANNOTATIONS_SUFFIX, read_annotation_file

        for path in paths:
            if path.name.endswith(ANNOTATIONS_SUFFIX):
                yield from ((path, annotation) for annotation in read_annotation_file(path))


def _find_useless_annotations(folders: LogFolders) -> Iterator[str]:
    """Name the annotations of episodes that no session can have; ``verify`` compares the others with the plan."""
    for path, annotation in _read_all_annotations(folders):
        from minihuman.dataset.annotations import MAX_EPISODES, describe_useless_annotation

        if annotation.episode is not None and not 1 <= annotation.episode <= MAX_EPISODES:
            yield f"{path}: {describe_useless_annotation(annotation)}"


def list_problems(
    study_dir: Path, rows: Iterable[SessionRow] | None = None, folders: LogFolders | None = None
) -> tuple[str, ...]:
    """Name each session completed twice, each log that is gone, each end that the enrolment log lacks, each withdrawal
    that is unfinished, and each machine that has not erased its copy.

    Args:
        study_dir: the study's folder.
        rows: its session index, if it was read already.
        folders: what ``find_log_folders`` found below it just now, if it was asked already.
    """
    folders = list(find_log_folders(study_dir)) if folders is None else folders
    double = (*find_double_sessions(folders), *find_pending_machines(study_dir))
    lines = read_enrolment_log(study_dir)
    if not lines:
        return double
    rows = read_session_index(study_dir, folders) if rows is None else rows
    segments = {row.path.name: row.summary.segments if row.summary else 0 for row in rows}
    finished = {
        log.name: [str(number) for number in range(1, segments.get(log.name, 0) - (len(files) - 1) + 1)]
        for folder, names in folders
        for log, files in group_sessions(folder, names).items()
        if log in files  # the others of a session are live segments
    }
    incomplete = (text for text, fine in find_incomplete_logs(lines, finished) if not fine)
    return (*double, *incomplete, *find_unfinished_withdrawals(study_dir))


@dataclass(frozen=True, slots=True)
class StudyStatus:
    """The progress of a study; no participant who withdrew or left no data is named."""

    sessions: tuple[SessionRow, ...]
    slots_without_data: tuple[str, ...]  # participants who took a slot and recorded nothing
    replaced: tuple[str, ...]  # participants whose slots are offered again
    left_without_data: Mapping[str, int]  # counts by what they did
    withdrew: int
    interventions: Mapping[str, int]  # what was done by hand, in counts
    problems: tuple[str, ...]  # logs that are gone, and ends of logs that the enrolment log lacks
    live: frozenset[Path]  # folders in which a session is being recorded
    sources: Mapping[str, int] = field(default_factory=dict)  # of those who came online, and have a slot
    companions: tuple[Path, ...] = ()  # files that another system keeps beside logs: they are not read
    useless_annotations: tuple[str, ...] = ()  # a line each, of those of episodes that no session has


def read_study_status(study_dir: Path) -> StudyStatus:
    """Read what `format_status` formats.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the register cannot be read.
    """
    require_folder(study_dir, instead="a study's folder, or a session log's own")
    folders = list(find_log_folders(study_dir))
    rows = tuple(read_session_index(study_dir, folders))
    played = {row.summary.participant for row in rows if row.summary}
    lines = read_enrolment_log(study_dir)
    return StudyStatus(
        sessions=rows,
        slots_without_data=tuple(one.participant for one in read_enrolled(study_dir) if one.participant not in played),
        replaced=tuple(list_replaced(lines)),
        left_without_data=count_unrecorded_departures(lines),
        withdrew=sum(isinstance(line, ParticipantWithdrawn) for line in lines),
        interventions=count_all_interventions(study_dir, folders),
        problems=list_problems(study_dir, rows, folders),
        live=frozenset(
            folder
            for folder, names in folders
            if any(name.endswith(PART_SUFFIX) and is_being_recorded(folder / name) for name in names)
        ),
        sources=Recruitment(study_dir).count_sources(),
        companions=tuple(find_system_companions(folders)),
        useless_annotations=tuple(_find_useless_annotations(folders)),
    )


def _session(summary: SessionSummary) -> tuple[str, str, int]:
    return summary.study, summary.participant, summary.session


def _line(row: SessionRow, *, is_running: bool) -> str:
    found = row.summary
    if found is None:
        return f"{row.path}  cannot be read: {row.problem}"
    episodes = f"{found.episodes_completed}/{found.episodes_planned}"
    state = _state(row, found, is_running=is_running)
    return f"{found.participant:12} {found.group:16} {found.session:7} {episodes:>9} {found.steps:7}  {state}"


def _progress(summary: SessionSummary) -> str:
    left = {"screened_out": "screened out", "player_failed": "the simulated participant failed"}
    return left.get(summary.end_reason, "complete" if summary.complete else f"unfinished: {summary.end_reason}")


def _state(row: SessionRow, summary: SessionSummary, *, is_running: bool) -> str:
    parts = ["running" if is_running else _progress(summary)]
    if not is_running and row.path.name.endswith(PART_SUFFIX):
        parts.append("cut off: finished at its next start")
    elif not is_running and not summary.clean:
        parts.append("unclean: recovered after a cut")
    if summary.segments > 1:
        parts.append(f"{summary.segments} segments")
    if summary.player != "human":
        parts.append(summary.player)
    return ", ".join(parts)
