"""Report a study's progress: the participant flow (CONSORT) as counts, and one line per session.

The report is computed from the enrolment log and the session index. The flow names no participant; for participants who
left before anything was recorded, only the reason is known, from the line that freed their slot. The module imports
neither NumPy nor MCAP.
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
    """The flow of participants through one session; counts by group."""

    began: GroupCounts
    complete: GroupCounts
    screened_out: GroupCounts
    unfinished: GroupCounts
    failed: GroupCounts  # simulated participants that crashed or gave no answer


@dataclass(frozen=True, slots=True)
class ParticipantFlow:
    """Counts of participants. Those who declined and came again count twice: no record could tell."""

    came: int
    before: Mapping[str, int]  # who left no data, by what they did
    allocated: GroupCounts
    withdrew: GroupCounts
    replaced: GroupCounts
    without_data: GroupCounts  # have a slot and no data
    courses: Mapping[int, SessionFlow]  # by session, from 1


def count_participant_flow(study_dir: Path) -> ParticipantFlow:
    """Count the participants by what became of them.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the register cannot be read.
    """
    lines = read_enrolment_log(study_dir)
    groups = {line.participant: line.group for line in list_taken_slots(lines)}
    gone = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    replaced = set(list_replaced(lines))
    summaries: dict[tuple[int, str], SessionSummary] = {}
    for row in read_session_index(study_dir):
        summary = row.summary
        if summary is not None and summary.participant in groups.keys() - gone:
            if row.path.name.partition(".")[0] == f"{summary.participant}_ses-{summary.session:02d}":
                summaries[summary.session, summary.participant] = summary  # not a copy beside it
            summaries.setdefault((summary.session, summary.participant), summary)
    without_data = groups.keys() - gone - {participant for _, participant in summaries}
    return ParticipantFlow(
        came=sum(isinstance(line, SlotTaken) for line in lines),
        before=count_unrecorded_departures(lines),
        allocated=_by_group(groups, groups),
        withdrew=_by_group(groups, groups.keys() & gone),
        replaced=_by_group(groups, (groups.keys() & replaced) - gone),
        without_data=_by_group(groups, without_data),
        courses={number: _session_flow(number, summaries) for number in sorted({number for number, _ in summaries})},
    )


def count_unrecorded_departures(lines: Iterable[EnrolmentEntry]) -> dict[str, int]:
    """Count those who left no data, by what they did."""
    left = Counter(_LEFT_BEFORE.get(line.why, _LEFT) for line in lines if isinstance(line, SlotFreed))
    return {kind: left[kind] for kind in (*_LEFT_BEFORE.values(), _LEFT) if left[kind]}


def _by_group(groups: Mapping[str, str], codes: Collection[str]) -> GroupCounts:
    return Counter(groups[code] for code in codes if groups[code])


def _session_flow(number: int, summaries: Mapping[tuple[int, str], SessionSummary]) -> SessionFlow:
    counts = {state: Counter[str]() for state in ("began", "complete", "screened_out", "unfinished", "failed")}
    for (session, _), summary in summaries.items():
        if session == number:
            counts["began"][summary.group] += 1
            counts[_classify(summary)][summary.group] += 1
    return SessionFlow(**counts)


def _classify(summary: SessionSummary) -> str:
    """Say what became of a session: the field of ``SessionFlow`` that counts it."""
    if summary.end_reason == "screened_out":
        return "screened_out"
    if summary.end_reason == "player_failed":
        return "failed"
    if summary.complete:
        return "complete"
    return "unfinished"


def format_status(study_dir: Path, status: "StudyStatus | None" = None) -> Iterator[str]:
    """Yield a line for each session, then one for each slot that was never played, then lines on who left the study.

    No line names a participant who withdrew.

    Args:
        study_dir: the study's folder.
        status: the study's status, if it has been read already.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the enrolment log cannot be read.
    """
    status = status or read_study_status(study_dir)
    yield f"{'participant':12} {'group':16} {'session':>7} {'episodes':>9} {'steps':>7}  state"
    yield from _format_sessions(status)
    for slot in read_enrolled(study_dir):
        if slot.participant in status.slots_without_data:
            yield f"{slot.participant:12} {slot.group:16} {'-':>7} {'-':>9} {'-':>7}  slot taken, nothing recorded"
    for kind, count in status.left_without_data.items():
        yield f"{count} {kind}"
    for code in status.replaced:
        yield f"{code:12} does not come back; the slot is offered again"
    if status.sources:
        yield "came online: " + ", ".join(f"{count} by {source}" for source, count in status.sources.items())
    if status.withdrew:
        yield f"{status.withdrew} withdrew and {'is' if status.withdrew == 1 else 'are'} excluded"
    if status.interventions:
        yield "audit trail: " + ", ".join(f"{count} {kind}" for kind, count in status.interventions.items())
    yield from (f"skipped {path}: {SYSTEM_COMPANION}" for path in status.companions)
    yield from status.useless_annotations
    yield from status.problems


def _format_sessions(status: "StudyStatus") -> Iterator[str]:
    logs = Counter(_session(row.summary) for row in status.sessions if row.summary)
    for row in status.sessions:
        line = _line(row, is_running=bool(status.live) and row.path.parent in status.live)
        n_logs = 1
        if row.summary:
            n_logs = logs[_session(row.summary)]
        if n_logs > 1:
            line += f", one of {n_logs} logs of this session, of which one counts: {row.path}"
        yield line


def count_all_interventions(study_dir: Path, folders: LogFolders | None = None) -> dict[str, int]:
    """Count the enrolment log's interventions and the annotations of a study, by kind.

    Args:
        study_dir: the study's folder.
        folders: the result of a ``find_log_folders`` call for the folder that was made just before, if any.

    Raises:
        LogError: if a line is damaged.
    """
    counts = count_interventions(read_enrolment_log(study_dir))
    if folders is None:
        folders = find_log_folders(study_dir)
    notes = [note for _, note in _read_all_annotations(folders)]
    if notes:
        missing = counts.pop("without a reason", 0) + sum(not note.note for note in notes)
        counts["annotations"] = len(notes)
        if missing:
            counts["without a reason"] = missing
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
    """Yield a line for each annotation of an episode that no session can have.

    ``verify`` compares others with the plan.
    """
    for path, annotation in _read_all_annotations(folders):
        from minihuman.dataset.annotations import MAX_EPISODES, describe_useless_annotation

        if annotation.episode is not None and not 1 <= annotation.episode <= MAX_EPISODES:
            yield f"{path}: {describe_useless_annotation(annotation)}"


def list_problems(
    study_dir: Path, rows: Iterable[SessionRow] | None = None, folders: LogFolders | None = None
) -> tuple[str, ...]:
    """List a study's problems, one line each.

    Problems are sessions completed twice, missing logs, segment ends missing from the enrolment log, unfinished
    withdrawals, and machines that have not erased their copy of a participant who withdrew.

    Args:
        study_dir: the study's folder.
        rows: the study's session index, if it has been read already.
        folders: the result of a ``find_log_folders`` call for the folder that was made just before, if any.
    """
    if folders is None:
        folders = list(find_log_folders(study_dir))
    double = (*find_double_sessions(folders), *find_pending_machines(study_dir))
    lines = read_enrolment_log(study_dir)
    if not lines:
        return double
    if rows is None:
        rows = read_session_index(study_dir, folders)
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
    """The progress of a study; it names no participant who withdrew or left no data."""

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
    """Read the status that `format_status` formats.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the enrolment log cannot be read.
    """
    require_folder(study_dir, instead="a study's folder, or a session log's own")
    folders = list(find_log_folders(study_dir))
    rows = tuple(read_session_index(study_dir, folders))
    played = {row.summary.participant for row in rows if row.summary}
    lines = read_enrolment_log(study_dir)
    return StudyStatus(
        sessions=rows,
        slots_without_data=tuple(
            slot.participant for slot in read_enrolled(study_dir) if slot.participant not in played
        ),
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
    summary = row.summary
    if summary is None:
        return f"{row.path}  cannot be read: {row.problem}"
    episodes = f"{summary.episodes_completed}/{summary.episodes_planned}"
    state = _state(row, summary, is_running=is_running)
    return f"{summary.participant:12} {summary.group:16} {summary.session:7} {episodes:>9} {summary.steps:7}  {state}"


def _progress(summary: SessionSummary) -> str:
    match _classify(summary):
        case "screened_out":
            return "screened out"
        case "failed":
            return "the simulated participant failed"
        case "complete":
            return "complete"
    return f"unfinished: {summary.end_reason}"


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
