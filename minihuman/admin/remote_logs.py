"""Store finished logs in the remote store that ``logs.url`` names, and fetch logs from there.

Without that file, logs stay where they were recorded. A log in the store is replaced only by one that continues it. A
different log of the same session gets another name beside it, both here and in the store: nothing is overwritten, and
``status`` and ``verify`` name both. Annotations made of a session on several machines are concatenated.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from minihuman.admin.erasure_ledger import STORE_FOLDER
from minihuman.dataset.annotations import ANNOTATIONS_SUFFIX, open_annotations, read_annotation_file
from minihuman.dataset.withdrawn_codes import read_withdrawn_codes
from minihuman.errors import LogError
from minihuman.log.names import CHAIN_KEY
from minihuman.log.paths import LOG_SUFFIX, is_companion_file, study_folder
from minihuman.log.record.finalization import is_whole_log, put_aside
from minihuman.log.salvage.summary_section import read_first_metadata, read_summary
from minihuman.storage.durable_files import copy_durably
from minihuman.storage.outside_names import StudyFile, parse_study_files
from minihuman.storage.remote_store import (
    LOG_DEPTH,
    DamagedCopyError,
    RemoteStore,
    RemoteStoreConflictError,
    compute_md5,
    fetch_temporarily,
    list_files,
    open_remote_store,
)
from minihuman.storage.system import current_system

Listener = Callable[[str], None]


def upload_log(log: Path) -> None:
    """Upload a finished log to its study's remote store, if there is one, unless the participant withdrew.

    If the store has a log of the session that this one does not continue, that log is kept, and this one is stored
    under another name.

    Raises:
        OSError: if the enrolment log cannot be read.
        RemoteStoreError: if the log cannot be stored; the local log is kept in any case.
    """
    study = study_folder(log)
    store = open_remote_store(study.parent)
    path_in_data = log.absolute().relative_to(study.parent)  # STUDY/CODE/ses-NN/FILE
    if store is None or path_in_data.parts[1] in read_withdrawn_codes(study):
        return
    name = StudyFile.parse(path_in_data.as_posix()).name
    try:
        store.put(name, log)
    except RemoteStoreConflictError:
        stored_version = store.versions(name)[name]
        if stored_version == compute_md5(log):
            return
        with fetch_temporarily(store, name, version=stored_version) as stored_log:
            if _continues(log, stored_log):
                store.put(name, log, over=stored_version)
            elif not _continues(stored_log, log):
                store.put(path_in_data.with_name(_make_alternative_name(log)).as_posix(), log)


def sync_logs(data: Path, prefix: str, *, say: Listener = lambda line: None) -> tuple[int, int]:
    """Fetch the logs that only the store has, and store those that only this machine has; return both numbers.

    A log grows with each of its segments: if both sides have one, the log that continues the other is the newer. If
    neither does, the store's keeps the session's name, and this machine's gets another, here and in the store.
    Annotations of a session travel with its log. Logs of participants who withdrew, according to this machine's
    enrolment log, stay where they are. Names that have no place in the study, and incomplete files, are refused.

    Args:
        data: the data folder.
        prefix: the start of the names to synchronize: "study/" or "study/sub-07/".
        say: called with a line about each file that is refused.

    Raises:
        OSError: if an enrolment log cannot be read.
        RemoteStoreError: if the store cannot be reached.
    """
    store = open_remote_store(data)
    if store is None:
        return 0, 0
    synchronization = _Synchronization(data, store, store.versions(prefix), say)
    for name, file in synchronization.list_files(prefix):
        if name.endswith(ANNOTATIONS_SUFFIX):
            synchronization.sync_annotations(file)
        elif name.endswith(LOG_SUFFIX):
            synchronization.sync_log(file)
        else:
            say(f"{name} in the remote store is neither a log nor annotations; it was not fetched")
    return synchronization.fetched, synchronization.stored


class _Synchronization:
    """One exchange of logs and annotations with a store.

    Args:
        data: the data folder.
        store: the remote store.
        versions: the versions of the files in the store, by name.
        say: called with a line about each file that is refused.
    """

    def __init__(self, data: Path, store: RemoteStore, versions: dict[str, str], say: Listener) -> None:
        self.fetched = 0
        self.stored = 0
        self._data = data
        self._store = store
        self._versions = versions
        self._say = say

    def list_files(self, prefix: str) -> list[tuple[str, StudyFile]]:
        """List the files here or in the store, in the order of names, without those of participants who withdrew.

        Files whose names have no place in the study are reported and left out.
        """
        local_files = list_files(self._data, prefix)
        local_names = [name for name in local_files if name.endswith((ANNOTATIONS_SUFFIX, LOG_SUFFIX))]
        # a store also holds the erasure ledger, as STUDY/STORE_FOLDER/ENTRY
        stored_names = [name for name in self._versions if name.split("/")[1:2] != [STORE_FOLDER]]
        files, refusals = parse_study_files({*local_names, *stored_names}, prefix)
        for refusal in refusals:
            self._say(refusal)
        studies = {file.study for file in files.values()}
        withdrawn_by_study = {study: read_withdrawn_codes(self._data / study) for study in studies}
        return [(name, file) for name, file in files.items() if file.participant not in withdrawn_by_study[file.study]]

    def sync_log(self, file: StudyFile) -> None:
        """Bring the local log and the one in the store to the same state; report a copy that is refused.

        Each log that is fetched or stored is counted.
        """
        log = file.path(self._data)
        version = self._versions.get(file.name, "")
        if not version:
            upload_log(log)
            self.stored += 1
        elif version != compute_md5(log):
            try:
                with fetch_temporarily(self._store, file.name, version=version) as stored_log:
                    if log.exists():
                        self._merge_log(file, log, stored_log, version)
                    else:
                        _require_same_session(stored_log, file)
                        copy_durably(stored_log, log, new_folders=LOG_DEPTH)
                        self.fetched += 1
            except DamagedCopyError as error:
                self._say(str(error))

    def _merge_log(self, file: StudyFile, log: Path, stored_log: Path, version: str) -> None:
        """Keep, here and in the store, the one of two logs that continues the other.

        If neither does, the local log is renamed and uploaded, too. A damaged log is replaced by the other.

        Args:
            file: the name of both logs in the study.
            log: the local log.
            stored_log: a temporary copy of the log in the store.
            version: the version of the log in the store.

        Raises:
            DamagedCopyError: if both logs are damaged, or the store's is of another session.
        """
        if compute_md5(stored_log) == compute_md5(log):
            return
        if not is_whole_log(stored_log):
            if not is_whole_log(log):
                raise DamagedCopyError(
                    f"{file.name} is damaged here and in the remote store; restore it from a backup, or run "
                    "`minihuman recover` on the log here and gather again"
                )
            self._store.put(file.name, log, over=version)
            self.stored += 1
            return
        if not is_whole_log(log):
            put_aside(log, "as-found")
        elif _continues(log, stored_log):
            self._store.put(file.name, log, over=version)
            self.stored += 1
            return
        elif not _continues(stored_log, log):
            renamed = log.with_name(_make_alternative_name(log))
            current_system().disk.rename(log, renamed)
            upload_log(renamed)
            self.stored += 1
        _require_same_session(stored_log, file)
        copy_durably(stored_log, log)
        self.fetched += 1

    def sync_annotations(self, file: StudyFile) -> None:
        """Merge the local annotations with those in the store: the store's first, then those that it lacks."""
        path = file.path(self._data)
        version = self._versions.get(file.name, "")
        if not version:
            self._store.put(file.name, path)
        elif version != compute_md5(path):
            try:
                with fetch_temporarily(self._store, file.name, version=version) as stored_path:
                    self._merge_annotations(file, path, stored_path, version)
            except DamagedCopyError as error:
                self._say(str(error))

    def _merge_annotations(self, file: StudyFile, path: Path, stored_path: Path, version: str) -> None:
        """Merge local annotations with those in the store; damaged ones in the store are replaced.

        Args:
            file: the name of both files in the study.
            path: the local annotations, which may not exist.
            stored_path: a temporary copy of the annotations in the store.
            version: the version of the annotations in the store.

        Raises:
            LogError: if the local annotations are damaged.
            DamagedCopyError: if the store's annotations are damaged and there are no local ones.
        """
        try:
            stored = read_annotation_file(stored_path)
        except LogError as error:
            if path.exists():
                read_annotation_file(path)  # raises if it is damaged, too
                self._store.put(file.name, path, over=version)
                return
            reason = str(error).replace(str(stored_path), stored_path.name)
            raise DamagedCopyError(f"{file.name} in the remote store is refused: {reason}") from error
        if not path.exists():
            copy_durably(stored_path, path, new_folders=LOG_DEPTH)
            return
        with open_annotations(path).hold() as local:
            added = [annotation for annotation in local.lines if annotation not in stored]
            if not added:
                copy_durably(stored_path, path)
                return
            if tuple(local.lines[: len(stored)]) != stored:
                with open_annotations(stored_path).hold() as merged:
                    merged.append(*added)
                copy_durably(stored_path, path)
            self._store.put(file.name, path, over=version)


class _Segment(NamedTuple):
    """The facts that identify a segment of a log."""

    number: str
    started_unix_ns: str
    head: str  # of the segment's hash chain; "" if it is missing


def _continues(log: Path, other: Path) -> bool:
    """Return whether ``log`` begins with all segments of ``other``; a log that cannot be read has no segments."""
    segments = _read_segments(log)
    other_segments = _read_segments(other)
    return len(segments) >= len(other_segments) and all(map(_is_same_segment, segments, other_segments))


def _is_same_segment(segment: _Segment, other: _Segment) -> bool:
    """Return whether two descriptions are of the same segment; a missing chain head matches any head."""
    if (segment.number, segment.started_unix_ns) != (other.number, other.started_unix_ns):
        return False
    return "" in (segment.head, other.head) or segment.head == other.head


def _read_segments(log: Path) -> list[_Segment]:
    """Return the segments of a log in order; [] for a log that cannot be read."""
    summary = read_summary(log)
    if summary is None:
        return []
    heads = {end["segment"]: end.get(CHAIN_KEY, "") for end in summary.ends}
    return [
        _Segment(start["segment"], start["started_unix_ns"], heads.get(start["segment"], ""))
        for start in summary.starts
    ]


def _require_same_session(log: Path, file: StudyFile) -> None:
    """Require that a fetched log is undamaged and of the session that its path names; other programs' files pass.

    Args:
        log: the fetched copy.
        file: the name of the log in the study.

    Raises:
        DamagedCopyError: if it is damaged, or of another session.
    """
    if is_companion_file(log):
        return
    if not is_whole_log(log):
        raise DamagedCopyError(
            f"{file.name} in the remote store is damaged and was not fetched; run `minihuman gather` on the machine "
            "that recorded it"
        )
    facts = read_first_metadata(log)
    session = f"ses-{facts.get('session', ''):0>2}"
    if (facts.get("study"), facts.get("participant"), session) != (file.study, file.participant, file.session):
        raise DamagedCopyError(f"{file.name} in the remote store is refused: it is the log of another session")


def _make_alternative_name(log: Path) -> str:
    """Return another file name for a log whose name is taken; it has the first eight digits of the log's MD5."""
    return f"{log.name.removesuffix(LOG_SUFFIX)}_other-{compute_md5(log)[:8]}{LOG_SUFFIX}"


def delete_remote_logs(study_dir: Path, code: str) -> None:
    """Delete a participant's logs from the store that ``logs.url`` names.

    Raises:
        RemoteStoreError: if the logs cannot be deleted.
    """
    study_dir = study_dir.absolute()
    # a share that is not mounted would keep its logs, so the store must exist
    store = open_remote_store(study_dir.parent, may_be_new=False)
    if store is not None:
        store.erase(code, store.names(f"{study_dir.name}/{code}/"))
