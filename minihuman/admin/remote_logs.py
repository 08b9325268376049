"""Keep finished logs in the remote store that ``logs.url`` names, and bring them from there.

Without such a file, logs stay where they were recorded. A log in the store is replaced only by one that continues it. A
different log of the same session gets a name of its own beside it, here and there: nothing is overwritten, and
``status`` and ``verify`` name both. Annotations of a session made on several machines are put one behind the other.
"""

from pathlib import Path

from minihuman.dataset.annotations import ANNOTATIONS_SUFFIX, open_annotations, read_annotation_file
from minihuman.dataset.withdrawn_codes import read_withdrawn_codes
from minihuman.log.names import CHAIN_KEY
from minihuman.log.paths import LOG_SUFFIX, study_folder
from minihuman.log.record.finalization import put_aside
from minihuman.log.salvage.summary_section import read_summary
from minihuman.storage.durable_files import copy_durably
from minihuman.storage.remote_store import (
    RemoteStore,
    RemoteStoreConflictError,
    compute_md5,
    fetch_temporarily,
    list_files,
    open_remote_store,
)
from minihuman.storage.system import current_system


def upload_log(log: Path) -> None:
    """Put a finished log into its study's remote store, if there is one; not a participant's who withdrew.

    Where the store has a log of the session that this one does not continue, it stays as it is, and this one is put
    beside it.

    Raises:
        OSError: if the enrolment log cannot be read.
        RemoteStoreError: if it cannot be put there; the log stays here in any case.
    """
    study = study_folder(log)
    store = open_remote_store(study.parent)
    name = log.absolute().relative_to(study.parent)
    if store is None or name.parts[1] in read_withdrawn_codes(study):
        return
    try:
        store.put(str(name), log)
    except RemoteStoreConflictError:
        stored_version = store.versions(str(name))[str(name)]
        if stored_version == compute_md5(log):
            return
        with fetch_temporarily(store, str(name)) as other:
            if _continues(log, other):
                store.put(str(name), log, over=stored_version)
            elif not _continues(other, log):
                store.put(str(name.with_name(_other_name(log))), log)


def sync_logs(data: Path, prefix: str) -> tuple[int, int]:
    """Bring here what the remote store has, and put there what it has not; how many logs came and went.

    A log grows with each of its segments: where both have one, the one that continues the other is the newer. Where
    neither does, the store's has the session's name, and this machine's gets another, here and there. Annotations of a
    session come and go with its log. Logs of participants who withdrew, by the enrolment log that this machine has,
    are left where they are.

    Args:
        data: the data folder.
        prefix: "study/" or "study/sub-07/".

    Raises:
        OSError: if an enrolment log cannot be read.
        RemoteStoreError: if the store cannot be reached.
    """
    store = open_remote_store(data)
    if store is None:
        return 0, 0
    fetched = 0
    stored = 0
    versions = _without_withdrawn(data, store.versions(prefix))
    local_names = dict.fromkeys(list_files(data, prefix), "")
    for name in sorted(_without_withdrawn(data, {**local_names, **versions})):
        if name.endswith(ANNOTATIONS_SUFFIX):
            _sync_annotations(store, name, data / name, versions.get(name, ""))
        elif name.endswith(LOG_SUFFIX):
            was_fetched, was_stored = _sync_log(store, name, data / name, versions.get(name, ""))
            fetched += was_fetched
            stored += was_stored
    return fetched, stored


def _sync_log(store: RemoteStore, name: str, log: Path, version: str) -> tuple[bool, bool]:
    """Have the same log here and in the store; whether one was fetched, and whether one was stored."""
    if not log.exists():
        store.fetch(name, log)
        return True, False
    if not version:
        upload_log(log)
        return False, True
    if version == compute_md5(log):
        return False, False
    with fetch_temporarily(store, name) as other:
        return _merge_log(store, name, log, other, version)


def _merge_log(store: RemoteStore, name: str, log: Path, other: Path, version: str) -> tuple[bool, bool]:
    """Keep the one of two logs that continues the other; where neither does, this machine's gets another name."""
    if compute_md5(other) == compute_md5(log):
        return False, False
    is_readable = read_summary(log) is not None
    if is_readable and _continues(log, other):
        store.put(name, log, over=version)
        return False, True
    is_another = is_readable and not _continues(other, log)
    if not is_readable:
        put_aside(log, "as-found")
    elif is_another:
        renamed = log.with_name(_other_name(log))
        current_system().disk.rename(log, renamed)
        upload_log(renamed)
    copy_durably(other, log)
    return True, is_another


def _sync_annotations(store: RemoteStore, name: str, path: Path, version: str) -> None:
    """Have the same annotations of a session here and in the store: the store's first, then those that it lacks."""
    if not version:
        store.put(name, path)
    elif not path.exists():
        store.fetch(name, path)
    elif version != compute_md5(path):
        with fetch_temporarily(store, name) as other, open_annotations(path).hold() as local:
            stored = read_annotation_file(other)
            added = [annotation for annotation in local.lines if annotation not in stored]
            if not added:
                copy_durably(other, path)
                return
            if tuple(local.lines[: len(stored)]) != stored:
                with open_annotations(other).hold() as merged:
                    merged.append(*added)
                copy_durably(other, path)
            store.put(name, path, over=version)


def _continues(log: Path, other: Path) -> bool:
    """Say whether a log holds all segments of another, the same ones; what cannot be read holds none."""
    segments = _read_segments(log)
    other_segments = _read_segments(other)
    return len(segments) >= len(other_segments) and all(map(_is_same_segment, segments, other_segments))


def _is_same_segment(segment: tuple[str, str, str], other: tuple[str, str, str]) -> bool:
    *identity, head = segment
    *other_identity, other_head = other
    return identity == other_identity and (not head or not other_head or head == other_head)


def _read_segments(log: Path) -> list[tuple[str, str, str]]:
    """Read the number, start and chain head of each segment; "" for a head that there is not."""
    summary = read_summary(log)
    if summary is None:
        return []
    heads = {end["segment"]: end.get(CHAIN_KEY, "") for end in summary.ends}
    return [(start["segment"], start["started_unix_ns"], heads.get(start["segment"], "")) for start in summary.starts]


def _other_name(log: Path) -> str:
    return f"{log.name.removesuffix(LOG_SUFFIX)}_other-{compute_md5(log)[:8]}{LOG_SUFFIX}"


def delete_remote_logs(study_dir: Path, code: str) -> None:
    """Delete a participant's logs from the store that ``logs.url`` names.

    Raises:
        RemoteStoreError: if that cannot be.
    """
    study_dir = study_dir.absolute()
    store = open_remote_store(study_dir.parent, may_be_new=False)  # a share that is not mounted has them still
    if store is not None:
        store.erase(code, store.names(f"{study_dir.name}/{code}/"))


def _without_withdrawn(data_folder: Path, versions: dict[str, str]) -> dict[str, str]:
    """Leave out files of participants who withdrew; a name is study, participant, session and log."""
    parts = {name: name.split("/") for name in versions}
    studies = {study for study, *_ in parts.values()}
    withdrawn = {study: read_withdrawn_codes(data_folder / study) for study in studies}
    return {name: version for name, version in versions.items() if not withdrawn[parts[name][0]] & {*parts[name][1:2]}}
