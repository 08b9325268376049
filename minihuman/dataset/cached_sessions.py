"""What the table cache stores about a log besides its rows: how much is included, and a fingerprint of its files."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import msgspec

from minihuman.dataset.annotations import annotations_path
from minihuman.dataset.caches import describe_file, is_same_content
from minihuman.dataset.log_files import SkippedLog, find_containing_folder, list_readable_logs
from minihuman.dataset.recording_quality import PlanOutline, RecordingQuality
from minihuman.dataset.selection import SelectionSummary, find_practice_blocks
from minihuman.dataset.sessions import SessionRows
from minihuman.log.salvage.summary_section import read_first_metadata


class CachedSession(msgspec.Struct, frozen=True):
    """A cached log: its path, how much of it is included, or why it cannot be read."""

    path: str  # "" in the cache file, which names no folder outside the study
    problem: str = ""
    study: str = ""
    blocks: int = 0  # blocks with an included episode
    outline: PlanOutline | None = None  # of the session's plan; None, like the quality, for a session not selected
    quality: RecordingQuality | None = None
    # included sessions; included episodes; (study, version, sessions); (reason, excluded episodes)
    account: tuple[int, int, tuple[tuple[str, str, int], ...], tuple[tuple[str, int], ...]] = (0, 0, (), ())
    practice: tuple[str, ...] = ()  # the blocks that the session's protocol does not analyse
    excluded: tuple[tuple[str, str, str], ...] = ()  # reason, study and code if a rule excludes the participant

    def to_summary(self) -> SelectionSummary:
        """Return the selection summary of this log alone."""
        sessions, episodes, versions, excluded_episodes = self.account
        account = SelectionSummary(sessions=sessions, episodes=episodes)
        account.versions.update({(study, version): count for study, version, count in versions})
        account.excluded_episodes.update(dict(excluded_episodes))
        account.excluded_participants.update(self.excluded)
        return account


class ListedLog(NamedTuple):
    """A log as found on disk, before it is read."""

    path: Path
    fingerprint: str
    metadata: dict[str, str]  # the log's first metadata record


class KnownLog(NamedTuple):
    """A log as the cache recorded it when its rows were stored."""

    number: int
    fingerprint: str
    with_shortest: bool
    metadata: bytes  # the log's first metadata record, as MessagePack


def build_cached_session(session: SessionRows) -> CachedSession:
    """Build a session's cache entry. Its path stays empty, because the cache's key holds the path."""
    account = session.account
    versions = tuple((study, version, count) for (study, version), count in account.versions.items())
    outline: PlanOutline | None = None
    quality: RecordingQuality | None = None
    if session.rows.count("participants"):
        outline = PlanOutline.of(session.plan)
        quality = session.quality
    return CachedSession(
        path="",
        study=session.plan.study,
        blocks=len({facts["block"] for facts in session.facts}),
        practice=tuple(sorted(find_practice_blocks(session.plan))),
        outline=outline,
        quality=quality,
        account=(account.sessions, account.episodes, versions, tuple(account.excluded_episodes.items())),
        excluded=tuple(sorted(account.excluded_participants)),
    )


def list_logs(source: Path, known: Mapping[str, KnownLog]) -> tuple[dict[str, ListedLog], list[SkippedLog]]:
    """List the logs to read, by key, and the logs to skip.

    The key is the log's path relative to the study's folder. The metadata of a log that has not changed since it was
    cached are taken from the cache.

    Args:
        source: the study's folder, or a single log.
        known: the logs as the cache recorded them, by key.

    Raises:
        LogError: if there is no such file or folder.
    """
    folder = find_containing_folder(source)
    key_start = len(os.fspath(folder / "_")) - 1  # after the folder's path and its separator
    fingerprints: dict[str, str] = {}
    metadata: dict[str, dict[str, str]] = {}
    participant_fingerprints: dict[str, str] = {}

    def read_metadata(log: Path, first_file: Path) -> dict[str, str]:
        """Return a log's metadata; record them and the log's fingerprint under its key."""
        key = os.fspath(log)[key_start:]
        cached = known.get(key)
        fingerprints[key] = _fingerprint_log(
            os.fspath(first_file), cached.fingerprint if cached else "", participant_fingerprints
        )
        if cached and is_same_content(fingerprints[key], cached.fingerprint):
            metadata[key] = msgspec.msgpack.decode(cached.metadata)
        else:
            metadata[key] = read_first_metadata(first_file)
        return metadata[key]

    paths, skipped = list_readable_logs(source, read_metadata)
    logs = {os.fspath(path)[key_start:]: path for path in paths}
    return {key: ListedLog(path, fingerprints[key], metadata[key]) for key, path in logs.items()}, skipped


def _fingerprint_log(first_file: str, cached: str, participant_fingerprints: dict[str, str]) -> str:
    """Fingerprint a log by its first file, its annotation file and the participant's other sessions.

    A rule that excludes a participant can be broken in any of their sessions, so the rows of each session depend on all
    of them.

    Args:
        first_file: the path of the log's first file.
        cached: the cached fingerprint, from which digests of unchanged files are taken; "" for a new log.
        participant_fingerprints: the fingerprints computed so far, by participant folder; this function adds to them.
    """
    folder = os.path.dirname(first_file)
    if not os.path.basename(folder).startswith("ses-"):
        annotation_name = os.path.basename(annotations_path(Path(first_file)))
        code = annotation_name.partition("_")[0]  # "sub-07" of sub-07_ses-01.marks.jsonl
        return _describe_files(folder, code, cached)
    participant = os.path.dirname(folder)
    if participant not in participant_fingerprints:
        folders = sorted(
            entry.path for entry in os.scandir(participant or ".") if entry.name.startswith("ses-") and entry.is_dir()
        )
        participant_fingerprints[participant] = "\n".join(_describe_files(path, "", cached) for path in folders)
    return participant_fingerprints[participant]


def _describe_files(folder: str, prefix: str, cached: str) -> str:
    """Describe the folder's files whose names begin with ``prefix``, with a line of ``describe_file`` for each.

    ``cached`` holds earlier lines, from which the digests of unchanged files are taken; "" if there are none.
    """
    folder_name = os.path.basename(folder)
    lines = []
    for entry in sorted(os.scandir(folder or "."), key=lambda entry: entry.name):
        if entry.name.startswith(prefix) and entry.is_file():
            name = f"{folder_name}/{entry.name}"
            lines.append(describe_file(entry.path, entry.stat(), name=name, known=cached))
    return "\n".join(lines)
