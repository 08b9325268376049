"""The location of a study's journals: files in its folder, or the database that ``register.url`` names.

A study that began with files keeps using files, because the database lacks its earlier lines, withdrawals among them.
"""

import atexit
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from minihuman.storage.file_journal import FileJournal
from minihuman.storage.journal import Journal, Line, LineDecoder
from minihuman.storage.system import current_system

URL_FILE_NAME = "register.url"
ENROLMENT_FILE_NAME = "register.jsonl"  # which participant took or left which slot
ARRIVALS_FILE_NAME = "arrivals.jsonl"  # which participant used which link


def open_journal(
    study_dir: Path,
    name: str,
    decode: LineDecoder[Line],
    *,
    mode: int = 0o600,
    chained: bool = False,
    declaration: Line | None = None,
) -> Journal[Line]:
    """Open a journal of a study, in a file or in the study's database.

    Calls with equal arguments return the same object within a process.

    Args:
        study_dir: the study's folder.
        name: the file name of the journal, which is a part of its name in a database.
        decode: decodes a line, or returns None to skip it.
        mode: the permissions of the file; ignored in a database.
        chained: whether each line has a checksum and the head of the chain before it, as in ``FileJournal``.
        declaration: a line that is written before the first added line, as in ``FileJournal``; None for none.
    """
    study_dir = study_dir.absolute()
    url = find_database_url(study_dir)
    if url:
        return _open_in_database(url, f"{study_dir.name}/{name}", decode, chained, declaration)
    return _open_in_file(study_dir / name, decode, mode, chained, declaration)


def find_database_url(study_dir: Path) -> str:
    """Return the address of the database that holds a study's journals; "" if they are files."""
    study_dir = study_dir.absolute()
    path = study_dir.parent / URL_FILE_NAME
    journal_files = (study_dir / ENROLMENT_FILE_NAME, study_dir / ARRIVALS_FILE_NAME)
    if not path.is_file() or any(file.exists() for file in journal_files):
        return ""
    return path.read_text(encoding="utf-8").strip()


@cache
def _open_in_file(path: Path, decode: Callable[..., Any], mode: int, chained: bool, declaration: Any) -> Journal[Any]:
    return FileJournal(path, decode, mode=mode, chained=chained, declaration=declaration)


@cache
def _open_in_database(url: str, name: str, decode: Callable[..., Any], chained: bool, declaration: Any) -> Journal[Any]:
    if (open_replacement := current_system().open_database_journal) is not None:
        return open_replacement(url, name, decode, chained=chained, declaration=declaration)  # type: ignore[no-any-return]
    from minihuman.storage.postgres_journal import PostgresJournal

    journal = PostgresJournal(url, name, decode, chained=chained, declaration=declaration)
    atexit.register(journal.close)  # the cache keeps the journal until the process ends
    return journal
