"""Keep finished logs in the remote store that ``logs.url`` names, and bring them from there.

Without such a file, logs stay where they were recorded. A log in the store is replaced only by one that continues it. A
different log of the same session gets a name of its own beside it, here and there: nothing is overwritten, and
``status`` and ``verify`` name both. Annotations of a session made on several machines are put one behind the other.
"""

from pathlib import Path

from minihuman.dataset.annotations import ANNOTATIONS_SUFFIX, open_annotations, read_annotation_file
from minihuman.dataset.log_files import read_withdrawn_codes
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


def upload_log(log: Path) -> None:
    """Put a finished log into its study's remote store, if there is one; not a participant's who withdrew.

    Where the store has a log of the session that this one does not continue, it stays as it is, and this one is put
    beside it.

    Raises:
        OSError: if the enrolment log cannot be read.
        RemoteStoreError: if it cannot be put there; the log stays here in any case.
    """
    study = study_folder(log)
    store, name = open_remote_store(study.parent), log.absolute().relative_to(study.parent)
    if store is None or name.parts[1] in read_withdrawn_codes(study):
        return
    try:
        store.put(str(name), log)
    except RemoteStoreConflictError:
        there = store.versions(str(name))[str(name)]
        if there == compute_md5(log):
            return
        with fetch_temporarily(store, str(name)) as other:
            if _continues(log, other):
                store.put(str(name), log, over=there)
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
    came = went = 0
    there = _without_withdrawn(data, store.versions(prefix))
    names = _without_withdrawn(data, {**there, **dict.fromkeys(list_files(data, prefix), "")})
    for name in sorted(name for name in names if name.endswith((LOG_SUFFIX, ANNOTATIONS_SUFFIX))):
        log = data / name
        if name.endswith(ANNOTATIONS_SUFFIX):
            _sync_annotations(store, name, log, there.get(name, ""))
        elif not log.exists():
            store.fetch(name, log)
            came += 1
        elif name not in there:
            upload_log(log)
            went += 1
        elif there[name] != compute_md5(log):
            with fetch_temporarily(store, name) as other:
                if compute_md5(other) == compute_md5(log):
                    continue
                if read_summary(log) is not None and _continues(log, other):
                    store.put(name, log, over=there[name])
                    went += 1
                    continue
                if read_summary(log) is None:
                    put_aside(log, "as-found")
                elif not _continues(other, log):
                    beside = log.with_name(_other_name(log))
                    log.rename(beside)
                    upload_log(beside)
                    went += 1
                copy_durably(other, log)
                came += 1
    return came, went


def _sync_annotations(store: RemoteStore, name: str, path: Path, version: str) -> None:
    """Have the same annotations of a session here and in the store: the store's first, then those that it lacks."""
    if not version:
        store.put(name, path)
    elif not path.exists():
        store.fetch(name, path)
    elif version != compute_md5(path):
        with fetch_temporarily(store, name) as other, open_annotations(path).hold() as here:
            theirs = read_annotation_file(other)
            if added := [mark for mark in here.lines if mark not in theirs]:
                if tuple(here.lines[: len(theirs)]) != theirs:
                    with open_annotations(other).hold() as merged:
                        merged.append(*added)
                    copy_durably(other, path)
                store.put(name, path, over=version)
            else:
                copy_durably(other, path)


def _continues(log: Path, other: Path) -> bool:
    """Whether a log holds all segments of another, the same ones; what cannot be read holds none."""
    mine, theirs = _read_segments(log), _read_segments(other)
    same = (
        number == its_number and started == its_start and (not head or not its_head or head == its_head)
        for (number, started, head), (its_number, its_start, its_head) in zip(mine, theirs, strict=False)
    )
    return len(mine) >= len(theirs) and all(same)


def _read_segments(log: Path) -> list[tuple[str, str, str]]:
    """The number, start and chain head of each segment; "" for a head that there is not."""
    found = read_summary(log)
    if found is None:
        return []
    heads = {end["segment"]: end.get(CHAIN_KEY, "") for end in found.ends}
    return [(start["segment"], start["started_unix_ns"], heads.get(start["segment"], "")) for start in found.starts]


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


def _without_withdrawn(data: Path, found: dict[str, str]) -> dict[str, str]:
    """What is not of participants who withdrew; a name is study, participant, session and log."""
    parts = {name: name.split("/") for name in found}
    gone = {study: read_withdrawn_codes(data / study) for study in {its[0] for its in parts.values()}}
    return {name: each for name, each in found.items() if not gone[parts[name][0]].intersection(parts[name][1:2])}
