"""Verify a study: its enrolment log against its session logs, and its files against its manifest."""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

from minihuman.admin.design_decisions import verify_design_decisions
from minihuman.admin.enrolment_entries import find_incomplete_logs, find_slots_without_log, open_enrolment_log
from minihuman.admin.erasure_ledger import find_pending_machines
from minihuman.admin.manifest import GONE, find_changed_files
from minihuman.admin.session_index import find_double_sessions
from minihuman.admin.unfinished_withdrawals import find_unfinished_withdrawals
from minihuman.dataset.withdrawn_codes import read_withdrawn_codes
from minihuman.errors import LogError
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.log.names import CHAIN_KEY
from minihuman.log.paths import (
    LOG_SUFFIX,
    PART_SUFFIX,
    SYSTEM_COMPANION,
    find_log_folders,
    find_system_companions,
    group_sessions,
)
from minihuman.log.read.session_reader import read_log
from minihuman.log.salvage.summary_section import read_summary


def find_studies(folder: Path) -> list[Path]:
    """Return the folders with an enrolment log: the given folder, or else those directly inside it; [] for a file."""
    if not folder.is_dir():
        return []
    if open_enrolment_log(folder).begun:
        return [folder]
    return sorted(path for path in folder.iterdir() if path.is_dir() and open_enrolment_log(path).begun)


def find_sessions(path: Path, *, required: bool = True) -> list[Path]:
    """Return the path of every session below a folder: a log, or a folder that holds one session in several files.

    A path that is not a folder is returned as the only session.

    Args:
        path: the folder, or a log.
        required: whether at least one session must be there.

    Raises:
        LogError: if there is none, although one is required.
    """
    if not path.is_dir():
        return [path]
    session_paths: list[Path] = []
    for folder, names in find_log_folders(path):
        sessions = list(group_sessions(folder, names).values())
        if len(sessions) == 1 and len(sessions[0]) > 1:
            session_paths.append(folder)
        else:
            session_paths += chain.from_iterable(sessions)
    if not session_paths and required:
        raise LogError(
            f"{path} contains no session logs (*{LOG_SUFFIX} or *{PART_SUFFIX}); name a log or a study's folder"
        )
    return sorted(session_paths)


def verify_enrolment(study: Path) -> Iterator[tuple[str, bool]]:
    """Compare a study's enrolment log with its session logs; yield lines, each with whether it reports success.

    Each chain head must have its log, each segment of a finished log its chain head, and each taken slot a log. No
    session may be completed twice.

    Raises:
        LogError: if a line of the enrolment log is damaged.
    """
    folders = list(find_log_folders(study))
    for path in find_system_companions(folders):
        yield f"skipped {path.name}: {SYSTEM_COMPANION}", True
    for problem in find_double_sessions(folders):
        yield problem, False
    for problem in find_pending_machines(study):
        yield problem, False
    journal = open_enrolment_log(study)
    if not journal.begun:
        return
    sessions = [session for folder, names in folders for session in group_sessions(folder, names).items()]
    finished_logs = [log for log, files in sessions if log in files]
    participants = {log.name.partition("_")[0] for log, _ in sessions}
    yield from find_incomplete_logs(journal.read(), {log.name: _read_ends(log) for log in finished_logs})
    yield from find_slots_without_log(journal.read(), participants)
    for problem in find_unfinished_withdrawals(study):
        yield problem, False
    protocol = _read_protocol(finished_logs)
    if protocol:
        yield from verify_design_decisions(study, protocol)
    if journal.unchained:
        yield f"{journal.unchained} lines of the enrolment log are unchained: an earlier version wrote them", True


def _read_protocol(sessions: Sequence[Path]) -> Protocol | None:
    """Read the protocol of a study's first log; return None if it has no adaptive design, or there is no log."""
    if not sessions:
        return None
    protocol = decode_logged_protocol(read_log(sessions[0]).plan.protocol_toml)
    if protocol.allocation.design or protocol.allocation.stopping:
        return protocol
    return None


def _read_ends(log: Path) -> tuple[str, ...]:
    """Return the numbers of a finished log's segments that have a chain head; empty for a log that cannot be read."""
    summary = read_summary(log)
    if summary is None:
        return ()
    return tuple(end["segment"] for end in summary.ends if CHAIN_KEY in end)


def verify_manifest(study: Path, seal: str) -> Iterator[tuple[str, bool]]:
    """Compare a study's files with its manifest; yield lines, each with whether it reports success.

    Args:
        study: the study's folder.
        seal: the manifest's file, or its digest.

    Raises:
        LogError: if ``seal`` is neither a manifest file nor a digest.
    """
    withdrawn = read_withdrawn_codes(study)
    n_gone_files: Counter[str] = Counter()  # by the participant who withdrew
    changes: list[str] = []
    for line in find_changed_files(study, seal):
        code = line.partition("/")[0]
        if code in withdrawn and line.endswith(GONE):
            n_gone_files[code] += 1
        else:
            changes.append(line)
    for code, count in sorted(n_gone_files.items()):
        yield f"{count} files of {code} are gone: {code} withdrew after the manifest was made", True
    yield from ((line, False) for line in changes)
    if not changes and n_gone_files:
        yield "every other file is as it was sealed", True
    elif not changes:
        yield "every file is as it was sealed", True
