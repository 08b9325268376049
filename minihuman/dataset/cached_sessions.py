"""What the table cache holds of a log besides its rows: what counts of it, and the files that it was read from."""

import os
from pathlib import Path
from typing import NamedTuple

import msgspec

from minihuman.dataset.annotations import annotations_path
from minihuman.dataset.caches import describe_file
from minihuman.dataset.recording_quality import PlanOutline, RecordingQuality
from minihuman.dataset.selection import SelectionSummary, find_practice_blocks
from minihuman.dataset.sessions import SessionRows


class CachedSession(msgspec.Struct, frozen=True):
    """What is known of a log whose rows are cached: where it is, what counts of it, or why it cannot be read."""

    path: str  # "" in the file, which names no folder outside the study
    problem: str = ""
    study: str = ""
    blocks: int = 0  # that have an episode that counts
    outline: PlanOutline | None = None  # of the session's plan; None, as the quality, of one that is not asked for
    quality: RecordingQuality | None = None
    account: tuple[int, int, tuple[tuple[str, str, int], ...], tuple[tuple[str, int], ...]] = (0, 0, (), ())
    practice: tuple[str, ...] = ()  # the blocks that its protocol does not analyse
    excluded: tuple[tuple[str, str, str], ...] = ()  # the participant, where a rule excludes them: reason, study, code

    def to_summary(self) -> SelectionSummary:
        """The account of this log alone."""
        sessions, episodes, versions, excluded_episodes = self.account
        account = SelectionSummary(sessions=sessions, episodes=episodes)
        account.versions.update({(study, version): count for study, version, count in versions})
        account.excluded_episodes.update(dict(excluded_episodes))
        account.excluded_participants.update(self.excluded)
        return account


class KnownLog(NamedTuple):
    """What the file says of a log."""

    number: int
    fingerprint: str
    with_shortest: bool
    metadata: bytes  # its first, as MessagePack


def build_cached_session(one: SessionRows) -> CachedSession:
    """Build what the cache holds of a session; its path is left to the cache's key."""
    account = one.account
    versions = tuple((*whose, count) for whose, count in account.versions.items())
    wanted = one.rows.count("participants") > 0
    return CachedSession(
        path="",
        study=one.plan.study,
        blocks=len({facts["block"] for facts in one.facts}),
        practice=tuple(sorted(find_practice_blocks(one.plan))),
        outline=PlanOutline.of(one.plan) if wanted else None,
        quality=one.quality if wanted else None,
        account=(account.sessions, account.episodes, versions, tuple(account.excluded_episodes.items())),
        excluded=tuple(sorted(account.excluded_participants)),
    )


def fingerprint_log(first: str, known: str, of_participant: dict[str, str]) -> str:
    """Of a log, by the file that it begins in, of the marks beside it, and of the participant's other sessions.

    A rule that excludes a participant may be broken in any of their sessions, so each one's rows depend on all.
    """
    folder = os.path.dirname(first)
    if not os.path.basename(folder).startswith("ses-"):
        marks = os.path.basename(annotations_path(Path(first)))
        return _describe_files(folder, marks.partition("_")[0], known)
    participant = os.path.dirname(folder)
    if participant not in of_participant:
        folders = sorted(
            entry.path for entry in os.scandir(participant or ".") if entry.name.startswith("ses-") and entry.is_dir()
        )
        of_participant[participant] = "\n".join(_describe_files(one, "", known) for one in folders)
    return of_participant[participant]


def _describe_files(folder: str, prefix: str, known: str) -> str:
    """Describe a folder's files whose names begin so, a line each; ``known`` as in ``describe_file``."""
    return "\n".join(
        describe_file(entry.path, entry.stat(), name=f"{os.path.basename(folder)}/{entry.name}", known=known)
        for entry in sorted(os.scandir(folder or "."), key=lambda entry: entry.name)
        if entry.name.startswith(prefix) and entry.is_file()
    )
