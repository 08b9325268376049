"""Reads from a study's enrolment log who withdrew. Opens no log of a session, so that a command starts quickly."""

from contextlib import closing
from pathlib import Path

import msgspec

from minihuman.errors import LogError
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME, find_database_url, open_journal
from minihuman.storage.system import current_system


class _Line(msgspec.Struct, frozen=True):
    """Of the register, which has one for each who withdrew: {"withdrawn": "sub-07", "at": ...}.

    The enrolment log's declaration has a list there.
    """

    withdrawn: str | list[str] = ""


def read_withdrawn_codes(study_dir: Path) -> frozenset[str]:
    """Read the codes of those who withdrew from the study of this folder; none where it has no register.

    Raises:
        OSError: if the enrolment log is in a database that cannot be asked.
        LogError: if one of its lines is damaged.
    """
    if url := find_database_url(study_dir):
        from minihuman.storage.postgres_journal import PostgresJournal

        connect = current_system().open_database_journal or PostgresJournal  # not the one that is kept open
        name = f"{study_dir.name}/{ENROLMENT_FILE_NAME}"
        with closing(connect(url, name, _read_code, chained=True)) as register:
            return frozenset(register.read())
    if not (study_dir / ENROLMENT_FILE_NAME).is_file():
        return frozenset()
    return frozenset(open_journal(study_dir, ENROLMENT_FILE_NAME, _read_code, chained=True).read())


def _read_code(line: bytes, number: int) -> str | None:
    """Read who withdrew by a line; None where it says nothing of that."""
    try:
        withdrawn = msgspec.json.decode(line, type=_Line).withdrawn
        return withdrawn if withdrawn and isinstance(withdrawn, str) else None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise LogError(
            f"{ENROLMENT_FILE_NAME}:{number}: {line[:60]!r} cannot be read; restore the file from a copy"
        ) from error
