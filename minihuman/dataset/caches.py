"""The cache of a study: one DuckDB file that may be deleted at any time and serves as evidence of nothing.

This module opens the file and decides when its contents are stale. Next to the data derived from a file, the cache
stores a description of that file and the digest of the code that derived the data.
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
except ModuleNotFoundError:  # an installation without DuckDB has no cache and reads its logs
    duckdb = None  # type: ignore[assignment]

TABLE_CACHE = "tables.duckdb"  # every table's rows, and the session index
INDEX_SCHEMA = "session_index"  # its rows have digests; its definition has none
IN_USE_ERRORS = (duckdb.ConnectionException, duckdb.ResourceInUseException) if duckdb else ()  # open in this process
# one process cannot open a file with two kinds of settings; with one thread, inserted rows fill whole row groups
CACHE_SETTINGS = {"threads": "1", "memory_limit": "128MB"}
LOCK_WAIT_S = 2.0  # a command does without the cache if another process holds it longer
_LOCK_POLL_S = 0.02
_LOCK_ERRORS = ("Could not set lock", "being used by another process")  # of DuckDB, on POSIX and on Windows
_END_BYTES = 64 * 1024  # of a file's beginning and end, which distinguish files of the same size
_UNSETTLED_NS = 2_000_000_000  # file systems store times in steps of up to two seconds
_FORMER = ("sessions.sqlite", "tables.files", "figures.files")  # the caches of earlier versions
_CHECKED = ".checked"  # suffix of the file that records which tables were compared with their digests
_BESIDE = ("", "-journal", "-wal", "-shm", ".wal", ".tmp", _CHECKED)  # suffixes of the files beside a cache
_NAMES = frozenset(name + more for name in (TABLE_CACHE, *_FORMER) for more in _BESIDE)


def is_cache(path: Path) -> bool:
    """Return whether a path relative to the study's folder is a cache file, or lies in a cache folder.

    Only exact names at the top of the study's folder count.
    """
    return bool(path.parts) and path.parts[0] in _NAMES


def list_caches(study: Path) -> Iterator[Path]:
    """Yield the paths of a study's existing cache files."""
    yield from (study / name for name in sorted(_NAMES) if (study / name).exists())


def connect_cache(
    file: Path, *, read_only: bool = False, wait_s: float = LOCK_WAIT_S, settings: dict[str, str] = CACHE_SETTINGS
) -> "duckdb.DuckDBPyConnection":
    """Open a cache, waiting while another process has it open.

    Another reader delays only an opening for writing; another writer delays every opening.

    Args:
        file: the cache; it is created if it does not exist and ``read_only`` is False.
        read_only: whether to open it for reading only.
        wait_s: how long to wait for another process, in seconds.
        settings: DuckDB's settings for the connection.

    Raises:
        duckdb.Error: if it cannot be opened, is not a DuckDB file, or is still in use after ``wait_s``.
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
    """Run the enclosed changes in one transaction: either all of them are kept or none."""
    connection.execute("BEGIN")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        with suppress(duckdb.Error):  # a failed commit was rolled back already
            connection.execute("ROLLBACK")
        raise


def is_in_use(error: Exception) -> bool:
    """Return whether an error of DuckDB says that a file is open elsewhere, in this or in another process."""
    return isinstance(error, IN_USE_ERRORS) or any(text in str(error) for text in _LOCK_ERRORS)


def remove_cache(file: Path) -> None:
    """Remove a cache file and its write-ahead log; do nothing if they do not exist.

    The write-ahead log goes first, because DuckDB would replay it into the next file of the same name.
    """
    file.with_name(f"{file.name}.wal").unlink(missing_ok=True)
    file.unlink(missing_ok=True)


def describe_cache(file: Path) -> str:
    """Return a line that identifies a cache's current state: change time, name, size, modification time and digest.

    The line differs after every change, because DuckDB counts changes at the beginning of the file, which the digest
    covers. Call this while the file is open, because no other process can write to it then.
    """
    status = file.stat()
    content = _drop_change_time(describe_file(file, status))
    return f"{status.st_ctime_ns} {content}"


def _drop_change_time(line: str) -> str:
    """Return a file's description without its last field, the system's change time."""
    return line.rpartition(" ")[0]


def read_checked(file: Path) -> frozenset[str]:
    """Return the names of the cache's tables that were compared with their digests.

    Return an empty set if this was not recorded, or if the cache has changed since.
    """
    try:
        described, names = file.with_name(f"{file.name}{_CHECKED}").read_text(encoding="utf-8").split("\n")
    except (OSError, ValueError):
        return frozenset()
    if described == describe_cache(file):
        return frozenset(names.split())
    return frozenset()


def write_checked(file: Path, names: Iterable[str]) -> None:
    """Record the names of a cache's tables that were compared with their digests.

    If the record cannot be written, the next command compares the tables again.
    """
    with suppress(OSError):
        record = f"{describe_cache(file)}\n{' '.join(sorted(names))}"
        path = file.with_name(f"{file.name}{_CHECKED}")
        path.write_text(record, encoding="utf-8", newline="\n")
        keep_private(path)


def describe_file(file: str | Path, status: os.stat_result | None = None, *, name: str = "", known: str = "") -> str:
    """Describe a file in one line that distinguishes it from other content of the same name.

    The line holds the name, the size, the modification time, a digest of the first and last 64 KiB, and the time at
    which the system last recorded any change; of a file that does not exist, only the name, "gone" and "-". Compare
    descriptions with ``is_same_content``.

    The change time is "-" if it cannot be trusted: for a file changed just before it was described, and on Windows,
    which does not record it.

    Args:
        file: the file's path.
        status: the file's status, if it was read already.
        name: the name in the line; by default the file's own.
        known: earlier descriptions, one per line. The digest is copied from a line in which no time differs, because
            users cannot set the system's change time back.
    """
    name = name or os.path.basename(file)
    try:
        status = status or os.stat(file)
    except FileNotFoundError:  # finished and renamed just now; the next listing finds it under its new name
        return f"{name} gone -"
    if os.name == "nt" or time.time_ns() - status.st_ctime_ns < _UNSETTLED_NS:
        change_time = "-"
    else:
        change_time = str(status.st_ctime_ns)
    head = f"{name} {status.st_size} {status.st_mtime_ns} "
    end = f" {change_time}"
    if change_time != "-":
        for line in known.split("\n"):
            if line.startswith(head) and line.endswith(end):
                return line
    if stat.S_ISREG(status.st_mode):
        digest = _digest_ends(file, status.st_size)
    else:
        digest = "no regular file"
    return head + digest + end


def is_same_content(first: str, second: str) -> bool:
    """Return whether two descriptions of files, with one line per file, describe the same content.

    The last field of each line, the system's change time, is ignored.
    """
    if first == second:
        return True
    first_contents = [_drop_change_time(line) for line in first.split("\n")]
    second_contents = [_drop_change_time(line) for line in second.split("\n")]
    return first_contents == second_contents


def _digest_ends(file: str | Path, size: int) -> str:
    """Return a digest of the first and last 64 KiB of a file of ``size`` bytes; "unreadable" if it cannot be read.

    Size and modification time are not enough: other content can have the same size, and a modification time can be set
    back.
    """
    try:
        with open(file, "rb", buffering=0) as source:
            digest = sha256(source.read(_END_BYTES))  # takes half the time of BLAKE2
            source.seek(max(_END_BYTES, size - _END_BYTES))
            digest.update(source.read(_END_BYTES))
    except OSError:  # no permission, or finished and renamed just now: reading the log says so
        return "unreadable"
    return digest.hexdigest()


@cache
def digest_files(paths: tuple[Path, ...]) -> str:
    """Return one digest of the contents of several files."""
    digest = blake2b(digest_size=8)
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def digest_sources(*packages: str) -> str:
    """Return a digest of the code in packages such as "log/model", excluding their subpackages.

    Without arguments, digest all of minihuman's code.

    Raises:
        AssertionError: if one of the packages holds no code.
    """
    root = Path(minihuman.__file__).parent
    if packages:
        sources_by_package = [sorted((root / package).glob("*.py")) for package in packages]
    else:
        sources_by_package = [sorted(root.rglob("*.py"))]
    digest = blake2b(digest_size=8)
    for sources in sources_by_package:
        if not sources:
            raise AssertionError(f"{root}: {packages} holds no code: a cache would never go stale")
        for source in sources:
            digest.update(source.read_bytes())
    return digest.hexdigest()
