"""Annotations: a reviewer's tags and notes on an episode or a session, stored beside the log, which is never edited.

``sub-07_ses-01.marks.jsonl`` holds one annotation per line, in the order in which they were made; a later line can
revoke an earlier one. Episodes are numbered as on the participant's screen and in every figure: the session's first
episode is number 1.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import partial
from pathlib import Path

import msgspec

from minihuman.errors import LogError
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.storage.file_journal import FileJournal

ANNOTATIONS_SUFFIX = ".marks.jsonl"
MAX_SHOWN_DIGITS = 12
MAX_EPISODES = 1_000_000  # per session; no plan has as many
KNOWN_TAGS = ("exclude",)  # tags that every output obeys by default
_LOG_ENDING = re.compile(r"(_seg-\d+)?\.mcap(\.part)?$")
_TAG = re.compile(r"[a-z][a-z0-9_-]*")


class Annotation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A reviewer's annotation of an episode or a session.

    ``episode`` is None for an annotation of the whole session. ``taken_back`` revokes an earlier annotation with the
    same tag.
    """

    tag: str
    at: str  # ISO 8601 UTC
    episode: int | None = None
    note: str = ""
    taken_back: bool = False
    experimenter: str = ""  # the code of the experimenter who made it


def annotations_path(log: Path) -> Path:
    """Return the path of a log's annotation file.

    The path is the same for a live, a truncated and a finished log, and for a session's folder.

    Raises:
        LogError: if a folder holds no session log, or the logs of several sessions.
    """
    if not log.is_dir():
        return log.with_name(_LOG_ENDING.sub("", log.name) + ANNOTATIONS_SUFFIX)
    stems = {_LOG_ENDING.sub("", path.name) for path in log.iterdir() if _LOG_ENDING.search(path.name)}
    if len(stems) != 1:
        raise LogError(f"{log} contains {len(stems)} session logs instead of one; name a single log file")
    return log / (stems.pop() + ANNOTATIONS_SUFFIX)


def read_annotations(log: Path) -> tuple[Annotation, ...]:
    """Read a log's annotations, the oldest first; an empty tuple if the log has none.

    Raises:
        LogError: if a line is not a valid annotation, or if a folder does not hold the logs of exactly one session.
    """
    path = annotations_path(log)
    if not path.exists():
        return ()
    return read_annotation_file(path)


def read_annotation_file(path: Path) -> tuple[Annotation, ...]:
    """Read the annotations in a file, the oldest first.

    Raises:
        LogError: if a line is damaged.
    """
    return tuple(open_annotations(path).read())


def open_annotations(path: Path) -> FileJournal[Annotation]:
    """Return an annotation file as a journal of annotations; reading it raises LogError if a line is damaged."""
    return FileJournal(path, partial(_decode_annotation, path), chained=True)


def _decode_annotation(path: Path, line: bytes, number: int) -> Annotation:
    """Decode the line with the given number of an annotation file; raise LogError if it is not an annotation."""
    try:
        return msgspec.json.decode(line, type=Annotation)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise LogError(
            f"{path}:{number}: {line.decode(errors='replace')!r} is not a valid annotation ({error}); correct or "
            "delete this line"
        ) from error


def add_annotation(log: SessionLog, mark: Annotation) -> Path:
    """Append an annotation to the file beside the log and return the file's path.

    Raises:
        LogError: if the tag is not a single word of a to z, digits, "-" and "_"; if it resembles a built-in tag and
            the annotation revokes nothing; or if the session has no such episode.
    """
    if not _TAG.fullmatch(mark.tag):
        raise LogError(
            f"{mark.tag!r} is not a valid tag; start with a lower-case letter, and use only a to z, digits, '-' and '_'"
        )
    if mark.tag not in KNOWN_TAGS and not mark.taken_back:
        _require_distinct_tag(mark.tag)
    numbers = {plan.episode + 1 for plan in log.plan.episodes}
    if mark.episode is not None and not numbers:
        raise LogError(f"{log.path} has no episodes; annotate the session without --episode")
    if mark.episode is not None and mark.episode not in numbers:
        raise LogError(f"{log.path} has no episode {mark.episode}; its episodes are {min(numbers)} to {max(numbers)}")
    path = annotations_path(log.path)
    with open_annotations(path).hold() as journal:
        journal.append(mark)
    return path


def _require_distinct_tag(tag: str) -> None:
    """Raise LogError for a tag that looks like a misspelt built-in one."""
    similar_tags = get_close_matches(tag, KNOWN_TAGS, cutoff=0.8)
    if similar_tags:
        raise LogError(
            f"tag {tag!r} is too similar to the built-in tag {similar_tags[0]!r}; use that one, or a different word"
        )


def split_annotations(
    log: SessionLog, annotations: Iterable[Annotation]
) -> tuple[tuple[Annotation, ...], tuple[Annotation, ...]]:
    """Split annotations into those that apply to the session or its episodes, and those of episodes that do not exist.

    Annotations of missing episodes can occur in a file that was edited by hand. They have no effect, and ``verify``
    names them.
    """
    numbers = {plan.episode + 1 for plan in log.plan.episodes}
    usable: list[Annotation] = []
    without_effect: list[Annotation] = []
    for annotation in annotations:
        if annotation.episode is None or annotation.episode in numbers:
            usable.append(annotation)
        else:
            without_effect.append(annotation)
    return tuple(usable), tuple(without_effect)


def describe_useless_annotation(annotation: Annotation) -> str:
    """Describe, in one line, an annotation that has no effect because its episode does not exist."""
    number = str(annotation.episode)
    if len(number) <= MAX_SHOWN_DIGITS:
        shown_number = number
    else:
        shown_number = f"{number[:MAX_SHOWN_DIGITS]}..."
    return f"annotation {annotation.tag!r} of episode {shown_number} has no effect: the session has no such episode"


def collect_tags(marks: Iterable[Annotation]) -> dict[int | None, frozenset[str]]:
    """Return the tags in force by episode number; the tags of the whole session are under None."""
    tags_by_episode: dict[int | None, set[str]] = defaultdict(set)
    for mark in marks:
        if mark.taken_back:
            tags_by_episode[mark.episode].discard(mark.tag)
        else:
            tags_by_episode[mark.episode].add(mark.tag)
    return {episode: frozenset(tags) for episode, tags in tags_by_episode.items() if tags}


def list_episode_tags(episode: EpisodeLog, in_force: Mapping[int | None, frozenset[str]]) -> frozenset[str]:
    """Return the tags in force for one episode, including those of the whole session.

    ``in_force`` holds the session's tags by episode number, as ``collect_tags`` returns them.
    """
    return in_force.get(episode.number, frozenset()) | in_force.get(None, frozenset())
