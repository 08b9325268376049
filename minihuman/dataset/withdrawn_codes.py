"""Read from a study's enrolment log which participants withdrew.

The module opens no session log, so that commands start quickly.
"""

import re
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import msgspec

from minihuman.errors import LogError
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME, find_database_url, open_journal
from minihuman.storage.system import current_system


class _Line(msgspec.Struct, frozen=True):
    """A line of the enrolment log that names a participant who withdrew: {"withdrawn": "sub-07", "at": ...}.

    In the line that declares the enrolment log's format, the field is a list.
    """

    withdrawn: str | list[str] = ""


_CODE = re.compile(r"(sub|model)-[0-9]{2,9}", re.ASCII)  # as the enrolment log gives them
LEDGER_FILE_NAME = "withdrawals.jsonl"  # in the data folder: what this machine knows of the erasure ledger
_MAX_QUOTED = 60  # characters of a damaged line in an error message


class LedgerEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """An entry of the erasure ledger, which ``minihuman.admin.erasure_ledger`` explains."""

    fact: str  # "holds", "withdrawn", "erased" or "lost"
    code: str = ""  # the participant's
    machine: str = ""
    study: str = ""  # in a data folder's file, which has all its studies'


def read_local_ledger(data_dir: Path, study: str) -> Iterator[LedgerEntry]:
    """Yield the entries about one study from a data folder's copy of the erasure ledger.

    The field ``study`` of the entries is "", as in a study's shared ledger. Damaged lines are skipped. Nothing is
    yielded if the folder has no copy.
    """
    try:
        lines = (data_dir / LEDGER_FILE_NAME).read_bytes().splitlines()
    except FileNotFoundError:
        return
    for line in lines:
        with suppress(msgspec.DecodeError):  # a line that a crash cut off
            entry = msgspec.json.decode(line, type=LedgerEntry)
            if entry.study == study and (not entry.code or _CODE.fullmatch(entry.code)):
                yield msgspec.structs.replace(entry, study="")


def read_withdrawn_codes(study_dir: Path) -> frozenset[str]:
    """Return the codes of participants who withdrew from the study in a folder, on this or another machine.

    Raises:
        OSError: if the enrolment log is in a database that cannot be reached.
        LogError: if a line of the enrolment log is damaged.
    """
    if url := find_database_url(study_dir):
        from minihuman.storage.postgres_journal import PostgresJournal

        # opened for this call alone, not the shared journal of ``open_journal``, so that it can be closed here
        connect = current_system().open_database_journal or PostgresJournal
        name = f"{study_dir.name}/{ENROLMENT_FILE_NAME}"
        with closing(connect(url, name, _read_code, chained=True)) as register:
            return frozenset(register.read())
    study_dir = study_dir.absolute()
    entries = read_local_ledger(study_dir.parent, study_dir.name)
    elsewhere = frozenset(entry.code for entry in entries if entry.fact == "withdrawn")
    if not (study_dir / ENROLMENT_FILE_NAME).is_file():
        return elsewhere
    return elsewhere.union(open_journal(study_dir, ENROLMENT_FILE_NAME, _read_code, chained=True).read())


def _read_code(line: bytes, number: int) -> str | None:
    """Return the code of the participant who withdrew according to a line; None if the line records no withdrawal.

    Raises:
        LogError: if the line is damaged, or names no participant code.
    """
    try:
        withdrawn = msgspec.json.decode(line, type=_Line).withdrawn
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise LogError(
            f"{ENROLMENT_FILE_NAME}:{number}: {line[:_MAX_QUOTED]!r} cannot be read; restore the file from a copy"
        ) from error
    if not withdrawn or not isinstance(withdrawn, str):
        return None
    if not _CODE.fullmatch(withdrawn):  # a code names the folder to erase, so nothing else is accepted
        raise LogError(
            f"{ENROLMENT_FILE_NAME}:{number}: {withdrawn[:_MAX_QUOTED]!r} is not a participant code; restore the file "
            "from a copy"
        )
    return withdrawn
