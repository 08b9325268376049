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
    """Return whether another operating system keeps a file of that name beside ours (``._sub-01.mcap``)."""
    return name.startswith(_COMPANION_PREFIX)


def explain_refused_name(name: str) -> str:
    """Return the reason why no study, participant or file can have a name; "" if one can."""
    if len(name) > MAX_NAME_LETTERS:
        return f"it has {len(name)} characters; the maximum is {MAX_NAME_LETTERS}"
    if not _NAME.fullmatch(name):
        return "use letters, digits, '-', '_' and '.', with a letter or a digit first"
    return explain_unportable_name(name)


def shorten_name(name: str) -> str:
    """Return a name from outside as a message may show it: shortened, with its control characters escaped."""
    quoted = repr(name[:_SHOWN_LETTERS])
    if len(name) <= _SHOWN_LETTERS:
        return quoted
    return f"{quoted} and {len(name) - _SHOWN_LETTERS} more characters"


def require_name(name: str, owner: str) -> str:
    """Return a name after checking that it may be that of a folder or a file.

    Args:
        name: the name, as it was given from outside.
        owner: what has the name, for the error, such as "the participant".

    Raises:
        OutsideNameError: if the name is not allowed.
    """
    if reason := explain_refused_name(name):
        raise OutsideNameError(f"{owner} {shorten_name(name)} cannot be a file's name: {reason}")
    return name


@dataclass(frozen=True, slots=True)
class StudyFile:
    """The place of a file in a study, as parsed by ``parse``."""

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
        prefix: the prefix for which the caller asked, "study/" or "study/sub-07/"; names outside it are refused.

    Returns:
        The parsed files by name, and a line for each name that is refused.
    """
    files: dict[str, StudyFile] = {}
    refusals: list[str] = []
    by_folded_name: dict[str, str] = {}
    for name in sorted(names):
        try:
            file = _parse_below(name, prefix)
        except OutsideNameError as error:
            refusals.append(str(error))
            continue
        twin = by_folded_name.setdefault(name.casefold(), name)
        if twin != name:
            refusals.append(f"{shorten_name(name)} is refused: on Windows and macOS it is the same file as {twin!r}")
            continue
        files[name] = file
    return files, refusals


def _parse_below(name: str, prefix: str) -> StudyFile:
    if is_system_companion(name.rpartition("/")[2]):
        raise OutsideNameError(f"{shorten_name(name)} is refused: another system keeps it beside a file for itself")
    file = StudyFile.parse(name)
    if not name.startswith(prefix):
        raise OutsideNameError(f"{shorten_name(name)} is refused: it is not below {prefix}")
    return file


def join_inside(folder: Path, name: str) -> Path:
    """Return the path inside a folder of a file that our own code has named; the name may contain slashes.

    Raises:
        OutsideNameError: if a part of the name would lead out of the folder.
    """
    for part in name.split("/"):
        if part in ("", ".", "..") or "\\" in part or "\0" in part or len(part) > 2 * MAX_NAME_LETTERS:
            raise OutsideNameError(f"{shorten_name(name)} is refused: {shorten_name(part)} is not a file's name")
    return folder / name
