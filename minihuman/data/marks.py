"""Marks: what a reviewer says about an episode or a session, kept beside the log, which is never edited.

``sub-07_ses-01.marks.jsonl`` holds one mark a line, in the order they were made; a mark is taken back by another line.
Episodes are numbered as on the participant's screen and in every figure: 1 is the session's first.
"""

import os
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from minihuman.errors import LogError, naming
from minihuman.recorded.episode import Episode, SessionLog

MARKS_SUFFIX = ".marks.jsonl"
_LOG_ENDING = re.compile(r"(_seg-\d+)?\.mcap(\.part)?$")
_TAG = re.compile(r"[a-z][a-z0-9_-]*")


class Mark(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One remark. ``episode`` None means the whole session; ``taken_back`` undoes an earlier mark of that tag."""

    tag: str
    at: str  # ISO 8601 UTC
    episode: int | None = None
    note: str = ""
    taken_back: bool = False


def marks_path(log: Path) -> Path:
    """Where a log's marks are; the same for a live, a cut-off and a finished log, and for a session's folder."""
    if not log.is_dir():
        return log.with_name(_LOG_ENDING.sub("", log.name) + MARKS_SUFFIX)
    stems = {_LOG_ENDING.sub("", path.name) for path in log.iterdir() if _LOG_ENDING.search(path.name)}
    if len(stems) != 1:
        raise LogError(f"{log} holds {len(stems)} session logs, not one; name a file")
    return log / (stems.pop() + MARKS_SUFFIX)


def read_marks(log: Path) -> tuple[Mark, ...]:
    """Read a log's marks, the oldest first; none if it has none.

    Raises:
        LogError: if a line cannot be understood.
    """
    path = marks_path(log)
    if not path.exists():
        return ()
    decoder = msgspec.json.Decoder(Mark)
    marks = []
    for number, line in enumerate(path.read_bytes().splitlines(), 1):
        try:
            marks.append(decoder.decode(line))
        except msgspec.DecodeError as error:
            raise LogError(f"{path}:{number}: {line.decode(errors='replace')!r} is no mark ({error})") from error
    return tuple(marks)


def add_mark(log: SessionLog, mark: Mark) -> Path:
    """Append a mark beside the log and say where.

    Raises:
        LogError: if the tag is no word, or the session has no such episode.
    """
    if not _TAG.fullmatch(mark.tag):
        raise LogError(f"tag {mark.tag!r} is no word of small letters, digits, '-' and '_' that begins with a letter")
    numbers = {plan.episode + 1 for plan in log.plan.episodes}
    if mark.episode is not None and mark.episode not in numbers:
        raise LogError(f"{log.path} has no episode {mark.episode}; it has {min(numbers)} to {max(numbers)}")
    path = marks_path(log.path)
    with naming(path), path.open("ab") as file:
        file.write(msgspec.json.encode(mark) + b"\n")
        file.flush()
        os.fsync(file.fileno())
    return path


def tags(marks: Iterable[Mark]) -> dict[int | None, frozenset[str]]:
    """The tags in force, by episode number; under None those of the whole session."""
    found: dict[int | None, set[str]] = defaultdict(set)
    for mark in marks:
        (found[mark.episode].discard if mark.taken_back else found[mark.episode].add)(mark.tag)
    return {episode: frozenset(theirs) for episode, theirs in found.items() if theirs}


def tags_of(episode: Episode, in_force: Mapping[int | None, frozenset[str]]) -> frozenset[str]:
    """The tags of one episode, the whole session's included."""
    return in_force.get(episode.number, frozenset()) | in_force.get(None, frozenset())
