"""Report a study's progress: the participant flow (CONSORT) as counts, and one line per session.

The report is computed from the enrolment log and the session index. The flow names no participant; for participants who
left before anything was recorded, only the reason is known, from the line that freed their slot. The module imports
neither NumPy nor MCAP.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.admin.enrolment_entries import (
    ParticipantWithdrawn,
    count_interventions,
    find_incomplete_logs,
    list_replaced,
    read_enrolled,
    read_enrolment_log,
)
from minihuman.admin.enrolment_flow import (
    ParticipantFlow,
    SessionRecord,
    classify_session,
    count_flow,
    count_unrecorded_departures,
    list_stages,
    parse_log_name,
)
from minihuman.admin.erasure_ledger import find_pending_machines
from minihuman.admin.recruitment import Recruitment
from minihuman.admin.session_index import SessionRow, find_double_sessions, read_session_index
from minihuman.admin.session_summary import SessionSummary
from minihuman.admin.unfinished_withdrawals import find_unfinished_withdrawals
from minihuman.garbage_collection import infrequent_collection
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
from minihuman.moved import forward_names
from minihuman.storage.outside_names import is_system_companion

if TYPE_CHECKING:
    from minihuman.dataset.annotations import Annotation

_STATE_TEXTS = {  # the text for a session's state
    "screened_out": "screened out",
    "failed": "the simulated participant failed",
    "complete": "complete",
}


def count_participant_flow(
    study_dir: Path, exclusion_reasons: Mapping[str, str] | None = None, rows: Iterable[SessionRow] | None = None
) -> ParticipantFlow:
    """Count the participants of a study's folder by outcome.

    Args:
        study_dir: the study's folder.
        exclusion_reasons: by participant of a report, the reason for exclusion, "" if included; None without a report.
        rows: the study's session index, if it has been read already.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the enrolment log cannot be read.
    """
    if rows is None:
        rows = read_session_index(study_dir)
    return count_flow(read_enrolment_log(study_dir), _list_session_records(rows), exclusion_reasons)


def _list_session_records(rows: Iterable[SessionRow]) -> Iterator[SessionRecord]:
    """Yield one record per participant and session.

    If a session has several logs, the record is that of a readable log whose file has the session's name, or else that
    of the first log.
    """
    records: dict[tuple[str, int], SessionRecord] = {}
    for row in rows:
        key_in_name = parse_log_name(row.path.name)
        if row.summary is not None:
            key = (row.summary.participant, row.summary.session)
            record = SessionRecord(*key, row.summary.group, classify_session(row.summary))
        elif key_in_name is not None:
            key = key_in_name
            record = SessionRecord(*key, "", "unreadable")
        else:
            continue
        is_preferred = key == key_in_name and record.state != "unreadable"
        if key not in records or is_preferred:
            records[key] = record
    yield from records.values()


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
    yield from _format_participants(status)
    if status.flow is not None:
        yield _format_flow(status.flow)
    if status.interventions:
        yield "audit trail: " + ", ".join(f"{count} {kind}" for kind, count in status.interventions.items())
    yield from (f"skipped {path}: {SYSTEM_COMPANION}" for path in status.companions)
    yield from status.useless_annotations
    yield from status.problems


def _format_participants(status: "StudyStatus") -> Iterator[str]:
    """Yield lines about the participants who left without data, were replaced, came online, or withdrew."""
    for kind, count in status.left_without_data.items():
        yield f"{count} {kind}"
    for code in status.replaced:
        yield f"{code:12} does not come back; the slot is offered again"
    if status.sources:
        yield "came online: " + ", ".join(f"{count} by {source}" for source, count in status.sources.items())
    if status.withdrew == 1:
        yield "1 withdrew and is excluded"
    elif status.withdrew:
        yield f"{status.withdrew} withdrew and are excluded"


def _format_flow(flow: ParticipantFlow) -> str:
    """Return the stages of the flow as one line, each followed by the losses before the next stage."""
    parts = []
    for stage in list_stages(flow):
        total = sum(stage.counts.values())
        part = f"{stage.label} {total}"
        losses = [f"{label} {sum(counts.values())}" for label, counts in stage.losses.items()]
        if losses:
            part += f" (then {', '.join(losses)})"
        parts.append(part)
    return f"flow: {'; '.join(parts)}"


def _format_sessions(status: "StudyStatus") -> Iterator[str]:
    """Yield a line for each log of a session; the line says so if the session has several logs."""
    n_logs_by_session = Counter(_identify_session(row.summary) for row in status.sessions if row.summary)
    for row in status.sessions:
        line = _format_session(row, is_running=bool(status.live) and row.path.parent in status.live)
        n_logs = 1
        if row.summary:
            n_logs = n_logs_by_session[_identify_session(row.summary)]
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
        n_without_reason = counts.pop("without a reason", 0) + sum(not note.note for note in notes)
        counts["annotations"] = len(notes)
        if n_without_reason:
            counts["without a reason"] = n_without_reason
    return counts


def _read_all_annotations(folders: LogFolders) -> Iterator[tuple[Path, "Annotation"]]:
    """Yield every annotation in the folders, with the file that holds it."""
    paths = []
    for folder, names in folders:
        paths += [folder / name for name in names if name.endswith(".jsonl") and not is_system_companion(name)]
    if paths:
        from minihuman.dataset.annotations import ANNOTATIONS_SUFFIX, read_annotation_file

        for path in paths:
            if path.name.endswith(ANNOTATIONS_SUFFIX):
                yield from ((path, annotation) for annotation in read_annotation_file(path))


def _find_useless_annotations(folders: LogFolders) -> Iterator[str]:
    """Yield a line for each annotation whose episode number is impossible in any session.

    Only ``verify`` compares the possible numbers with the plan of the annotation's session.
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
    problems = [*find_double_sessions(folders), *find_pending_machines(study_dir)]
    lines = read_enrolment_log(study_dir)
    if not lines:
        return tuple(problems)
    if rows is None:
        rows = read_session_index(study_dir, folders)
    for problem, is_acceptable in find_incomplete_logs(lines, _list_finished_segments(rows, folders)):
        if not is_acceptable:
            problems.append(problem)
    return (*problems, *find_unfinished_withdrawals(study_dir))


def _list_finished_segments(rows: Iterable[SessionRow], folders: LogFolders) -> dict[str, list[str]]:
    """Return the numbers of the finished segments that each finished log holds, by the log's name.

    Args:
        rows: the study's session index.
        folders: the folders with logs, each with its file names.
    """
    n_segments = {row.path.name: row.summary.segments for row in rows if row.summary}
    finished = {}
    for folder, names in folders:
        for log, files in group_sessions(folder, names).items():
            if log in files:
                n_live = len(files) - 1  # the other files of a session are its live segments
                n_finished = n_segments.get(log.name, 0) - n_live
                finished[log.name] = [str(number) for number in range(1, n_finished + 1)]
    return finished


@dataclass(frozen=True, slots=True)
class StudyStatus:
    """The progress of a study; it names no participant who withdrew or left no data."""

    sessions: tuple[SessionRow, ...]
    slots_without_data: tuple[str, ...]  # participants who took a slot and recorded nothing
    replaced: tuple[str, ...]  # participants whose slots are offered again
    left_without_data: Mapping[str, int]  # counts by a description of why they left
    withdrew: int
    interventions: Mapping[str, int]  # counts of manual interventions by kind
    problems: tuple[str, ...]  # as ``list_problems`` lists them
    live: frozenset[Path]  # folders in which a session is being recorded
    sources: Mapping[str, int] = field(default_factory=dict)  # counts of participants who arrived online, by source
    companions: tuple[Path, ...] = ()  # files of other systems beside logs, which are not read
    useless_annotations: tuple[str, ...] = ()  # a line for each annotation of an episode that no session has
    flow: ParticipantFlow | None = None  # None without an enrolment log


def read_study_status(study_dir: Path) -> StudyStatus:
    """Read the status that `format_status` formats.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the enrolment log cannot be read.
    """
    require_folder(study_dir, instead="a study's folder, or a session log's own")
    with infrequent_collection():
        return _gather_status(study_dir)


def _gather_status(study_dir: Path) -> StudyStatus:
    folders = list(find_log_folders(study_dir))
    rows = tuple(read_session_index(study_dir, folders))
    lines = read_enrolment_log(study_dir)
    flow = None
    if lines:
        flow = count_flow(lines, _list_session_records(rows))
    replaced = tuple(list_replaced(lines))
    has_session_or_replaced = {row.summary.participant for row in rows if row.summary}.union(replaced)
    enrolled = [slot.participant for slot in read_enrolled(study_dir)]
    withdrawn = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    return StudyStatus(
        sessions=rows,
        slots_without_data=tuple(code for code in enrolled if code not in has_session_or_replaced),
        replaced=replaced,
        left_without_data=count_unrecorded_departures(lines),
        withdrew=len(withdrawn),
        interventions=count_all_interventions(study_dir, folders),
        problems=list_problems(study_dir, rows, folders),
        live=_find_live_folders(folders),
        sources=Recruitment(study_dir).count_sources(),
        companions=tuple(find_system_companions(folders)),
        useless_annotations=tuple(_find_useless_annotations(folders)),
        flow=flow,
    )


def _find_live_folders(folders: LogFolders) -> frozenset[Path]:
    """Return the folders in which a session is being recorded."""
    live = set()
    for folder, names in folders:
        parts = [folder / name for name in names if name.endswith(PART_SUFFIX)]
        if any(map(is_being_recorded, parts)):
            live.add(folder)
    return frozenset(live)


def _identify_session(summary: SessionSummary) -> tuple[str, str, int]:
    return summary.study, summary.participant, summary.session


def _format_session(row: SessionRow, *, is_running: bool) -> str:
    """Return the line of a session's log, with aligned columns.

    Args:
        row: the session's row in the session index.
        is_running: whether the session is being recorded now.
    """
    summary = row.summary
    if summary is None:
        return f"{row.path}  cannot be read: {row.problem}"
    episodes = f"{summary.episodes_completed}/{summary.episodes_planned}"
    state = _describe_state(row, summary, is_running=is_running)
    return f"{summary.participant:12} {summary.group:16} {summary.session:7} {episodes:>9} {summary.steps:7}  {state}"


def _describe_progress(summary: SessionSummary) -> str:
    return _STATE_TEXTS.get(classify_session(summary), f"unfinished: {summary.end_reason}")


def _describe_state(row: SessionRow, summary: SessionSummary, *, is_running: bool) -> str:
    """Return how far a session is, and what is unusual about its log or its player, in a few words.

    Args:
        row: the session's row in the session index.
        summary: the summary in this row.
        is_running: whether the session is being recorded now.
    """
    if is_running:
        parts = ["running"]
    else:
        parts = [_describe_progress(summary)]
        if row.path.name.endswith(PART_SUFFIX):
            parts.append("cut off: finished at its next start")
        elif not summary.clean:
            parts.append("unclean: recovered after a cut")
    if summary.segments > 1:
        parts.append(f"{summary.segments} segments")
    if summary.player != "human":
        parts.append(summary.player)
    return ", ".join(parts)


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
