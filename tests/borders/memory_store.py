"""A remote store in memory: it names its files as it likes, loses parts of them, and is changed by others."""

import hashlib
from pathlib import Path

from minihuman.storage.remote_store import RemoteStore, RemoteStoreConflictError, RemoteStoreError


class MemoryStore(RemoteStore):
    """Files by whatever name, as a bucket may hold them."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}

    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Keep a file, if the version is the expected one."""
        if self._version(name) != over:
            raise RemoteStoreConflictError(f"{name} was changed")
        self.files[name] = path.read_bytes()

    def fetch(self, name: str, path: Path) -> None:
        """Write a file."""
        if name not in self.files:
            raise RemoteStoreError(f"{name} is not in the store")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.files[name])

    def versions(self, prefix: str) -> dict[str, str]:
        """List what begins so."""
        return {name: self._version(name) for name in self.files if name.startswith(prefix)}

    def remove(self, name: str) -> None:
        """Forget a file."""
        self.files.pop(name, None)

    def _version(self, name: str) -> str:
        return hashlib.md5(self.files[name], usedforsecurity=False).hexdigest() if name in self.files else ""
