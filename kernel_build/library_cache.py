"""Libraries that were built before, in the user's cache folder: one serves every checkout, worktree and environment.

A file is one library: a digest of all that follows, a line that says what it was made of and its manifest, and its
code. What does not agree with its digest, or is not the user's own, counts as missing; a folder that cannot be written
to keeps nothing.
"""

import hashlib
import json
import os
import stat
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER_VARIABLE = "MINIHUMAN_BUILD_CACHE"  # names the folder; empty, nothing is kept
MAX_LIBRARIES = 16  # 12 MB
_SUFFIX = ".library"
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True, slots=True)
class CachedLibrary:
    """A library's manifest, but for its files, and its code."""

    manifest: dict[str, Any]
    code: bytes


class LibraryCache:
    """A folder of libraries by what they were made of.

    Args:
        folder: where they are; None keeps nothing.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    @classmethod
    def of_user(cls) -> "LibraryCache":
        """Return the user's own cache, in the folder that the system or `FOLDER_VARIABLE` has for it."""
        return cls(find_cache_folder())

    def read(self, key: Mapping[str, Any]) -> CachedLibrary | None:
        """Return what was made of exactly this; None where there is none that can be believed."""
        if self._folder is None or not _is_private(self._folder):
            return None
        path = self._folder / _name(key)
        try:
            if not _is_private(path):
                return None
            digest, _, content = path.read_bytes().partition(b"\n")
        except OSError:
            return None
        if hashlib.sha256(content).hexdigest().encode() != digest:
            return None
        head, _, code = content.partition(b"\n")
        made_of, manifest = json.loads(head)
        if made_of != key:
            return None
        with suppress(OSError):
            os.utime(path)  # the longest unused goes first
        return CachedLibrary(manifest, code)

    def write(self, key: Mapping[str, Any], library: CachedLibrary) -> None:
        """Keep a library, if the folder can be written to and is the user's alone."""
        if self._folder is None:
            return
        content = json.dumps([key, library.manifest]).encode() + b"\n" + library.code
        digest = hashlib.sha256(content).hexdigest().encode()
        with suppress(OSError):
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not _is_private(self._folder):
                return
            with tempfile.TemporaryDirectory(dir=self._folder, prefix=".") as scratch:
                new = Path(scratch, "new")
                new.touch(mode=0o600)
                new.write_bytes(digest + b"\n" + content)
                os.replace(new, self._folder / _name(key))
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        assert self._folder is not None
        libraries = sorted(self._folder.glob(f"*{_SUFFIX}"), key=lambda path: path.stat().st_mtime)
        for path in libraries[:-MAX_LIBRARIES]:
            path.unlink(missing_ok=True)


def find_cache_folder() -> Path | None:
    """Return the folder of the user's cache; None where it is switched off, or the user has no home."""
    override = os.environ.get(FOLDER_VARIABLE)
    if override is not None:
        return Path(override).absolute() if override else None
    try:
        return _find_system_folder() / "minihuman" / "libraries"
    except RuntimeError:  # no home
        return None


def _find_system_folder() -> Path:
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA")
        if local:
            return Path(local)
        return Path.home() / "AppData" / "Local"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    named = os.environ.get("XDG_CACHE_HOME", "")
    # a relative one is to be ignored
    if Path(named).is_absolute():
        return Path(named)
    return Path.home() / ".cache"


def _name(key: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:32] + _SUFFIX


def _is_private(path: Path) -> bool:
    """Say whether a file or folder is the user's own, no link, and written by no other: its code will be run."""
    try:
        status = path.lstat()
    except OSError:
        return False
    if stat.S_ISLNK(status.st_mode):
        return False
    return sys.platform == "win32" or (status.st_uid == os.geteuid() and not status.st_mode & _WRITABLE_BY_OTHERS)
