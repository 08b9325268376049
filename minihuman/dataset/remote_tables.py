"""Keep the tables of a study's sessions in the remote store that ``tables.url`` names, and bring them from there.

Without such a file no tables are stored. A table's rows of a session are a Parquet file with their digest in its name,
so a list of names tells what is stored already, and machines that store tables at the same time need no lock.
"""

import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from minihuman.dataset.log_files import read_withdrawn_codes
from minihuman.dataset.table_columns import TablePartition
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

    What is stored already is neither written nor read. The rows of sessions that this machine does not have stay, but
    those of participants who withdrew go. Cut short and done again, it does the rest.

    Args:
        study_dir: the study's folder.
        say: called with a line about each log that cannot be read: its tables stay as they are.

    Returns:
        How many files were stored and how many removed; None where there is no ``tables.url``.

    Raises:
        OSError: if the enrolment log cannot be read.
        LogError: if there is no such folder, or it holds sessions of another study.
        RemoteStoreError: if the store cannot be reached.
    """
    from minihuman.dataset.sessions import StudySessions  # a station does without tables
    from minihuman.dataset.store import StudyStore
    from minihuman.dataset.table_files import list_partitions, write_partitions

    store = _open_tables(study_dir)
    if store is None:
        return None
    study_dir = study_dir.absolute()
    there, sessions = _list_partitions(store, study_dir.name), StudySessions(study_dir, say=say)
    with StudyStore(sessions, with_shortest=False) as tables, tempfile.TemporaryDirectory() as folder:
        wanted = list_partitions(tables)
        if others := {one.study for one in wanted} - {study_dir.name}:
            raise LogError(
                f"{study_dir} holds sessions of the study {min(others)!r}; name the folder like the study, so that "
                "`minihuman withdraw` finds a participant's tables"
            )
        new = {one: number for one, number in wanted.items() if one not in there}
        for partition, path in write_partitions(tables, new, Path(folder)):
            with suppress(RemoteStoreConflictError):  # another machine has just stored the same rows
                store.put(partition.name, path)
            path.unlink()
    gone, here = read_withdrawn_codes(study_dir), {one.of_session for one in wanted}
    stale = [one for one in (*there, *new) if one.participant in gone or (one.of_session in here and one not in wanted)]
    for one in stale:
        store.remove(one.name)
    return len(new), len(stale)


def fetch_tables(source: str, folder: Path) -> tuple[int, int]:
    """Have the same tables in a folder as in the store; how many files came and how many were removed.

    Args:
        source: a study's folder, which need not exist, beside ``tables.url``; or a store, whose studies all come.
        folder: the folder. Other files in it stay.

    Raises:
        RemoteStoreError: if the store cannot be reached.
    """
    named, local = _open_tables(Path(source)), FolderStore(folder)
    store, wanted = (named, Path(source).absolute().name) if named else (open_store_url(source, may_be_new=False), "")
    here, there = _list_partitions(local, wanted), _list_partitions(store, wanted)
    if not there:  # a wrong address would empty the folder
        raise RemoteStoreError(
            f"{source} has no tables; give another address, run `minihuman gather` where the logs are, or, if all "
            f"participants withdrew, delete the tables in {folder}"
        )
    for one in there - here:
        with fetch_temporarily(store, one.name) as path:
            local.put(one.name, path)
    for one in here - there:
        local.remove(one.name)
    return len(there - here), len(here - there)


def delete_remote_tables(study_dir: Path, code: str) -> int | None:
    """Delete a participant's tables from the store that ``tables.url`` names.

    Returns:
        How many files; None where there is no ``tables.url``.

    Raises:
        RemoteStoreError: if that cannot be.
    """
    store = _open_tables(study_dir)
    if store is None:
        return None
    theirs = [one for one in _list_partitions(store, study_dir.absolute().name) if one.participant == code]
    store.erase(code, [one.name for one in theirs])
    return len(theirs)


def _open_tables(study_dir: Path) -> RemoteStore | None:
    path = study_dir.absolute().parent / TABLES_URL_FILE_NAME
    if not path.is_file():
        return None
    return open_store_url(path.read_text(encoding="utf-8").strip(), may_be_new=False)  # a share may not be mounted


def _list_partitions(store: RemoteStore, study: str) -> set[TablePartition]:
    """The partitions in a store, of one study or, for "", of all; whatever version of minihuman made them."""
    found = map(TablePartition.parse, store.names(""))
    return {one for one in found if one is not None and study in ("", one.study)}
