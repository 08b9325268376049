"""The identity of the machine that has a data folder: a random number that names no host or account."""

import secrets
from pathlib import Path

import msgspec

from minihuman.storage.durable_files import replace_durably
from minihuman.storage.locks import hold_lock

IDENTITY_FILE_NAME = "machine.json"
_LOCK_FILE_NAME = ".machine.lock"
_ID_BYTES = 8


class _Identity(msgspec.Struct, frozen=True):
    machine: str  # 16 hexadecimal digits
    inode: int  # of the data folder: a copy of it is another machine


def read_machine_id(data: Path) -> str:
    """Return the id of the machine to which a data folder belongs, creating it on the first call.

    A data folder that several stations share counts as one machine, as it holds one copy of the data.

    Raises:
        OSError: if the folder cannot be read or the id cannot be written.
        LogError: if the folder's file system has no locks.
    """
    inode = data.stat().st_ino
    identity = _read_identity(data)
    if identity is not None and identity.inode == inode:
        return identity.machine
    with hold_lock(data / _LOCK_FILE_NAME):
        identity = _read_identity(data)
        if identity is None or identity.inode != inode:
            identity = _Identity(secrets.token_hex(_ID_BYTES), inode)
            with replace_durably(data / IDENTITY_FILE_NAME) as file:
                file.write(msgspec.json.encode(identity) + b"\n")
        return identity.machine


def _read_identity(data: Path) -> _Identity | None:
    try:
        return msgspec.json.decode((data / IDENTITY_FILE_NAME).read_bytes(), type=_Identity)
    except (FileNotFoundError, msgspec.DecodeError):
        return None
