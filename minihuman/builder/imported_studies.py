"""Folders of colleagues that are imported into the desk's folder, file by file, and what they may run once trusted.

A name comes from a page, so each part of it is checked; nothing is written outside a folder that this import has made,
nothing that exists is replaced, and nothing of it runs before the user has seen its code and trusts it.
"""

import hashlib
from pathlib import Path
from threading import Lock
from typing import Any

from minihuman.admin.protocol_file import MAX_PROTOCOL_BYTES, list_named_worlds
from minihuman.builder.edit_errors import EditRefusedError
from minihuman.builder.media import MAX_FILES, MEDIA_TYPES
from minihuman.builder.messages import CodeFile, CopiedFile, EditRefusal, RefusalReason, TrustQuestion
from minihuman.storage.durable_files import replace_durably
from minihuman.storage.outside_names import OutsideNameError, require_name
from minihuman.trust import admit_worlds

IMPORTED_SUFFIXES = frozenset({*MEDIA_TYPES, ".toml", ".py", ".npz", ".md", ".txt"})
_MOST_PARTS = 3  # of a file's place in the folder


class StudyImports:
    """Imports folders into the desk's folder, file by file.

    Args:
        folder: the desk's folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._created: set[str] = set()  # by this process: further files may be written into these folders
        self._lock = Lock()

    def write(self, name: str, place: str, content: bytes) -> CopiedFile:
        """Write one file of an imported folder, creating the folder with its first file.

        Args:
            name: the folder's name.
            place: the file's place in it, with ``/`` between the parts.
            content: the file's bytes.

        Raises:
            EditRefusedError: if a name is not valid, the file's kind, depth or size is none that a study has, or the
                file exists, or the folder existed before this import.
            OSError: if the file cannot be written.
        """
        parts = place.split("/")
        try:
            for part in (name, *parts):
                require_name(part, "the file")
        except OutsideNameError as error:
            raise _refuse("not_valid", str(error)) from error
        suffix = Path(parts[-1]).suffix.lower()
        if suffix not in IMPORTED_SUFFIXES or len(parts) > _MOST_PARTS:
            raise _refuse("not_valid", f"{place} is not a file of a study; it is not copied")
        if suffix == ".toml" and len(content) > MAX_PROTOCOL_BYTES:
            raise _refuse("not_valid", f"{place} has {len(content)} bytes; a protocol has {MAX_PROTOCOL_BYTES} at most")
        with self._lock:
            self._create_folder(name)
        path = self._folder.joinpath(name, *parts)
        if path.exists():
            raise _refuse("exists", f"{name}/{place} exists already; nothing is replaced")
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_durably(path, mode=0o644) as file:
            file.write(content)
        return CopiedFile(f"{name}/{place}", len(content))

    def _create_folder(self, name: str) -> None:
        """Create the folder of an import, unless this process has created it before.

        Raises:
            EditRefusedError: if there is another folder of that name.
        """
        if name in self._created:
            return
        if (self._folder / name).exists():
            raise _refuse("exists", f"there is a folder {name} already; give the imported one another name")
        (self._folder / name).mkdir(parents=True)
        self._created.add(name)


def describe_trust(protocol: Path, tree: dict[str, Any]) -> TrustQuestion:
    """Return what a protocol would run or read if it were trusted, with the Python files in its folder."""
    folder = protocol.parent.resolve()
    untrusted = admit_worlds(list_named_worlds(tree), folder, False)  # asks only, and trusts nothing
    files = []
    for path in sorted(folder.rglob("*.py"))[:MAX_FILES]:
        text = path.read_bytes()[:MAX_PROTOCOL_BYTES].decode("utf-8", "replace")
        files.append(CodeFile(path.relative_to(folder).as_posix(), text))
    return TrustQuestion(untrusted, files, _hash_code(folder))


def trust_study(protocol: Path, tree: dict[str, Any], seen_sha256: str) -> None:
    """Trust what a protocol runs and reads, if the code is still the one that the user has seen.

    Args:
        protocol: the protocol's file.
        tree: the protocol's values.
        seen_sha256: the digest of the code that the user has seen, from ``describe_trust``.

    Raises:
        EditRefusedError: if the code has changed.
        OSError: if the record of trust cannot be written.
    """
    folder = protocol.parent.resolve()
    if _hash_code(folder) != seen_sha256:
        raise _refuse("conflict", "the code has changed since it was shown; look at it again")
    admit_worlds(list_named_worlds(tree), folder, True)  # trusts them, and records it


def _hash_code(folder: Path) -> str:
    """Return a digest of the names and contents of a folder's Python files."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(folder).as_posix()}\n{len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


def _refuse(reason: RefusalReason, message: str) -> EditRefusedError:
    return EditRefusedError(EditRefusal(reason, message))
