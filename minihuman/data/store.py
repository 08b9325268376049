"""The store: a study's tables kept beside it in ``tables.duckdb``, so that no log is read twice.

It is a cache: whenever it is asked it is first brought up to date, by comparing the sizes and times of logs and marks,
and it may be deleted at any time. What it holds is what the default selection says of every session; for another
selection, or where the file cannot be written, for want of room or of leave, or is another process's, the same tables
are made in a temporary file.
"""

import hashlib
import os
import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

import duckdb
import msgspec
import pyarrow as pa

from minihuman.data.caches import FILES
from minihuman.data.caches import TABLES as FILE_NAME
from minihuman.data.counted import Account
from minihuman.data.kept_files import KeptFiles
from minihuman.data.marks import marks_path
from minihuman.data.opened import Skipped, each_log, worth_reading
from minihuman.data.quality import Outline, Quality
from minihuman.data.rows import Rows
from minihuman.data.selection import Selection
from minihuman.data.study import SessionRows, Sessions, read_rows
from minihuman.data.table_file import OfAnotherVersionError, TableFile, made_by
from minihuman.errors import LogError, StoreError

_TOGETHER = 256  # sessions put in at once: half the work of 64, as whole pieces of the file are written at once


class Kept(msgspec.Struct, frozen=True):
    """What is known of a log whose rows are kept: where it is, what counts of it, or why it cannot be read."""

    path: str
    problem: str = ""
    study: str = ""
    blocks: int = 0  # that have an episode that counts
    outline: Outline | None = None  # of the session's plan; None, as the quality, of one that is not asked for
    quality: Quality | None = None
    account: tuple[int, int, tuple[tuple[str, str, int], ...], tuple[tuple[str, str, int], ...]] = (0, 0, (), ())

    def taken(self) -> Account:
        """The account of this log alone."""
        sessions, episodes, versions, left_out = self.account
        account = Account(sessions=sessions, episodes=episodes)
        account.versions.update({(study, version): count for study, version, count in versions})
        account.left_out.update({(level, reason): count for level, reason, count in left_out})  # type: ignore[misc]
        return account


class Store:
    """The tables of a study's sessions, up to date as of when it was opened. Use it in a ``with``.

    Opening it fills the sessions' account.

    Args:
        sessions: of which study, and what counts.
        with_shortest: whether the fewest possible steps are worked out, which takes the worlds themselves.

    Raises:
        LogError: if there is no such file or folder, or it is a single log that cannot be read.
        StoreError: if there is no room for the tables, beside the study or among the temporary files.
    """

    def __init__(self, sessions: Sessions, *, with_shortest: bool) -> None:
        self.kept: tuple[Kept, ...] = ()  # every log, in order of path
        self._keys: tuple[str, ...] = ()
        self._with_shortest = with_shortest
        self._sessions = sessions
        paths, skipped = worth_reading(sessions.source)
        self.files: KeptFiles | None = None  # None where the rows are kept for this once only
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self.tables = self._open()
        try:
            for one in skipped:
                sessions.skip(one)
            now = {_key(path, sessions.source): path for path in paths}
            try:
                self._refresh(now)
            except duckdb.Error:
                if self._temporary is not None:
                    raise
                self.tables.close()
                self.tables = self._aside()
                self._refresh(now)
        except duckdb.Error as error:
            self.close()
            raise _no_room(sessions.source, error) from error
        except BaseException:
            self.close()
            raise

    def facts(self) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Every log with the facts of each episode in it that counts."""
        paths = {path: self._sessions.source / path for path in self._keys}
        found = self.tables.connection.execute("SELECT key, facts FROM kept.logs")
        while lines := found.fetchmany(_TOGETHER):
            for key, facts in lines:
                yield from ((paths[key], of_episode) for of_episode in msgspec.msgpack.decode(facts))

    def close(self) -> None:
        """Leave the file to others."""
        self.tables.close()
        if self._temporary is not None:
            self._temporary.cleanup()

    def __enter__(self) -> "Store":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _open(self) -> TableFile:
        """The study's own file if it can hold what is asked for, else one that goes away."""
        own = self._sessions.source / FILE_NAME
        if self._sessions.selection == Selection() and own.parent.is_dir():
            for _ in ("as it is", "anew"):
                try:
                    return TableFile(own)
                except duckdb.IOException:  # another process has it, or the folder may not be written
                    break
                except (OfAnotherVersionError, duckdb.Error):  # cut off, no such file at all, or there is no room
                    for file in (own, own.with_name(f"{own.name}.wal")):
                        file.unlink(missing_ok=True)
        return self._aside()

    def _aside(self) -> TableFile:
        """A file that goes away."""
        self._temporary = tempfile.TemporaryDirectory(prefix="minihuman-")
        try:
            return TableFile(Path(self._temporary.name) / FILE_NAME)
        except duckdb.Error as error:
            self._temporary.cleanup()
            raise _no_room(self._sessions.source, error) from error

    def _refresh(self, now: dict[str, Path]) -> None:
        logs = self.tables.connection
        prints = {key: _fingerprint(path) for key, path in now.items()}
        known = logs.execute("SELECT key, log, fingerprint, with_shortest FROM kept.logs").fetchall()
        have = {
            key: number
            for key, number, fingerprint, with_shortest in known
            if prints.get(key) == fingerprint and with_shortest >= self._with_shortest
        }
        stale = [number for key, number, *_ in known if key not in have]
        if stale:
            self.tables.remove(stale)
            logs.execute("DELETE FROM kept.logs WHERE log IN (SELECT unnest(?))", (stale,))
        fresh = {key: path for key, path in now.items() if key not in have}
        if fresh:
            self._read(fresh, prints)
        about = logs.execute("SELECT key, log, about FROM kept.logs").fetchall()
        found = {key: (number, msgspec.msgpack.decode(of_log, type=Kept)) for key, number, of_log in about}
        self.tables.put_in_order([found[key][0] for key in now])
        if self._temporary is None:
            shortest = {key: with_shortest for key, _, _, with_shortest in known if key in have}
            of = [(key, prints[key], shortest.get(key, self._with_shortest)) for key in now]
            self.files = KeptFiles(self._sessions.source / FILES, _digest(made_by(), pa.__version__, of))
        self.kept = tuple(msgspec.structs.replace(found[key][1], path=str(now[key])) for key in now)  # they may move
        self._keys = tuple(now)
        for one in self.kept:
            if one.problem:
                self._sessions.skip(Skipped(Path(one.path), one.problem))
            else:
                self._sessions.account.add(one.taken())

    def _read(self, fresh: dict[str, Path], prints: dict[str, str]) -> None:
        """Read logs and keep their rows, some sessions at a time."""
        logs = self.tables.connection
        ((last,),) = logs.execute("SELECT coalesce(max(log), 0) FROM kept.logs").fetchall()
        work = partial(read_rows, selection=self._sessions.selection, with_shortest=self._with_shortest)
        found = each_log(list(fresh.values()), work, processes=self._sessions.processes)
        numbered = enumerate(zip(fresh, found, strict=True), last + 1)
        while batch := list(islice(numbered, _TOGETHER)):
            rows: dict[int, Rows] = {}
            lines = []
            for number, (key, one) in batch:
                facts: tuple[dict[str, Any], ...] = ()
                if isinstance(one, Skipped):
                    if not self._sessions.source.is_dir():
                        raise LogError(one.reason)
                    about = Kept(str(one.path), problem=one.reason)
                else:
                    about, rows[number], facts = _kept(one), one.rows, one.facts
                encoded = msgspec.msgpack.encode(about), msgspec.msgpack.encode(facts)
                lines.append((number, key, prints[key], self._with_shortest, *encoded))
            logs.execute("BEGIN")
            self.tables.insert(rows)
            logs.executemany("INSERT INTO kept.logs VALUES (?, ?, ?, ?, ?, ?)", lines)
            logs.execute("COMMIT")


def _kept(one: SessionRows) -> Kept:
    account = one.account
    versions = tuple((*whose, count) for whose, count in account.versions.items())
    left_out = tuple((*why, count) for why, count in account.left_out.items())
    wanted = one.rows.count("participants") > 0
    return Kept(
        path=str(one.path),
        study=one.plan.study,
        blocks=len({facts["block"] for facts in one.facts}),
        outline=Outline.of(one.plan) if wanted else None,
        quality=one.quality if wanted else None,
        account=(account.sessions, account.episodes, versions, left_out),
    )


def _digest(*facts: object) -> str:
    return hashlib.sha256(msgspec.msgpack.encode(facts)).hexdigest()


def _no_room(source: Path, error: duckdb.Error) -> StoreError:
    why = str(error).splitlines()[0]
    return StoreError(f"{source}: its tables cannot be made, beside it or in {tempfile.gettempdir()}: {why}")


def _key(path: Path, source: Path) -> str:
    return str(path.relative_to(source)) if source.is_dir() else path.name


def _fingerprint(path: Path) -> str:
    """Of a log, or a session's folder of segments, and of the marks beside it."""
    folder = path if path.is_dir() else path.parent
    marks = marks_path(path)
    return "\n".join(
        f"{entry.name} {facts.st_size} {facts.st_mtime_ns}"
        for entry in sorted(os.scandir(folder), key=lambda entry: entry.name)
        if (path.is_dir() or entry.name in (path.name, marks.name)) and entry.is_file()
        for facts in [entry.stat()]
    )
