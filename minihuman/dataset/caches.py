"""The cache of a study, one DuckDB file that may be deleted at any time and proves nothing: how it is opened, and when
what is in it is stale.

Each part of it stores, beside what was made of a file, that file's description and the digest of the code that made it.
"""

import os
import stat
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import blake2b, sha256
from pathlib import Path

import minihuman
from minihuman.operating_system import keep_private

try:
    import duckdb as duckdb
except ModuleNotFoundError:  # a station does without a cache, and reads its logs
    duckdb = None  # type: ignore[assignment]

TABLE_CACHE = "tables.duckdb"  # every table's rows, and the session index
INDEX_SCHEMA = "session_index"  # which has a digest per row, and none of its definition
IN_USE_ERRORS = (duckdb.ConnectionException, duckdb.ResourceInUseException) if duckdb else ()  # open in this process
# one process cannot open it with two kinds; with one thread, rows that are put in take whole pieces of the file
CACHE_SETTINGS = {"threads": "1", "memory_limit": "128MB"}
LOCK_WAIT_S = 2.0  # how long another process may hold it before a command does without it
_LOCK_POLL_S = 0.02
_LOCK_ERRORS = ("Could not set lock", "being used by another process")  # of DuckDB, on POSIX and on Windows
_END_BYTES = 64 * 1024  # of a file's beginning and end, which tell it from another of the same size
_UNSETTLED_NS = 2_000_000_000  # file systems count in steps of up to two seconds
_FORMER = ("sessions.sqlite", "tables.files", "figures.files")  # what earlier versions kept
_CHECKED = ".checked"  # of the file that says as of when its rows were compared with their digests
_BESIDE = ("", "-journal", "-wal", "-shm", ".wal", ".tmp", _CHECKED)  # what we and libraries put beside them
_NAMES = frozenset(name + more for name in (TABLE_CACHE, *_FORMER) for more in _BESIDE)


def is_cache(path: Path) -> bool:
    """Tell whether a path, as seen from its study's folder, is a cache's or in one: by its exact name, at the top."""
    return bool(path.parts) and path.parts[0] in _NAMES


def list_caches(study: Path) -> Iterator[Path]:
    """List the caches of a study that exist now."""
    yield from (study / name for name in sorted(_NAMES) if (study / name).exists())


def connect_cache(
    file: Path, *, read_only: bool = False, wait_s: float = LOCK_WAIT_S, settings: dict[str, str] = CACHE_SETTINGS
) -> "duckdb.DuckDBPyConnection":
    """Open a cache, once no other process has it open for writing, or at all if it is to be written.

    Raises:
        duckdb.Error: if it cannot be opened, is none, or is still in use after ``wait_s``.
    """
    deadline_s = time.monotonic() + wait_s
    while True:
        try:
            connection = duckdb.connect(str(file), read_only=read_only, config=dict(settings))
        except duckdb.IOException as error:
            if not is_in_use(error) or time.monotonic() > deadline_s:
                raise
        else:
            if not read_only:
                keep_private(file)
            return connection
        time.sleep(_LOCK_POLL_S)


@contextmanager
def transaction(connection: "duckdb.DuckDBPyConnection") -> Iterator[None]:
    """Keep all changes that are made inside, or none of them."""
    connection.execute("BEGIN")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        with suppress(duckdb.Error):  # a failed commit was rolled back already
            connection.execute("ROLLBACK")
        raise


def is_in_use(error: Exception) -> bool:
    """Tell whether a cache could not be opened because this or another process has it open."""
    return isinstance(error, IN_USE_ERRORS) or any(text in str(error) for text in _LOCK_ERRORS)


def remove_cache(file: Path) -> None:
    """Remove a database, its write-ahead log first: that alone would be replayed into the next file of the name."""
    file.with_name(f"{file.name}.wal").unlink(missing_ok=True)
    file.unlink(missing_ok=True)


def describe_cache(file: Path) -> str:
    """Describe a cache so that every change shows: DuckDB counts its changes at the beginning of a file.

    Nothing else can write it while it is open.
    """
    facts = file.stat()
    return f"{facts.st_ctime_ns} {describe_file(file, facts).rpartition(' ')[0]}"


def read_checked(file: Path) -> frozenset[str]:
    """Read which tables of a cache were compared with their digests, if it was not changed since; none otherwise."""
    try:
        described, names = file.with_name(f"{file.name}{_CHECKED}").read_text(encoding="utf-8").split("\n")
    except (OSError, ValueError):
        return frozenset()
    if described == describe_cache(file):
        return frozenset(names.split())
    return frozenset()


def write_checked(file: Path, names: Iterable[str]) -> None:
    """Note which tables of a cache were compared; where that cannot be written the next command compares again."""
    with suppress(OSError):
        noted = f"{describe_cache(file)}\n{' '.join(sorted(names))}"
        path = file.with_name(f"{file.name}{_CHECKED}")
        path.write_text(noted, encoding="utf-8", newline="\n")
        keep_private(path)


def describe_file(file: str | Path, facts: os.stat_result | None = None, *, name: str = "", known: str = "") -> str:
    """Tell a file from other content of the same name: by size, time, a digest of the first and last 64 KiB, and when
    the system says that it was last changed in any way.

    The digest is taken from an earlier description among the lines ``known`` where none of the times differ: nobody can
    set that last one back. It is not trusted of a file changed just before it was described, nor on Windows, which
    does not know it. ``is_same_content`` compares. ``name`` is what the line says instead of the file's own.
    """
    name = name or os.path.basename(file)
    try:
        facts = facts or os.stat(file)
    except FileNotFoundError:  # finished and renamed just now; the next listing finds it under its new name
        return f"{name} gone -"
    if os.name == "nt" or time.time_ns() - facts.st_ctime_ns < _UNSETTLED_NS:
        changed = "-"
    else:
        changed = str(facts.st_ctime_ns)
    head = f"{name} {facts.st_size} {facts.st_mtime_ns} "
    end = f" {changed}"
    if changed != "-":
        for line in known.split("\n"):
            if line.startswith(head) and line.endswith(end):
                return line
    if stat.S_ISREG(facts.st_mode):
        ends = _digest_ends(file, facts.st_size)
    else:
        ends = "no regular file"
    return head + ends + end


def is_same_content(description: str, other: str) -> bool:
    """Tell whether two descriptions of files, a line each, are of the same content, whenever it was put there."""
    return description == other or [line.rpartition(" ")[0] for line in description.split("\n")] == [
        line.rpartition(" ")[0] for line in other.split("\n")
    ]


def _digest_ends(file: str | Path, size: int) -> str:
    """Digest the first and last 64 KiB of a file: other content may have its size, and the time be set back."""
    try:
        with open(file, "rb", buffering=0) as source:
            digest = sha256(source.read(_END_BYTES))  # half of what BLAKE2 takes
            source.seek(max(_END_BYTES, size - _END_BYTES))
            digest.update(source.read(_END_BYTES))
    except OSError:  # no permission, or finished and renamed just now: reading the log says so
        return "unreadable"
    return digest.hexdigest()


@cache
def digest_files(paths: tuple[Path, ...]) -> str:
    """Digest the contents of files."""
    digest = blake2b(digest_size=8)
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def digest_sources(*packages: str) -> str:
    """Digest the code of packages ("log/model"), without those below them; of none, all of minihuman's."""
    root = Path(minihuman.__file__).parent
    digest = blake2b(digest_size=8)
    for sources in [sorted((root / package).glob("*.py")) for package in packages] or [sorted(root.rglob("*.py"))]:
        if not sources:
            raise AssertionError(f"{root}: {packages} holds no code: a cache would never go stale")
        for source in sources:
            digest.update(source.read_bytes())
    return digest.hexdigest()
