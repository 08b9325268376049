"""Seals: one number for a log, one for a study, that another file or a publication can hold on to.

A log's is the head of its hash chain. A study's is a SHA-256 over the SHA-256 of every file in its folder: whoever has
it can tell later whether anything was changed, added or taken away since, whatever tools were used to do it.
"""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from minihuman.data.caches import is_cache
from minihuman.errors import LogError, naming
from minihuman.lab.register import note_seal
from minihuman.lab.register_lines import Sealed, register_of
from minihuman.lab.shelf import put_away
from minihuman.log.chain import HEAD
from minihuman.log.paths import require_folder, study_folder
from minihuman.log.read.glance import glance
from minihuman.log.record.claim import sync_folder

FILE_NAME = "seal.json"
_UNFINISHED = f"{FILE_NAME}.part"
_DIGITS = 64


class Seal(msgspec.Struct, frozen=True):
    """A study as it was: its digest, and the SHA-256 of every file, by its path within the study's folder."""

    digest: str
    files: dict[str, str]


def note_end(log: Path) -> str:
    """Write the head of a finished log's chain into the study's register, and give it; "" if it has none.

    The log is put on the study's shelf, too, if there is one.

    Raises:
        OSError: if the register cannot be written.
        ShelfError: if the shelf cannot be reached; the register is written.
    """
    found = glance(log)
    if found is None or not found.ends or HEAD not in found.ends[-1]:
        return ""
    end = found.ends[-1]
    study = study_folder(log)
    if register_of(study).begun:  # a log by itself, far from its study, stays by itself
        note_seal(study, Sealed(log.name, end["segment"], end[HEAD]))
        put_away(log)
    return end[HEAD]


def seal(study: Path) -> Seal:
    """Seal a study's folder as it is now, in its file ``seal.json``; a seal of before is replaced.

    Raises:
        LogError: if it is no folder, or empty.
        OSError: if a file cannot be read, or the seal cannot be written.
    """
    require_folder(study)
    files = _digests(study)
    if not files:
        raise LogError(f"{study} is no folder with files in it; name a study's folder")
    made = Seal(_digest(files), files)
    unfinished = study / _UNFINISHED
    try:
        with naming(unfinished), unfinished.open("wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(made), indent=1) + b"\n")
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(study / FILE_NAME)
    finally:
        unfinished.unlink(missing_ok=True)
    sync_folder(study)
    return made


def broken(study: Path, given: str) -> Iterator[str]:
    """Yield what in a study's folder is not as it was sealed: ``given`` is the digest, or a seal's file.

    Raises:
        LogError: if it is neither.
        OSError: if a file cannot be read.
    """
    file = Path(given)
    kept = _read(file if file.is_file() else study / FILE_NAME)
    digest = given.lower()
    if not file.is_file():
        if len(digest) != _DIGITS or not set(digest) <= set("0123456789abcdef"):
            raise LogError(f"{given!r} is neither a seal's file nor {_DIGITS} hexadecimal digits")
        if kept is None or kept.digest != digest:
            now = _digest(_digests(study))
            if now != digest:
                yield f"the study is not as it was sealed with {digest[:16]}: it is {now[:16]} now"
            return
    if kept is None or _digest(kept.files) != kept.digest:
        yield f"{file if file.is_file() else study / FILE_NAME} is no seal, or was changed"
        return
    now_there = _digests(study)
    sealed = {name for name in kept.files if not is_cache(Path(name))}  # earlier versions sealed one cache, too
    for name in sorted({*sealed, *now_there}):
        if name not in now_there:
            yield f"{name} is gone"
        elif name not in kept.files:
            yield f"{name} was not there"
        elif kept.files[name] != now_there[name]:
            yield f"{name} was changed"


def _read(path: Path) -> Seal | None:
    try:
        return msgspec.json.decode(path.read_bytes(), type=Seal)
    except (OSError, msgspec.DecodeError):
        return None


def _digests(study: Path) -> dict[str, str]:
    found = {}
    for folder, _, names in os.walk(study):
        for name in names:
            path = Path(folder, name)
            within = path.relative_to(study)
            if path.is_file() and within.as_posix() not in (FILE_NAME, _UNFINISHED) and not is_cache(within):
                with path.open("rb") as file:
                    found[within.as_posix()] = hashlib.file_digest(file, "sha256").hexdigest()
    return dict(sorted(found.items()))


def _digest(files: dict[str, str]) -> str:
    """Of the lines that ``sha256sum`` prints for these files, in the order of their paths."""
    lines = "".join(f"{digest}  {name}\n" for name, digest in sorted(files.items()))
    return hashlib.sha256(lines.encode()).hexdigest()
