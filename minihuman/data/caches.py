"""What is in a study's folder only so that nothing is done twice: it may be deleted at any time, and proves nothing."""

from collections.abc import Iterator
from pathlib import Path

SESSIONS = "sessions.sqlite"  # a row a session
TABLES = "tables.duckdb"  # every table's rows
FILES = "tables.files"  # a folder of the table files that were written last
FIGURES = "figures.files"  # a folder of the figures that a report drew last
_BESIDE = ("", "-journal", "-wal", "-shm", ".wal", ".tmp")  # what their libraries put beside them meanwhile
_NAMES = frozenset({FILES, FIGURES, *(name + more for name in (SESSIONS, TABLES) for more in _BESIDE)})


def is_cache(path: Path) -> bool:
    """Whether a path, as seen from its study's folder, is a cache's or in one: by its exact name, at the top."""
    return bool(path.parts) and path.parts[0] in _NAMES


def caches_in(study: Path) -> Iterator[Path]:
    """The caches of a study that are there now."""
    yield from (study / name for name in sorted(_NAMES) if (study / name).exists())
