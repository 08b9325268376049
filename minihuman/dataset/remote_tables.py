"""Store the tables of a study's sessions in the remote store that ``tables.url`` names, and fetch them from there.

No tables are stored if that file does not exist. One session's rows of one table are a Parquet file with their digest
in its name, so that a listing of names shows what is already stored, and several machines can store tables at the same
time without a lock.
"""

import tempfile
from collections.abc import Callable, Iterable, Iterator, Set
from contextlib import suppress
from pathlib import Path

from minihuman.dataset.table_catalogue import TablePartition
from minihuman.dataset.withdrawn_codes import read_withdrawn_codes
from minihuman.errors import LogError
from minihuman.storage.remote_store import (
    TABLES_URL_FILE_NAME,
    FolderStore,
    RemoteStore,
    RemoteStoreConflictError,
    RemoteStoreError,
    fetch_temporarily,
    open_store_url,
)


def store_tables(study_dir: Path, *, say: Callable[[str], None] = lambda line: None) -> tuple[int, int] | None:
    """Put the tables of a study's sessions into the store that ``tables.url`` names, and remove the rows they replace.

    What is already stored is neither read nor written. The rows of sessions that this machine does not have are kept,
    except those of participants who withdrew. If interrupted, it completes the work when called again.

    Args:
        study_dir: the study's folder.
        say: called with a line about each log that cannot be read; the stored tables of such a log are kept.

    Returns:
        The number of files stored and the number removed; None if there is no ``tables.url``.

    Raises:
        OSError: if the enrolment log cannot be read.
        LogError: if there is no such folder, or it holds sessions of another study.
        RemoteStoreError: if the store cannot be reached.
    """
    from minihuman.dataset.sessions import StudySessions  # a station does without tables
    from minihuman.dataset.store import StudyStore
    from minihuman.dataset.table_files import list_partitions, write_partitions

    store = _open_table_store(study_dir)
    if store is None:
        return None
    study_dir = study_dir.absolute()
    stored = _list_partitions(store, study_dir.name)
    sessions = StudySessions(study_dir, say=say)
    with StudyStore(sessions, with_shortest=False) as tables, tempfile.TemporaryDirectory() as folder:
        partitions = list_partitions(tables)
        _require_study(study_dir, partitions)
        new = {partition: number for partition, number in partitions.items() if partition not in stored}
        for partition, path in write_partitions(tables, new, Path(folder)):
            with suppress(RemoteStoreConflictError):  # another machine has just stored the same rows
                store.put(partition.name, path)
            path.unlink()
    stale = list(_find_stale_partitions(stored | new.keys(), partitions.keys(), read_withdrawn_codes(study_dir)))
    for partition in stale:
        store.remove(partition.name)
    return len(new), len(stale)


def _require_study(study_dir: Path, partitions: Iterable[TablePartition]) -> None:
    """Raise LogError if a partition is of another study than the one that the folder is named after."""
    other_studies = {partition.study for partition in partitions} - {study_dir.name}
    if other_studies:
        raise LogError(
            f"{study_dir} holds sessions of the study {min(other_studies)!r}; name the folder like the study, so that "
            "`minihuman withdraw` finds a participant's tables"
        )


def _find_stale_partitions(
    stored: Set[TablePartition], local: Set[TablePartition], withdrawn: Set[str]
) -> Iterator[TablePartition]:
    """Yield the stored partitions of participants who withdrew, and of sessions whose local rows differ."""
    local_sessions = {partition.of_session for partition in local}
    for partition in stored:
        is_replaced = partition.of_session in local_sessions and partition not in local
        if partition.participant in withdrawn or is_replaced:
            yield partition


def fetch_tables(source: str, folder: Path, *, say: Callable[[str], None] = lambda line: None) -> tuple[int, int]:
    """Make a folder hold the same tables as the store; return the numbers of fetched and of removed files.

    A damaged file in the store is not fetched but removed, so that the machine that has the log stores it again.

    Args:
        source: a study's folder, which need not exist, beside ``tables.url``; or the address of a store, from which the
            tables of all studies are fetched.
        folder: the folder to fill. Other files in it are kept.
        say: called with a line about each damaged file.

    Raises:
        RemoteStoreError: if the store cannot be reached, or has no tables.
    """
    local_store = FolderStore(folder)
    store = _open_table_store(Path(source))
    study = Path(source).absolute().name
    if store is None:
        store = open_store_url(source, may_be_new=False)
        study = ""
    local = _list_partitions(local_store, study)
    stored = _list_partitions(store, study)
    if not stored:  # a wrong address would empty the folder
        raise RemoteStoreError(
            f"{source} has no tables; give another address, run `minihuman gather` where the logs are, or, if all "
            f"participants withdrew, delete the tables in {folder}"
        )
    missing = sorted(stored - local, key=lambda partition: partition.name)
    n_fetched = 0
    for partition in missing:
        if _fetch_partition(store, local_store, partition, say):
            n_fetched += 1
    for partition in local - stored:
        local_store.remove(partition.name)
    return n_fetched, len(local - stored)


def _fetch_partition(
    store: RemoteStore, local_store: RemoteStore, partition: TablePartition, say: Callable[[str], None]
) -> bool:
    """Fetch a partition into the local store, and return whether it was fetched.

    A damaged partition is not fetched but removed from the remote store, if that can be written; ``say`` is called with
    a line about it.
    """
    from minihuman.dataset.table_files import find_partition_damage

    with fetch_temporarily(store, partition.name) as path:
        damage = find_partition_damage(path, partition)
        if not damage:
            local_store.put(partition.name, path)
            return True
    with suppress(RemoteStoreError):  # it may only be read there
        store.remove(partition.name)
    say(
        f"{partition.name} in the remote store is damaged and was not fetched: {damage}; run `minihuman gather` on the "
        "machine that has the log, which stores it again"
    )
    return False


def delete_remote_tables(study_dir: Path, code: str) -> int | None:
    """Delete a participant's tables from the store that ``tables.url`` names.

    Returns:
        The number of deleted files; None if there is no ``tables.url``.

    Raises:
        RemoteStoreError: if the tables cannot be deleted.
    """
    store = _open_table_store(study_dir)
    if store is None:
        return None
    stored = _list_partitions(store, study_dir.absolute().name)
    names = [partition.name for partition in stored if partition.participant == code]
    store.erase(code, names)
    return len(names)


def _open_table_store(study_dir: Path) -> RemoteStore | None:
    """Open the store that ``tables.url`` beside the study's folder names; None if there is no such file."""
    path = study_dir.absolute().parent / TABLES_URL_FILE_NAME
    if not path.is_file():
        return None
    return open_store_url(path.read_text(encoding="utf-8").strip(), may_be_new=False)  # a share may not be mounted


def _list_partitions(store: RemoteStore, study: str) -> set[TablePartition]:
    """Return a store's partitions of one study, or of all studies if ``study`` is ""; other files are ignored."""
    partitions = map(TablePartition.parse, store.names(""))
    return {partition for partition in partitions if partition is not None and study in ("", partition.study)}
