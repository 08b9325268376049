"""Remote stores, which every machine of a study reaches: the port, and stores in a folder and in S3.

The file ``logs.url`` of the data folder names the store of finished logs, ``tables.url`` that of tables:
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
from minihuman.storage.redaction import redact
from minihuman.storage.system import current_system

STORE_URL_FILE_NAME = "logs.url"
TABLES_URL_FILE_NAME = "tables.url"
_S3 = "s3://"
_MD5 = re.compile(r"[0-9a-f]{32}")
LOG_DEPTH = 3  # folders above a log: session, participant and study


class RemoteStoreError(LogError):
    """The remote store cannot be reached; its text holds no secret, whatever an address or a library put into it."""

    def __init__(self, message: str) -> None:
        super().__init__(redact(message))


class RemoteStoreConflictError(RemoteStoreError):
    """A file was put there by another machine meanwhile."""


class DamagedCopyError(RemoteStoreError):
    """A file of the remote store is not what its name or its digest says; it is not believed."""


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
        """Return the version of each file whose name begins so: its MD5, hexadecimal, where the store has that.

        Raises:
            RemoteStoreError: if that cannot be.
        """

    def names(self, prefix: str) -> list[str]:
        """List the names of the files that begin so.

        Raises:
            RemoteStoreError: if that cannot be.
        """
        return list(self.versions(prefix))

    @abc.abstractmethod
    def remove(self, name: str) -> None:
        """Take a file away, if it is there, so that it stays away.

        Raises:
            RemoteStoreError: if that cannot be.
        """

    def erase(self, owner: str, names: Iterable[str]) -> None:
        """Take a participant's files away, and whatever a crash left of them.

        Args:
            owner: the participant's code.
            names: of the files.

        Raises:
            RemoteStoreError: if that cannot be.
        """
        for name in names:
            self.remove(name)


class FolderStore(RemoteStore):
    """A folder that all machines have."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._unfinished = folder / ".unfinished"  # one for all, so that what a crash leaves does not stay

    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Copy it, durable before it has its name; a lock keeps the other machines out."""
        try:
            with self._locked():
                if compute_md5(join_inside(self._folder, name)) != over:
                    raise RemoteStoreConflictError(
                        f"another machine has just stored {name} in {self._folder}; run the command again"
                    )
                mode = self._folder.stat().st_mode  # who may read a shared folder, may read what is in it
                target = join_inside(self._folder, name)
                current_system().disk.make_folder(target.parent, stat.S_IMODE(mode) | 0o700)
                copy_durably(path, target, self._unfinished, mode=mode & 0o666 | 0o600, new_folders=LOG_DEPTH)
        except OSError as error:
            raise RemoteStoreError(
                f"{path} cannot be stored in {self._folder}: {error.strerror}; make the folder writable"
            ) from error

    def fetch(self, name: str, path: Path) -> None:
        """Copy it."""
        try:
            copy_durably(join_inside(self._folder, name), path, new_folders=LOG_DEPTH)
        except OSError as error:
            raise RemoteStoreError(
                f"{name} cannot be fetched from {self._folder}: {error.strerror}; make it readable"
            ) from error

    def versions(self, prefix: str) -> dict[str, str]:
        """Return the versions of the files below, each read for its MD5."""
        return {name: compute_md5(join_inside(self._folder, name)) for name in self.names(prefix)}

    def names(self, prefix: str) -> list[str]:
        """List the files below, unread."""
        return list_files(self._folder, prefix)

    def remove(self, name: str) -> None:
        """Delete it, and the folders that are empty then: some are named after a participant."""
        with self._raise_as_store_error(name), self._locked():
            self._remove(name)

    def erase(self, owner: str, names: Iterable[str]) -> None:
        """Delete them, folders of theirs that an erasure left empty, and what a crash left of any file being stored."""
        with self._raise_as_store_error(f"all of {owner}"), self._locked():
            sync_folder(self._folder)  # the unfinished file may have been theirs
            for name in names:
                self._remove(name)
            for folder in [path for path in self._folder.rglob("*") if path.is_dir() and not any(path.iterdir())]:
                if owner in {part.rpartition("=")[2] for part in folder.relative_to(self._folder).parts}:
                    self._remove_empty_folders(folder)

    def _remove(self, name: str) -> None:
        path = join_inside(self._folder, name)
        if path.exists():
            current_system().disk.unlink(path)
        if path.parent.is_dir():
            self._remove_empty_folders(path.parent)

    def _remove_empty_folders(self, folder: Path) -> None:
        """Make what was taken out of a folder durable, and remove it and those above that are empty then."""
        sync_folder(folder)  # first: once the folder is gone, nothing says that its files may come back
        with suppress(OSError):  # not empty
            while folder != self._folder:
                current_system().disk.remove_folder(folder)
                folder = folder.parent
        sync_folder(folder)

    @contextmanager
    def _raise_as_store_error(self, name: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RemoteStoreError(
                f"{name} cannot be removed from {self._folder}: {error.strerror}; make the folder writable"
            ) from error

    @contextmanager
    def _locked(self) -> Iterator[None]:
        with hold_lock(self._folder / ".lock", 0o666):
            if self._unfinished.exists():
                current_system().disk.unlink(self._unfinished)
            yield


def open_remote_store(data: Path, *, may_be_new: bool = True) -> RemoteStore | None:
    """Open the remote store that a data folder names for logs; None where it names none.

    Args:
        data: the data folder.
        may_be_new: as in ``open_store_url``.

    Raises:
        RemoteStoreError: if it is a folder that has to be there and is not.
    """
    path = data / STORE_URL_FILE_NAME
    if path.is_file():
        return open_store_url(path.read_text(encoding="utf-8").strip(), may_be_new=may_be_new)
    return None


def open_store_url(url: str, *, may_be_new: bool = True) -> RemoteStore:
    """Open the store at an address.

    Args:
        url: as ``logs.url`` has it.
        may_be_new: a folder that does not exist is made; else it is refused, as a share may not be mounted.

    Raises:
        RemoteStoreError: if it is refused.
    """
    if url.startswith(_S3):
        return S3Store(url.removeprefix(_S3))
    if not (may_be_new or (url and Path(url).is_dir())):
        raise RemoteStoreError(f"{url!r} cannot be used as a remote store: it is not a folder; mount or create it")
    return FolderStore(Path(url))


@contextmanager
def fetch_temporarily(store: RemoteStore, name: str, *, version: str = "") -> Iterator[Path]:
    """Bring a file of the store to a folder that goes away again, and compare it with its digest.

    Args:
        store: the store.
        name: of the file there, of a form that was checked.
        version: as the store listed it; what is no MD5 is not compared.

    Raises:
        RemoteStoreError: if it cannot be fetched.
        DamagedCopyError: if it is not the file that was listed.
    """
    with tempfile.TemporaryDirectory(prefix="minihuman-") as folder:
        path = join_inside(Path(folder), name.rpartition("/")[2])
        store.fetch(name, path)
        if _MD5.fullmatch(version) and compute_md5(path) != version:
            raise DamagedCopyError(f"{name} in the remote store is refused: it did not arrive as listed; gather again")
        yield path


def list_files(folder: Path, prefix: str) -> list[str]:
    """List the files in a folder whose paths from there begin so, but for hidden ones."""
    below = folder / prefix.rpartition("/")[0]
    files = (path for path in below.rglob("*") if path.is_file() and not path.name.startswith("."))
    names = (path.relative_to(folder).as_posix() for path in sorted(files))
    return [name for name in names if name.startswith(prefix)]


def compute_md5(path: Path) -> str:
    """Return a file's MD5, hexadecimal; "" where there is no file."""
    try:
        return hash_file(path, "md5")
    except FileNotFoundError:
        return ""


STORE_TIMEOUT_S = 60.0  # of one answer, all of it
_CONNECT_TIMEOUT_S = 10
_READ_TIMEOUT_S = 30
_SLOWEST_BYTES_PER_S = 50_000  # what is slower is taken for a store that drips
_CONFLICTS = ("PreconditionFailed", "ConditionalRequestConflict", "412", "409")


def _limit_transfer_s(size_bytes: int) -> float:
    """Compute how long a file's transfer may take in all."""
    return STORE_TIMEOUT_S + size_bytes / _SLOWEST_BYTES_PER_S


class S3Store(RemoteStore):
    """Objects of a bucket. The store's address, keys and region are boto3's to find: ``AWS_ENDPOINT_URL`` and the like.

    Args:
        address: the bucket, and what all names begin with: "bucket/prefix".
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
        """Send it, on the condition that the store has that version; the store shows it when all of it is there."""
        condition = {"IfMatch": f'"{over}"'} if over else {"IfNoneMatch": "*"}
        target = {"Bucket": self._bucket, "Key": self._prefix + name, **condition}
        with self._raise_as_store_error(f"{path} cannot be put into"), path.open("rb") as file:
            limit_s = _limit_transfer_s(path.stat().st_size)
            call_within(limit_s, lambda: self._client.put_object(Body=file, **target))

    def fetch(self, name: str, path: Path) -> None:
        """Download a file beside its place, then move it there."""
        with (
            self._raise_as_store_error(f"{name} cannot be fetched from"),
            replace_durably(path, new_folders=LOG_DEPTH) as file,
        ):
            target = {"Bucket": self._bucket, "Key": self._prefix + name}
            response = call_within(STORE_TIMEOUT_S, lambda: self._client.get_object(**target))
            body = response["Body"]
            limit_s = _limit_transfer_s(response["ContentLength"])
            call_within(limit_s, lambda: shutil.copyfileobj(body, file))

    def versions(self, prefix: str) -> dict[str, str]:
        """Return the objects' entity tags, page by page."""
        with self._raise_as_store_error("nothing can be listed of"):
            paginator = self._client.get_paginator("list_objects_v2")
            pages = iter(paginator.paginate(Bucket=self._bucket, Prefix=self._prefix + prefix))
            objects: list[Any] = []
            while (page := call_within(STORE_TIMEOUT_S, lambda: next(pages, None))) is not None:
                objects += page.get("Contents", ())
        return {stored["Key"].removeprefix(self._prefix): stored["ETag"].strip('"') for stored in objects}

    def remove(self, name: str) -> None:
        """Delete it."""
        with self._raise_as_store_error(f"{name} cannot be removed from"):
            target = {"Bucket": self._bucket, "Key": self._prefix + name}
            call_within(STORE_TIMEOUT_S, lambda: self._client.delete_object(**target))

    @contextmanager
    def _raise_as_store_error(self, failure: str) -> Iterator[None]:
        from botocore.exceptions import BotoCoreError, ClientError

        try:
            yield
        except (BotoCoreError, ClientError) as error:
            if isinstance(error, ClientError) and error.response["Error"].get("Code") in _CONFLICTS:
                raise RemoteStoreConflictError(
                    f"{failure} {self._bucket}, as another machine has just changed it; run the command again"
                ) from None
            raise RemoteStoreError(f"{failure} {self._bucket}: {error}") from None  # its text may hold a password
        except TimeoutError as error:
            raise RemoteStoreError(
                f"{failure} {self._bucket}: {error.strerror}; check the network, then run the command again"
            ) from None
