"""Names of the cache files in a study's folder: they may be deleted at any time and prove nothing."""

from collections.abc import Iterator
from pathlib import Path

SESSION_CACHE = "sessions.sqlite"  # a row a session
TABLE_CACHE = "tables.duckdb"  # every table's rows
_FORMER = ("tables.files", "figures.files")  # folders that earlier versions kept their output files in
_BESIDE = ("", "-journal", "-wal", "-shm", ".wal", ".tmp")  # what their libraries put beside them meanwhile
_NAMES = frozenset({*_FORMER, *(name + more for name in (SESSION_CACHE, TABLE_CACHE) for more in _BESIDE)})


def is_cache(path: Path) -> bool:
    """Whether a path, as seen from its study's folder, is a cache's or in one: by its exact name, at the top."""
    return bool(path.parts) and path.parts[0] in _NAMES


def list_caches(study: Path) -> Iterator[Path]:
    """The caches of a study that are there now."""
    yield from (study / name for name in sorted(_NAMES) if (study / name).exists())
