"""Remote stores for finished logs and for tables, which every machine of a study reaches: the port, and stores in a
folder and in S3.

The file ``logs.url`` of the data folder names the logs' store, ``tables.url`` that of the tables: ``s3://bucket/prefix``,
or a folder such as a network share. Without the first, logs stay where they were recorded; without the second, no
tables are stored.

A log in the store is replaced only by one that continues it. A different log of the same session gets a name of its
own beside it, here and there: nothing is overwritten, and ``status`` and ``verify`` name both. Annotations of a session
made on several machines are put one behind the other.

A table's rows of a session are a Parquet file with their digest in its name, so a list of names tells what is stored
already, and machines that store tables at the same time need no lock.
"""

import abc
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from minihuman.dataset.annotations import ANNOTATIONS_SUFFIX, open_annotations, read_annotation_file
from minihuman.dataset.log_files import read_withdrawn_codes
from minihuman.dataset.table_catalogue import TablePartition
from minihuman.errors import LogError
from minihuman.log.names import CHAIN_KEY
from minihuman.log.paths import LOG_SUFFIX, study_folder
from minihuman.log.record.file_lock import lock_file
from minihuman.log.record.finalization import put_aside
from minihuman.log.salvage.summary_section import read_summary
from minihuman.operating_system import hash_file, open_file, replace_durably, replace_file

STORE_URL_FILE_NAME = "logs.url"
TABLES_URL_FILE_NAME = "tables.url"
_S3 = "s3://"


class RemoteStoreError(LogError):
    """The remote store cannot be reached."""


class RemoteStoreConflictError(RemoteStoreError):
    """A file was put there by another machine meanwhile."""


class RemoteStore(abc.ABC):
    """Files by name, each whole or not at all."""

    @abc.abstractmethod
    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Put a file there.

        Args:
            name: of the file in the store.
            path: the file.
            over: the version that it replaces; "" where there is none.

        Raises:
            RemoteStoreConflictError: if there is another version; nothing is changed.
            RemoteStoreError: if that cannot be.
        """

    @abc.abstractmethod
    def fetch(self, name: str, path: Path) -> None:
        """Bring a file here; its folder is made.

        Raises:
            RemoteStoreError: if that cannot be.
        """

    @abc.abstractmethod
    def versions(self, prefix: str) -> dict[str, str]:
        """The version of each file whose name begins so: its MD5, hexadecimal, where the store has that.

        Raises:
            RemoteStoreError: if that cannot be.
        """

    def names(self, prefix: str) -> list[str]:
        """The names of the files that begin so.

        Raises:
            RemoteStoreError: if that cannot be.
        """
        return list(self.versions(prefix))

    @abc.abstractmethod
    def remove(self, name: str) -> None:
        """Take a file away, if it is there.

        Raises:
            RemoteStoreError: if that cannot be.
        """


class FolderStore(RemoteStore):
    """A folder that all machines have."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._unfinished = folder / ".unfinished"  # one for all, so that what a crash leaves does not stay

    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Copy it, durable before it has its name; a lock keeps the other machines out."""
        try:
            with self._locked():
                if _md5(self._folder / name) != over:
                    raise RemoteStoreConflictError(
                        f"another machine has just stored {name} in {self._folder}; run the command again"
                    )
                _copy_durably(path, self._folder / name, self._unfinished)
        except OSError as error:
            raise RemoteStoreError(
                f"{path} cannot be stored in {self._folder}: {error.strerror}; make the folder writable"
            ) from error

    def fetch(self, name: str, path: Path) -> None:
        """Copy it."""
        try:
            _copy_durably(self._folder / name, path)
        except OSError as error:
            raise RemoteStoreError(
                f"{name} cannot be fetched from {self._folder}: {error.strerror}; make it readable"
            ) from error

    def versions(self, prefix: str) -> dict[str, str]:
        """The files below, each read for its MD5."""
        return {name: _md5(self._folder / name) for name in self.names(prefix)}

    def names(self, prefix: str) -> list[str]:
        """The files below, unread."""
        return _list_files(self._folder, prefix)

    def remove(self, name: str) -> None:
        """Delete it, and the folders that are empty then: some are named after a participant."""
        try:
            with self._locked():
                (self._folder / name).unlink(missing_ok=True)
                with suppress(OSError):  # not empty
                    for folder in PurePosixPath(name).parents[:-1]:
                        (self._folder / folder).rmdir()
        except OSError as error:
            raise RemoteStoreError(
                f"{name} cannot be removed from {self._folder}: {error.strerror}; make the folder writable"
            ) from error

    @contextmanager
    def _locked(self) -> Iterator[None]:
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / ".lock"
        fd = open_file(path, os.O_CREAT | os.O_RDWR, 0o666)
        try:
            lock_file(fd, path)
            self._unfinished.unlink(missing_ok=True)
            yield
        finally:
            os.close(fd)


def open_remote_store(data: Path) -> RemoteStore | None:
    """The remote store that a data folder names for logs; None where it names none."""
    path = data / STORE_URL_FILE_NAME
    return _open_url(path.read_text(encoding="utf-8").strip()) if path.is_file() else None


def _open_url(url: str, *, may_be_new: bool = True) -> RemoteStore:
    if url.startswith(_S3):
        return S3Store(url.removeprefix(_S3))
    if not (may_be_new or (url and Path(url).is_dir())):
        raise RemoteStoreError(f"{url!r} cannot be used as a store of tables: it is not a folder; mount or create it")
    return FolderStore(Path(url))


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
        if there == _md5(log):
            return
        with _fetched(store, str(name)) as other:
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
    names = _without_withdrawn(data, {**there, **dict.fromkeys(_list_files(data, prefix), "")})
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
        elif there[name] != _md5(log):
            with _fetched(store, name) as other:
                if _md5(other) == _md5(log):
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
                _copy_durably(other, log)
                came += 1
    return came, went


def _sync_annotations(store: RemoteStore, name: str, path: Path, version: str) -> None:
    """Have the same annotations of a session here and in the store: the store's first, then those that it lacks."""
    if not version:
        store.put(name, path)
    elif not path.exists():
        store.fetch(name, path)
    elif version != _md5(path):
        with _fetched(store, name) as other, open_annotations(path).hold() as here:
            theirs = read_annotation_file(other)
            if added := [mark for mark in here.lines if mark not in theirs]:
                if tuple(here.lines[: len(theirs)]) != theirs:
                    with open_annotations(other).hold() as merged:
                        merged.append(*added)
                    _copy_durably(other, path)
                store.put(name, path, over=version)
            else:
                _copy_durably(other, path)


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
    return f"{log.name.removesuffix(LOG_SUFFIX)}_other-{_md5(log)[:8]}{LOG_SUFFIX}"


@contextmanager
def _fetched(store: RemoteStore, name: str) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="minihuman-") as folder:
        path = Path(folder, PurePosixPath(name).name)
        store.fetch(name, path)
        yield path


def delete_remote_logs(data: Path, prefix: str) -> None:
    """Delete the logs whose names begin so from the remote store.

    Raises:
        RemoteStoreError: if that cannot be.
    """
    store = open_remote_store(data)
    if store is not None:
        for name in store.names(prefix):
            store.remove(name)


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
    store, wanted = (named, Path(source).absolute().name) if named else (_open_url(source, may_be_new=False), "")
    here, there = _list_partitions(local, wanted), _list_partitions(store, wanted)
    if not there:  # a wrong address would empty the folder
        raise RemoteStoreError(
            f"{source} has no tables; give another address, run `minihuman gather` where the logs are, or, if all "
            f"participants withdrew, delete the tables in {folder}"
        )
    for one in there - here:
        with _fetched(store, one.name) as path:
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
    for one in theirs:
        store.remove(one.name)
    return len(theirs)


def _open_tables(study_dir: Path) -> RemoteStore | None:
    path = study_dir.absolute().parent / TABLES_URL_FILE_NAME
    if not path.is_file():
        return None
    return _open_url(path.read_text(encoding="utf-8").strip(), may_be_new=False)  # a share may not be mounted


def _list_partitions(store: RemoteStore, study: str) -> set[TablePartition]:
    """The partitions in a store, of one study or, for "", of all; whatever version of minihuman made them."""
    found = map(TablePartition.parse, store.names(""))
    return {one for one in found if one is not None and study in ("", one.study)}


def _list_files(folder: Path, prefix: str) -> list[str]:
    """The files in a folder whose paths from there begin so, but for hidden ones."""
    below = folder / prefix.rpartition("/")[0]
    files = (path for path in below.rglob("*") if path.is_file() and not path.name.startswith("."))
    return [name for path in sorted(files) if (name := path.relative_to(folder).as_posix()).startswith(prefix)]


def _without_withdrawn(data: Path, found: dict[str, str]) -> dict[str, str]:
    """What is not of participants who withdrew; a name is study, participant, session and log."""
    parts = {name: name.split("/") for name in found}
    gone = {study: read_withdrawn_codes(data / study) for study in {its[0] for its in parts.values()}}
    return {name: each for name, each in found.items() if not gone[parts[name][0]].intersection(parts[name][1:2])}


def _md5(path: Path) -> str:
    """A file's; "" where there is none."""
    try:
        return hash_file(path, "md5")
    except FileNotFoundError:
        return ""


def _copy_durably(path: Path, to: Path, unfinished: Path | None = None) -> None:
    with path.open("rb") as source, replace_durably(to, unfinished) as target:
        shutil.copyfileobj(source, target)


_CONFLICTS = ("PreconditionFailed", "ConditionalRequestConflict", "412", "409")


class S3Store(RemoteStore):
    """Objects of a bucket. The store's address, keys and region are boto3's to find: ``AWS_ENDPOINT_URL`` and the like.

    Args:
        where: the bucket, and what all names begin with: "bucket/prefix".
    """

    def __init__(self, where: str) -> None:
        import boto3  # an extra

        self._bucket, _, prefix = where.partition("/")
        self._prefix = f"{prefix.rstrip('/')}/" if prefix else ""
        self._client = boto3.client("s3")

    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Send it, on the condition that the store has that version; the store shows it when all of it is there."""
        condition = {"IfMatch": f'"{over}"'} if over else {"IfNoneMatch": "*"}
        with self._said(f"{path} cannot be put into"), path.open("rb") as file:
            self._client.put_object(Bucket=self._bucket, Key=self._prefix + name, Body=file, **condition)

    def fetch(self, name: str, path: Path) -> None:
        """Get it, beside its place first."""
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        with self._said(f"{name} cannot be fetched from"):
            try:
                self._client.download_file(self._bucket, self._prefix + name, str(beside))
                replace_file(beside, path)
            finally:
                beside.unlink(missing_ok=True)

    def versions(self, prefix: str) -> dict[str, str]:
        """The objects' entity tags, page by page."""
        with self._said("nothing can be listed of"):
            pages = self._client.get_paginator("list_objects_v2").paginate(
                Bucket=self._bucket, Prefix=self._prefix + prefix
            )
            found = [one for page in pages for one in page.get("Contents", ())]
        return {one["Key"].removeprefix(self._prefix): one["ETag"].strip('"') for one in found}

    def remove(self, name: str) -> None:
        """Delete it."""
        with self._said(f"{name} cannot be removed from"):
            self._client.delete_object(Bucket=self._bucket, Key=self._prefix + name)

    @contextmanager
    def _said(self, what: str) -> Iterator[None]:
        from botocore.exceptions import BotoCoreError, ClientError

        try:
            yield
        except (BotoCoreError, ClientError) as error:
            if isinstance(error, ClientError) and error.response["Error"].get("Code") in _CONFLICTS:
                raise RemoteStoreConflictError(
                    f"{what} {self._bucket}, as another machine has just changed it; run the command again"
                ) from error
            raise RemoteStoreError(f"{what} {self._bucket}: {error}") from error
