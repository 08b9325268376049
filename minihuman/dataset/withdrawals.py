"""Participants who withdrew from a study: their data are included nowhere, and no message names them."""

from collections.abc import Iterable
from contextlib import closing
from functools import cache
from itertools import islice
from pathlib import Path

import msgspec

from minihuman.dataset.journal import ENROLMENT_FILE_NAME, find_database_url, open_journal
from minihuman.errors import LogError

_UP = 3  # from a session's folder to its study's: <study>/sub-07/ses-01


class _Line(msgspec.Struct, frozen=True):
    """Of the register, which has one for each who withdrew: {"withdrawn": "sub-07", "at": ...}.

    The enrolment log's declaration has a list there.
    """

    withdrawn: str | list[str] = ""


def read_withdrawn_codes(study_dir: Path) -> frozenset[str]:
    """The codes of those who withdrew from the study of this folder; none where it has no register.

    Raises:
        OSError: if the enrolment log is in a database that cannot be asked.
        LogError: if one of its lines is damaged.
    """
    if url := find_database_url(study_dir):
        from minihuman.dataset.journal_postgres import PostgresJournal

        with closing(PostgresJournal(url, f"{study_dir.name}/{ENROLMENT_FILE_NAME}", _code, chained=True)) as register:
            return frozenset(register.read())
    if not (study_dir / ENROLMENT_FILE_NAME).is_file():
        return frozenset()
    return frozenset(open_journal(study_dir, ENROLMENT_FILE_NAME, _code, chained=True).read())


def find_withdrawn_codes(folders: Iterable[Path]) -> dict[Path, frozenset[str]]:
    """By session's folder or folder of logs: the codes of those who withdrew from the study that it lies in."""
    once = cache(read_withdrawn_codes)  # many lie in the same one

    def near(folder: Path) -> frozenset[str]:
        return frozenset().union(*(once(one) for one in (folder, *islice(folder.parents, _UP))))

    return {folder: near(folder.absolute()) for folder in folders}


def _code(line: bytes, number: int) -> str | None:
    """Who withdrew by a line; None where it says nothing of that."""
    try:
        withdrawn = msgspec.json.decode(line, type=_Line).withdrawn
        return withdrawn if withdrawn and isinstance(withdrawn, str) else None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise LogError(
            f"{ENROLMENT_FILE_NAME}:{number}: {line[:60]!r} cannot be read; restore the file from a copy"
        ) from error
