"""Remote stores, which every machine of a study can reach: the interface, and stores in a folder and in S3.

The file ``logs.url`` in the data folder names the store of finished logs, and ``tables.url`` that of tables:
``s3://bucket/prefix``, or a folder such as a network share.
"""

import abc
import re
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from minihuman.errors import LogError
from minihuman.storage.deadlines import call_within
from minihuman.storage.durable_files import copy_durably, hash_file, replace_durably, sync_folder
from minihuman.storage.locks import hold_lock
from minihuman.storage.outside_names import join_inside
from minihuman.storage.redaction import redact, remember_address
from minihuman.storage.system import current_system

STORE_URL_FILE_NAME = "logs.url"
TABLES_URL_FILE_NAME = "tables.url"
_S3 = "s3://"
_MD5 = re.compile(r"[0-9a-f]{32}")
LOG_DEPTH = 3  # folders above a log: session, participant and study


class RemoteStoreError(LogError):
    """The remote store cannot be used; secrets are removed from the message."""

    def __init__(self, message: str) -> None:
        super().__init__(redact(message))


class RemoteStoreConflictError(RemoteStoreError):
    """Another machine has stored a different version of the file in the meantime."""


class DamagedCopyError(RemoteStoreError):
    """A file in the remote store does not match its name or its digest, so it is refused."""


class RemoteStore(abc.ABC):
    """A store of named files, each of which is stored whole or not at all."""

    @abc.abstractmethod
    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Store a file.

        Args:
            name: the file's name in the store.
            path: the local path of the file.
            over: the version that the file replaces, as in ``versions``; "" if the store must not have the file.

        Raises:
            RemoteStoreConflictError: if the store has another version; nothing is changed.
            RemoteStoreError: if the file cannot be stored.
        """

    @abc.abstractmethod
    def fetch(self, name: str, path: Path) -> None:
        """Download a file to a local path, whose folder is created.

        Raises:
            RemoteStoreError: if the file cannot be fetched.
        """

    @abc.abstractmethod
    def versions(self, prefix: str) -> dict[str, str]:
        """Return the versions of the files whose names begin with ``prefix``, by name; a version is an MD5 if possible.

        Raises:
            RemoteStoreError: if the files cannot be listed.
        """

    def names(self, prefix: str) -> list[str]:
        """Return the names of the files whose names begin with ``prefix``.

        Raises:
            RemoteStoreError: if the files cannot be listed.
        """
        return list(self.versions(prefix))

    @abc.abstractmethod
    def remove(self, name: str) -> None:
        """Delete a file durably, if it exists.

        Raises:
            RemoteStoreError: if the file cannot be deleted.
        """

    def erase(self, owner: str, names: Iterable[str]) -> None:
        """Delete a participant's files, and any incomplete file that an interrupted upload left.

        Args:
            owner: the participant's code.
            names: the names of the files.

        Raises:
            RemoteStoreError: if a file cannot be deleted.
        """
        for name in names:
            self.remove(name)


class FolderStore(RemoteStore):
    """A remote store in a folder that all machines share."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._unfinished = folder / ".unfinished"  # one for all files: after a crash the next call removes it

    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Copy a file into the folder under a lock against other machines; it is durable before it gets its name."""
        try:
            with self._locked():
                if compute_md5(join_inside(self._folder, name)) != over:
                    raise RemoteStoreConflictError(
                        f"another machine has just stored {name} in {self._folder}; run the command again"
                    )
                mode = self._folder.stat().st_mode  # users who may read the shared folder may read its files
                target = join_inside(self._folder, name)
                current_system().disk.make_folder(target.parent, stat.S_IMODE(mode) | 0o700)
                # the folder's permissions without those to execute, and at least the owner's to read and write
                copy_durably(path, target, self._unfinished, mode=mode & 0o666 | 0o600, new_folders=LOG_DEPTH)
        except OSError as error:
            raise RemoteStoreError(
                f"{path} cannot be stored in {self._folder}: {error.strerror}; make the folder writable"
            ) from error

    def fetch(self, name: str, path: Path) -> None:
        """Copy a file out of the folder to a local path, whose folder is created."""
        try:
            copy_durably(join_inside(self._folder, name), path, new_folders=LOG_DEPTH)
        except OSError as error:
            raise RemoteStoreError(
                f"{name} cannot be fetched from {self._folder}: {error.strerror}; make it readable"
            ) from error

    def versions(self, prefix: str) -> dict[str, str]:
        """Return the MD5 of each file whose name begins with ``prefix``, which requires reading all of them."""
        return {name: compute_md5(join_inside(self._folder, name)) for name in self.names(prefix)}

    def names(self, prefix: str) -> list[str]:
        """Return the names of the files that begin with ``prefix``, without reading the files."""
        return list_files(self._folder, prefix)

    def remove(self, name: str) -> None:
        """Delete a file and any folders that become empty, since some are named after a participant."""
        with self._raise_as_store_error(name), self._locked():
            self._remove(name)

    def erase(self, owner: str, names: Iterable[str]) -> None:
        """Delete a participant's files, their empty folders, and any incomplete file of an interrupted upload."""
        with self._raise_as_store_error(f"all of {owner}"), self._locked():
            sync_folder(self._folder)  # locking has removed the incomplete file, which may be the participant's
            for name in names:
                self._remove(name)
            empty_folders = [path for path in self._folder.rglob("*") if path.is_dir() and not any(path.iterdir())]
            for folder in empty_folders:
                parts = folder.relative_to(self._folder).parts
                if owner in {part.rpartition("=")[2] for part in parts}:  # sub-07, or participant=sub-07 of tables
                    self._remove_empty_folders(folder)

    def _remove(self, name: str) -> None:
        path = join_inside(self._folder, name)
        if path.exists():
            current_system().disk.unlink(path)
        if path.parent.is_dir():
            self._remove_empty_folders(path.parent)

    def _remove_empty_folders(self, folder: Path) -> None:
        """Make removals from a folder durable, then remove the folder and its parents as far as they are empty."""
        sync_folder(folder)  # first: a folder that is gone can no longer be synced, and its files might come back
        with suppress(OSError):  # not empty
            while folder != self._folder:
                current_system().disk.remove_folder(folder)
                folder = folder.parent
        sync_folder(folder)

    @contextmanager
    def _raise_as_store_error(self, name: str) -> Iterator[None]:
        """Convert an ``OSError`` to a ``RemoteStoreError`` that says that ``name`` cannot be removed."""
        try:
            yield
        except OSError as error:
            raise RemoteStoreError(
                f"{name} cannot be removed from {self._folder}: {error.strerror}; make the folder writable"
            ) from error

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Lock the folder against other machines, and remove a file that an interrupted call left unfinished."""
        with hold_lock(self._folder / ".lock", 0o666):  # which every user of the shared folder opens for writing
            if self._unfinished.exists():
                current_system().disk.unlink(self._unfinished)
            yield


def open_remote_store(data: Path, *, may_be_new: bool = True) -> RemoteStore | None:
    """Open the remote store that a data folder names for logs; return None if it names none.

    Args:
        data: the data folder.
        may_be_new: whether the store may be a folder that does not exist yet, as in ``open_store_url``.

    Raises:
        RemoteStoreError: if the store is a folder that must exist but does not, or the address of an S3 store is not
            valid.
    """
    path = data / STORE_URL_FILE_NAME
    if path.is_file():
        return open_store_url(path.read_text(encoding="utf-8").strip(), may_be_new=may_be_new)
    return None


def open_store_url(url: str, *, may_be_new: bool = True) -> RemoteStore:
    """Open the store at an address.

    Args:
        url: the address, as in ``logs.url``.
        may_be_new: whether the store may be a folder that does not exist yet. Otherwise it is refused, since it may be
            a network share that is not mounted.

    Raises:
        RemoteStoreError: if the folder is refused, or the address of an S3 store is not valid.
    """
    remember_address(url)
    if url.startswith(_S3):
        return S3Store(url.removeprefix(_S3))
    if not (may_be_new or (url and Path(url).is_dir())):
        raise RemoteStoreError(f"{url!r} cannot be used as a remote store: it is not a folder; mount or create it")
    return FolderStore(Path(url))


@contextmanager
def fetch_temporarily(store: RemoteStore, name: str, *, version: str = "") -> Iterator[Path]:
    """Download a file to a temporary folder, check its MD5, and yield its path; the folder is deleted at the end.

    Args:
        store: the store.
        name: the file's name in the store, whose form the caller has checked.
        version: the file's version as listed by the store, which is compared with the file's MD5 if it is one.

    Raises:
        RemoteStoreError: if the file cannot be fetched.
        DamagedCopyError: if the file does not have the MD5 that was listed.
    """
    with tempfile.TemporaryDirectory(prefix="minihuman-") as folder:
        path = join_inside(Path(folder), name.rpartition("/")[2])
        store.fetch(name, path)
        if _MD5.fullmatch(version) and compute_md5(path) != version:
            raise DamagedCopyError(f"{name} in the remote store is refused: it did not arrive as listed; gather again")
        yield path


def list_files(folder: Path, prefix: str) -> list[str]:
    """List the files below a folder whose paths relative to it begin with ``prefix``, except hidden files.

    Returns:
        The relative paths with slashes, sorted.
    """
    searched_folder = folder / prefix.rpartition("/")[0]
    files = (path for path in searched_folder.rglob("*") if path.is_file() and not path.name.startswith("."))
    names = (path.relative_to(folder).as_posix() for path in sorted(files))
    return [name for name in names if name.startswith(prefix)]


def compute_md5(path: Path) -> str:
    """Return a file's MD5 in hexadecimal; "" if the file does not exist."""
    try:
        return hash_file(path, "md5")
    except FileNotFoundError:
        return ""


STORE_TIMEOUT_S = 60.0  # for one whole answer
_CONNECT_TIMEOUT_S = 10
_READ_TIMEOUT_S = 30
_SLOWEST_BYTES_PER_S = 50_000  # a slower transfer is cut off
_CONFLICT_CODES = ("PreconditionFailed", "ConditionalRequestConflict", "412", "409")


def _compute_transfer_timeout_s(size_bytes: int) -> float:
    """Return the longest total time for the transfer of a file of a given size, in seconds."""
    return STORE_TIMEOUT_S + size_bytes / _SLOWEST_BYTES_PER_S


class S3Store(RemoteStore):
    """A remote store in an S3 bucket; endpoint, keys and region are boto3's settings (``AWS_ENDPOINT_URL``).

    Args:
        address: the bucket and the prefix of all names, "bucket/prefix".
    """

    def __init__(self, address: str) -> None:
        import boto3  # an extra
        from botocore.config import Config
        from botocore.exceptions import BotoCoreError

        if "@" in address:
            raise RemoteStoreError(
                "the address of the remote store holds a key or a password; give s3://BUCKET/PREFIX, and the key in "
                "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
            )
        self._bucket, _, prefix = address.partition("/")
        self._prefix = f"{prefix.rstrip('/')}/" if prefix else ""
        timeouts = Config(connect_timeout=_CONNECT_TIMEOUT_S, read_timeout=_READ_TIMEOUT_S)
        try:
            self._client = boto3.client("s3", config=timeouts)
        except (BotoCoreError, ValueError) as error:
            raise RemoteStoreError(
                f"{self._bucket} cannot be used as a remote store: {error}; correct the AWS settings"
            ) from None

    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Upload a file if the store has the expected version; it becomes visible only once it is complete."""
        condition = {"IfMatch": f'"{over}"'} if over else {"IfNoneMatch": "*"}
        target = {"Bucket": self._bucket, "Key": self._prefix + name, **condition}
        with self._raise_as_store_error(f"{path} cannot be put into"), path.open("rb") as file:
            timeout_s = _compute_transfer_timeout_s(path.stat().st_size)
            call_within(timeout_s, lambda: self._client.put_object(Body=file, **target))

    def fetch(self, name: str, path: Path) -> None:
        """Download a file under a temporary name, then rename it."""
        with (
            self._raise_as_store_error(f"{name} cannot be fetched from"),
            replace_durably(path, new_folders=LOG_DEPTH) as file,
        ):
            target = {"Bucket": self._bucket, "Key": self._prefix + name}
            response = call_within(STORE_TIMEOUT_S, lambda: self._client.get_object(**target))
            body = response["Body"]
            timeout_s = _compute_transfer_timeout_s(response["ContentLength"])
            call_within(timeout_s, lambda: shutil.copyfileobj(body, file))

    def versions(self, prefix: str) -> dict[str, str]:
        """Return the entity tag of each object whose name begins with ``prefix``, usually the MD5 of its content."""
        with self._raise_as_store_error("nothing can be listed of"):
            paginator = self._client.get_paginator("list_objects_v2")
            pages = iter(paginator.paginate(Bucket=self._bucket, Prefix=self._prefix + prefix))
            objects: list[Any] = []
            while (page := call_within(STORE_TIMEOUT_S, lambda: next(pages, None))) is not None:
                objects += page.get("Contents", ())
        return {stored["Key"].removeprefix(self._prefix): stored["ETag"].strip('"') for stored in objects}

    def remove(self, name: str) -> None:
        """Delete the object of a file, if it exists."""
        with self._raise_as_store_error(f"{name} cannot be removed from"):
            target = {"Bucket": self._bucket, "Key": self._prefix + name}
            call_within(STORE_TIMEOUT_S, lambda: self._client.delete_object(**target))

    @contextmanager
    def _raise_as_store_error(self, failure: str) -> Iterator[None]:
        """Convert boto3's errors and timeouts to ``RemoteStoreError``; ``failure`` and the bucket begin the message."""
        from botocore.exceptions import BotoCoreError, ClientError

        try:
            yield
        except (BotoCoreError, ClientError) as error:
            if isinstance(error, ClientError) and error.response["Error"].get("Code") in _CONFLICT_CODES:
                raise RemoteStoreConflictError(
                    f"{failure} {self._bucket}, as another machine has just changed it; run the command again"
                ) from None
            raise RemoteStoreError(f"{failure} {self._bucket}: {error}") from None  # it may contain a password
        except TimeoutError as error:
            raise RemoteStoreError(
                f"{failure} {self._bucket}: {error.strerror}; check the network, then run the command again"
            ) from None
