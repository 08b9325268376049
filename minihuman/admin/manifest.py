"""Study manifests: one digest for a log and one for a study, which another file or a publication can cite.

A log's digest is the head of its hash chain. A study's digest is a SHA-256 over the SHA-256 of every file in its
folder; it later shows whether any file was changed, added or removed, by whatever tool.
"""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from minihuman.admin.enrolment_entries import ChainHeadRecorded, open_enrolment_log
from minihuman.admin.enrolment_log import record_chain_heads
from minihuman.admin.remote_logs import upload_log
from minihuman.dataset.caches import is_cache
from minihuman.errors import LogError
from minihuman.log.names import CHAIN_KEY
from minihuman.log.paths import find_log_folders, group_sessions, require_folder, study_folder
from minihuman.log.salvage.summary_section import read_summary
from minihuman.storage.durable_files import hash_file, replace_durably

MANIFEST_FILE_NAME = "seal.json"
_UNFINISHED = f"{MANIFEST_FILE_NAME}.part"
_DIGITS = 64
GONE = " is gone"  # the end of a line about a sealed file that is missing


class StudyManifest(msgspec.Struct, frozen=True):
    """A study's digest, and the SHA-256 of every file, by path relative to the study's folder."""

    digest: str
    files: dict[str, str]


def record_log_end(log: Path) -> str:
    """Record a finished log's chain heads in the study's enrolment log, and upload the log to the remote store if any.

    Returns:
        The last head; "" if the log has none.

    Raises:
        OSError: if the enrolment log cannot be written.
        RemoteStoreError: if the store cannot be reached; the enrolment log has then been written.
    """
    heads = _read_chain_heads(log)
    if not heads:
        return ""
    if open_enrolment_log(study_folder(log)).begun:  # a log outside its study's folder is only read
        record_chain_heads(study_folder(log), heads)
        upload_log(log)
    return heads[-1].chain


def record_missing_heads(log: Path) -> int:
    """Record those chain heads of a finished log that the study's enrolment log lacks; return their number.

    Raises:
        OSError: if the enrolment log cannot be written.
    """
    heads = _read_chain_heads(log)
    if not heads or not open_enrolment_log(study_folder(log)).begun:
        return 0
    return record_chain_heads(study_folder(log), heads, only_missing=True)


def find_unrecorded_logs(study: Path) -> list[Path]:
    """Return the finished logs with a chain head missing from the enrolment log, as after a server was killed."""
    lines = open_enrolment_log(study).read()
    recorded = {(line.sealed, line.segment) for line in lines if isinstance(line, ChainHeadRecorded)}
    logs = []
    for folder, names in find_log_folders(study):
        for log, files in group_sessions(folder, names).items():
            is_finished = log in files
            if is_finished and any((head.sealed, head.segment) not in recorded for head in _read_chain_heads(log)):
                logs.append(log)
    return logs


def _read_chain_heads(log: Path) -> list[ChainHeadRecorded]:
    """Return the chain head of each segment of a finished log; an empty list if the last segment has none."""
    summary = read_summary(log)
    if summary is None or not summary.ends or CHAIN_KEY not in summary.ends[-1]:
        return []
    return [ChainHeadRecorded(log.name, end["segment"], end[CHAIN_KEY]) for end in summary.ends if CHAIN_KEY in end]


def write_manifest(study: Path) -> StudyManifest:
    """Write the manifest of a study's folder as it is now into ``seal.json``, replacing an earlier one.

    Raises:
        LogError: if the path is not a folder, or the folder is empty.
        OSError: if a file cannot be read, or the manifest cannot be written.
    """
    require_folder(study)
    files = _digest_files(study)
    if not files:
        raise LogError(f"{study} is not a folder that contains files; name a study's folder")
    manifest = StudyManifest(_digest_study(files), files)
    with replace_durably(study / MANIFEST_FILE_NAME, study / _UNFINISHED) as file:
        file.write(msgspec.json.format(msgspec.json.encode(manifest), indent=1) + b"\n")
    return manifest


def find_changed_files(study: Path, digest_or_file: str) -> Iterator[str]:
    """Yield a line for each difference of a study's folder from a manifest, given as its digest or its file.

    If a digest is given, and the manifest in the study's folder has another digest, there is at most one line.

    Raises:
        LogError: if the argument is neither.
        OSError: if a file cannot be read.
    """
    file = Path(digest_or_file)
    if not file.is_file():
        digest = _parse_digest(digest_or_file)
        file = study / MANIFEST_FILE_NAME
        manifest = _read_manifest(file)
        if manifest is None or manifest.digest != digest:  # the digests of single files are unknown
            digest_now = _digest_study(_digest_files(study))
            if digest_now != digest:
                yield f"the study is not as it was sealed with {digest[:16]}: it is {digest_now[:16]} now"
            return
    manifest = _read_manifest(file)
    if manifest is None or _digest_study(manifest.files) != manifest.digest:
        yield f"{file} is not a manifest, or was changed"
        return
    yield from _compare_files(study, manifest)


def _parse_digest(text: str) -> str:
    """Return a digest in lower case.

    Raises:
        LogError: if the text is not a digest.
    """
    digest = text.lower()
    if len(digest) != _DIGITS or not set(digest) <= set("0123456789abcdef"):
        raise LogError(f"{text!r} is neither a manifest file nor a digest; a digest has {_DIGITS} hexadecimal digits")
    return digest


def _compare_files(study: Path, manifest: StudyManifest) -> Iterator[str]:
    """Yield a line for each file that was removed, added or changed since the manifest was made."""
    digests = _digest_files(study)
    # earlier versions sealed one cache, too
    sealed_names = {name for name in manifest.files if not is_cache(Path(name))}
    for name in sorted({*sealed_names, *digests}):
        if name not in digests:
            yield f"{name}{GONE}"
        elif name not in manifest.files:
            yield f"{name} was not there"
        elif manifest.files[name] != digests[name]:
            yield f"{name} was changed"


def _read_manifest(path: Path) -> StudyManifest | None:
    """Return the manifest in a file; None if the file cannot be read or is not a manifest."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=StudyManifest)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError):
        return None


def _digest_files(study: Path) -> dict[str, str]:
    """Return the digest of each file of a study, by its path in the study, without the manifest and caches."""
    digests = {}
    for folder, _, names in os.walk(study):
        for name in names:
            path = Path(folder, name)
            within = path.relative_to(study)
            if within.as_posix() in (MANIFEST_FILE_NAME, _UNFINISHED) or is_cache(within):
                continue
            if path.is_file():
                digests[within.as_posix()] = hash_file(path)
    return dict(sorted(digests.items()))


def _digest_study(files: dict[str, str]) -> str:
    """Return the SHA-256 of the lines that ``sha256sum`` prints for files, given their digests by path."""
    lines = "".join(f"{digest}  {name}\n" for name, digest in sorted(files.items()))
    return hashlib.sha256(lines.encode()).hexdigest()
