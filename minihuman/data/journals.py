"""Where a study's journals are: files in its folder, or a database that ``register.url`` in the data folder names.

A study that has begun in files goes on in files: what the database has not would else be lost, withdrawals among it.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from minihuman.data.journal import Decode, FileJournal, Journal

URL_FILE_NAME = "register.url"
REGISTER = "register.jsonl"  # who took which slot, and who left it
ARRIVALS = "arrivals.jsonl"  # who came by which link
Line = TypeVar("Line")


def journal(study_dir: Path, name: str, decode: Decode[Line], *, mode: int = 0o644) -> Journal[Line]:
    """A study's journal of that name; the same object for whoever asks again in this process."""
    study_dir = study_dir.absolute()
    url = database_of(study_dir)
    made: Any = (
        _in_database(url, f"{study_dir.name}/{name}", decode) if url else _in_file(study_dir / name, decode, mode)
    )
    return made  # type: ignore[no-any-return]


def database_of(study_dir: Path) -> str:
    """The address of the database that holds a study's journals; "" where they are files."""
    study_dir = study_dir.absolute()
    path = study_dir.parent / URL_FILE_NAME
    if not path.is_file() or any((study_dir / name).exists() for name in (REGISTER, ARRIVALS)):
        return ""
    return path.read_text().strip()


@cache
def _in_file(path: Path, decode: Callable[..., Any], mode: int) -> Journal[Any]:
    return FileJournal(path, decode, mode=mode)


@cache
def _in_database(url: str, name: str, decode: Callable[..., Any]) -> Journal[Any]:
    from minihuman.data.journal_postgres import PostgresJournal

    return PostgresJournal(url, name, decode)
