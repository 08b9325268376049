"""Checks names that come from a store, a database, an archive or a log, and maps them to files of a study.

A valid name is ``STUDY/CODE/ses-NN/FILE``, with parts of letters, digits, ``-``, ``_`` and ``.`` only. Any other form
is refused with a reason, so that no name leads out of its study, to a device of Windows, or to a second meaning. No
other module joins a name from outside to a folder; a test over the package's source enforces that.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from minihuman.errors import LogError
from minihuman.portable_names import explain_unportable_name

MAX_NAME_LETTERS = 200  # of one part; file systems take 255 bytes, and copies of a file get longer names
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_SESSION = re.compile(r"ses-[0-9]{2,4}")
_COMPANION_PREFIX = "._"  # macOS puts a file's attributes there, on shares and in archives
_FORM = "STUDY/CODE/ses-NN/FILE"
_SHOWN_LETTERS = 60  # of a refused name


class OutsideNameError(LogError):
    """A name from outside does not have the form of a file's place in a study."""


def is_system_companion(name: str) -> bool:
    """Return whether a file name is one under which macOS stores another file's attributes (``._sub-01.mcap``)."""
    return name.startswith(_COMPANION_PREFIX)


def explain_refused_name(name: str) -> str:
    """Return the reason why a name is refused for a study, a participant or a file; "" if it is allowed."""
    if len(name) > MAX_NAME_LETTERS:
        return f"it has {len(name)} characters; the maximum is {MAX_NAME_LETTERS}"
    if not _NAME.fullmatch(name):
        return "use letters, digits, '-', '_' and '.', with a letter or a digit first"
    return explain_unportable_name(name)


def shorten_name(name: str) -> str:
    """Return a name for a message: quoted, with control characters escaped, and shortened if it is long."""
    quoted = repr(name[:_SHOWN_LETTERS])
    if len(name) <= _SHOWN_LETTERS:
        return quoted
    return f"{quoted} and {len(name) - _SHOWN_LETTERS} more characters"


def require_name(name: str, owner: str) -> str:
    """Check that a name may be used for a folder or a file, and return it.

    Args:
        name: the unchecked name.
        owner: the thing that has the name, for the error, such as "the participant".

    Raises:
        OutsideNameError: if the name is not allowed.
    """
    if reason := explain_refused_name(name):
        raise OutsideNameError(f"{owner} {shorten_name(name)} cannot be a file's name: {reason}")
    return name


@dataclass(frozen=True, slots=True)
class StudyFile:
    """The study, participant, session and file name of a file, as parsed by ``parse``."""

    study: str
    participant: str
    session: str  # "ses-01"
    file: str

    @classmethod
    def parse(cls, name: str) -> "StudyFile":
        """Parse a name from outside.

        Raises:
            OutsideNameError: if it does not have the form ``STUDY/CODE/ses-NN/FILE``.
        """
        refusal = f"{shorten_name(name)} is refused"
        wrong_form = f"{refusal}: it is not of the form {_FORM}"
        parts = name.split("/")
        if len(parts) != _FORM.count("/") + 1:
            raise OutsideNameError(wrong_form)
        for part in parts:
            reason = explain_refused_name(part)
            if reason:
                raise OutsideNameError(f"{refusal}: {shorten_name(part)}: {reason}")
        study, participant, session, file = parts
        if not _SESSION.fullmatch(session) or participant.startswith("ses-"):
            raise OutsideNameError(wrong_form)
        return cls(study, participant, session, file)

    @property
    def name(self) -> str:
        """The file's name in a store."""
        return f"{self.study}/{self.participant}/{self.session}/{self.file}"

    def path(self, data: Path) -> Path:
        """Return the file's path in a data folder."""
        return data / self.study / self.participant / self.session / self.file


def parse_study_files(names: Iterable[str], prefix: str) -> tuple[dict[str, StudyFile], list[str]]:
    """Parse names from outside, and separate valid from refused ones.

    Args:
        names: the names, as a store lists them.
        prefix: the prefix of the listing, "study/" or "study/sub-07/"; names without it are refused.

    Returns:
        The parsed files by name, and a message for each name that is refused.
    """
    files: dict[str, StudyFile] = {}
    refusals: list[str] = []
    first_by_folded_name: dict[str, str] = {}  # the first of the names that differ only in case
    for name in sorted(names):
        try:
            file = _parse_below(name, prefix)
        except OutsideNameError as error:
            refusals.append(str(error))
            continue
        first = first_by_folded_name.setdefault(name.casefold(), name)
        if first != name:
            refusals.append(f"{shorten_name(name)} is refused: on Windows and macOS it is the same file as {first!r}")
            continue
        files[name] = file
    return files, refusals


def _parse_below(name: str, prefix: str) -> StudyFile:
    """Parse a name that must begin with ``prefix``; raise OutsideNameError if it is refused."""
    if is_system_companion(name.rpartition("/")[2]):
        raise OutsideNameError(f"{shorten_name(name)} is refused: another system keeps it beside a file for itself")
    file = StudyFile.parse(name)
    if not name.startswith(prefix):
        raise OutsideNameError(f"{shorten_name(name)} is refused: it is not below {prefix}")
    return file


def join_inside(folder: Path, name: str) -> Path:
    """Join a folder and a relative path that minihuman's own code has composed, with slashes between its parts.

    Raises:
        OutsideNameError: if a part of the path could lead out of the folder, or is too long.
    """
    for part in name.split("/"):
        is_too_long = len(part) > 2 * MAX_NAME_LETTERS  # the names of copies are longer than the files' own
        if part in ("", ".", "..") or "\\" in part or "\0" in part or is_too_long:
            raise OutsideNameError(f"{shorten_name(name)} is refused: {shorten_name(part)} is not a file's name")
    return folder / name
