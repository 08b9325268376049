"""Who has withdrawn from a study: their data count nowhere, and no message names them."""

from collections.abc import Iterable
from contextlib import closing
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path

import msgspec

from minihuman.data.journals import REGISTER, database_of

_UP = 3  # from a session's folder to its study's: <study>/sub-07/ses-01


class _Line(msgspec.Struct, frozen=True):
    """Of the register, which has one for each who withdrew: {"withdrawn": "sub-07", "at": ...}."""

    withdrawn: str = ""


def withdrawn(study_dir: Path) -> frozenset[str]:
    """The codes of those who withdrew from the study of this folder; none where it has no register.

    Raises:
        OSError: if the register is in a database that cannot be asked.
    """
    if url := database_of(study_dir):
        from minihuman.data.journal_postgres import PostgresJournal

        with closing(PostgresJournal(url, f"{study_dir.name}/{REGISTER}", _code)) as register:
            return frozenset(register.read())
    path = study_dir / REGISTER
    try:
        changed = path.stat()
    except OSError:
        return frozenset()
    return _read(path, changed.st_size, changed.st_mtime_ns)


def withdrawn_near(folders: Iterable[Path]) -> dict[Path, frozenset[str]]:
    """By session's folder or folder of logs: the codes of those who withdrew from the study that it lies in."""
    once = cache(withdrawn)  # many lie in the same one

    def near(folder: Path) -> frozenset[str]:
        return frozenset().union(*(once(one) for one in (folder, *islice(folder.parents, _UP))))

    return {folder: near(folder.absolute()) for folder in folders}


@lru_cache(maxsize=64)
def _read(path: Path, size: int, mtime_ns: int) -> frozenset[str]:
    """``size`` and ``mtime_ns`` make a register that has grown another one."""
    codes = (_code(line, number) for number, line in enumerate(path.read_bytes().splitlines(), 1))
    return frozenset(code for code in codes if code is not None)


def _code(line: bytes, number: int) -> str | None:
    """Who withdrew by a line; None where it says nothing of that."""
    try:
        return msgspec.json.decode(line, type=_Line).withdrawn or None
    except msgspec.DecodeError:  # a line that a crash cut off; the register's own reader names a damaged one
        return None
