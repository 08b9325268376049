"""Remote stores for finished logs, which every machine of a study reaches: the port, and a store in a folder.

The file ``logs.url`` of the data folder names the store: ``s3://bucket/prefix``, or a folder such as a network
share.
Without that file logs stay where they were recorded.
"""

import abc
import os
import shutil
from pathlib import Path

from minihuman.dataset.withdrawals import read_withdrawn_codes
from minihuman.errors import LogError
from minihuman.log.paths import LOG_SUFFIX, study_folder
from minihuman.operating_system import replace_file, sync_file, sync_folder

STORE_URL_FILE_NAME = "logs.url"
_S3 = "s3://"


class RemoteStoreError(LogError):
    """What is on the shelf cannot be reached."""


class RemoteStore(abc.ABC):
    """Files by name, each whole or not at all."""

    @abc.abstractmethod
    def put(self, name: str, path: Path) -> None:
        """Put a file there, in the place of what has its name.

        Raises:
            ShelfError: if that cannot be.
        """

    @abc.abstractmethod
    def fetch(self, name: str, path: Path) -> None:
        """Bring a file here; its folder is made.

        Raises:
            ShelfError: if that cannot be.
        """

    @abc.abstractmethod
    def sizes(self, prefix: str) -> dict[str, int]:
        """The bytes of each file whose name begins so.

        Raises:
            ShelfError: if that cannot be.
        """

    @abc.abstractmethod
    def remove(self, name: str) -> None:
        """Take a file away, if it is there.

        Raises:
            ShelfError: if that cannot be.
        """


class FolderStore(RemoteStore):
    """A folder that all machines have."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def put(self, name: str, path: Path) -> None:
        """Copy it, durable before it has its name."""
        try:
            _copy_durably(path, self._folder / name)
        except OSError as error:
            raise RemoteStoreError(f"{path} cannot be stored in {self._folder}: {error.strerror}") from error

    def fetch(self, name: str, path: Path) -> None:
        """Copy it."""
        try:
            _copy_durably(self._folder / name, path)
        except OSError as error:
            raise RemoteStoreError(f"{name} cannot be fetched from {self._folder}: {error.strerror}") from error

    def sizes(self, prefix: str) -> dict[str, int]:
        """The logs below."""
        return list_log_sizes(self._folder, prefix)

    def remove(self, name: str) -> None:
        """Delete it."""
        try:
            (self._folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise RemoteStoreError(f"{name} cannot be taken from {self._folder}: {error.strerror}") from error


def open_remote_store(data: Path) -> RemoteStore | None:
    """The shelf that a data folder names; None where it names none."""
    path = data / STORE_URL_FILE_NAME
    if not path.is_file():
        return None
    url = path.read_text(encoding="utf-8").strip()
    if url.startswith(_S3):
        from minihuman.admin.s3_store import S3Store

        return S3Store(url.removeprefix(_S3))
    return FolderStore(Path(url))


def upload_log(log: Path) -> None:
    """Put a finished log on its study's shelf, if there is one; nobody's who withdrew.

    Raises:
        OSError: if the register cannot be asked.
        ShelfError: if it cannot be put there; the log stays here in any case.
    """
    study = study_folder(log)
    shelf, name = open_remote_store(study.parent), log.absolute().relative_to(study.parent)
    if shelf is not None and name.parts[1] not in read_withdrawn_codes(study):
        shelf.put(str(name), log)


def sync_logs(data: Path, prefix: str) -> tuple[int, int]:
    """Bring here what the shelf has, and put there what it has not; how many logs came and went.

    A log grows with each of its segments: where both have one, the longer is the newer. Those of whoever withdrew, by
    the register that this machine has, are left where they are.

    Args:
        data: the data folder.
        prefix: "study/" or "study/sub-07/".

    Raises:
        OSError: if a register cannot be asked.
        ShelfError: if the shelf cannot be reached.
    """
    shelf = open_remote_store(data)
    if shelf is None:
        return 0, 0
    there, here = (_without_withdrawn(data, sizes) for sizes in (shelf.sizes(prefix), list_log_sizes(data, prefix)))
    coming = [name for name, size in there.items() if size > here.get(name, -1)]
    going = [name for name, size in here.items() if size > there.get(name, -1)]
    for name in coming:
        shelf.fetch(name, data / name)
    for name in going:
        shelf.put(name, data / name)
    return len(coming), len(going)


def delete_remote_logs(data: Path, prefix: str) -> None:
    """Take off the shelf, for ever, the logs whose names begin so.

    Raises:
        ShelfError: if that cannot be.
    """
    shelf = open_remote_store(data)
    if shelf is not None:
        for name in shelf.sizes(prefix):
            shelf.remove(name)


def list_log_sizes(folder: Path, prefix: str) -> dict[str, int]:
    """The bytes of each finished log in a folder whose path from there begins so."""
    below = folder / prefix.rpartition("/")[0]
    files = (path for path in below.rglob(f"*{LOG_SUFFIX}") if path.is_file())
    named = ((path.relative_to(folder).as_posix(), path.stat().st_size) for path in sorted(files))
    return {name: size for name, size in named if name.startswith(prefix)}


def _without_withdrawn(data: Path, sizes: dict[str, int]) -> dict[str, int]:
    """What is of nobody who withdrew from their study; a name is study, participant, session and log."""
    parts = {name: name.split("/") for name in sizes}
    gone = {study: read_withdrawn_codes(data / study) for study in {its[0] for its in parts.values()}}
    return {name: size for name, size in sizes.items() if not gone[parts[name][0]].intersection(parts[name][1:2])}


def _copy_durably(path: Path, to: Path) -> None:
    to.parent.mkdir(parents=True, exist_ok=True)
    beside = to.with_name(f".{to.name}.{os.getpid()}")
    try:
        with path.open("rb") as source, beside.open("wb") as target:
            shutil.copyfileobj(source, target)
            target.flush()
            sync_file(target.fileno())
        replace_file(beside, to)
    finally:
        beside.unlink(missing_ok=True)
    sync_folder(to.parent)
