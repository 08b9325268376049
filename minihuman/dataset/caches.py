"""Names of the cache files in a study's folder, which may be deleted at any time and prove nothing, and the digest of
the code that makes what is kept.
"""

from collections.abc import Iterator
from functools import cache
from hashlib import blake2b
from pathlib import Path

import minihuman

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


@cache
def digest_sources(*packages: str) -> str:
    """Digest the code of packages ("log/model"), without those below them; of none, all of minihuman's."""
    root, digest = Path(minihuman.__file__).parent, blake2b(digest_size=8)
    for sources in [sorted((root / package).glob("*.py")) for package in packages] or [sorted(root.rglob("*.py"))]:
        if not sources:
            raise AssertionError(f"{root}: {packages} holds no code: a cache would never go stale")
        for source in sources:
            digest.update(source.read_bytes())
    return digest.hexdigest()
