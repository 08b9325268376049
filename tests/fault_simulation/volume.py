"""A disk that fails, and loses what was not made durable: real files in a folder, and what a power cut leaves."""

import errno
import fcntl
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from minihuman.storage.system import FileSystem
from tests.fault_simulation.schedule import MachineClock, ProcessKilled, Schedule

_SECTOR_BYTES = 512
_OS = FileSystem()


@dataclass(eq=False)
class _Content:
    """What a file holds when the power goes."""

    durable: bytearray = field(default_factory=bytearray)
    pending: list[tuple[int, bytes] | int] = field(default_factory=list)  # bytes and where, or the size it was cut to

    def settle(self, *, lost: bool = False) -> None:
        """Make it durable; ``lost``: its size, not its data, as after an fsync that failed."""
        for change in self.pending:
            _apply(self.durable, change, blank=lost)
        self.pending = []

    def as_programs_see_it(self) -> bytes:
        seen = bytearray(self.durable)
        for change in self.pending:
            _apply(seen, change)
        return bytes(seen)

    def after_a_cut(self, schedule: Schedule) -> bytes:
        left = bytearray(self.durable)
        if self.pending:
            kept = schedule.rng.randint(0, len(self.pending))
            for change in self.pending[:kept]:
                _apply(left, change)
            if kept < len(self.pending) and isinstance(torn := self.pending[kept], tuple):
                at, data = torn
                part = data[: schedule.rng.randint(0, len(data))]
                _apply(left, (at, part), blank=schedule.chance(0.2))  # the size is there, the data are not
        return bytes(left)


def _apply(content: bytearray, change: tuple[int, bytes] | int, *, blank: bool = False) -> None:
    """Change it; ``blank``: what is new in it is zeros."""
    if isinstance(change, int):
        del content[change:]
        return
    at, data = change
    content.extend(bytes(max(0, at + len(data) - len(content))))
    if not blank:
        content[at : at + len(data)] = data


class Volume:
    """What is on the disk of a machine.

    Args:
        root: a folder of its own.
        schedule: the time.
        clock: gives files their times.
    """

    def __init__(self, root: Path, schedule: Schedule, clock: MachineClock) -> None:
        self.root, self.schedule, self.clock = root, schedule, clock
        self.live: dict[Path, _Content] = {}  # as programs see it
        self._entries: dict[Path, _Content] = {}  # durable names
        self._changes: dict[Path, list[tuple[Path | None, Path | None, _Content]]] = {}  # names gone and new, by folder
        self._folders = {root}  # durable ones

    def changed(self, gone: Path | None, new: Path | None, content: _Content) -> None:
        """A name was taken out of its folder, put into it, or both."""
        self._changes.setdefault((new or gone).parent, []).append((gone, new, content))  # type: ignore[union-attr]

    def sync_folder(self, folder: Path) -> None:
        """Make its names durable."""
        for change in self._changes.pop(folder, []):
            self._rename(*change)
        self._folders |= {path for path in folder.iterdir() if path.is_dir()}

    def _rename(self, gone: Path | None, new: Path | None, content: _Content) -> None:
        if gone is not None:
            self._entries.pop(gone, None)
            if gone in self._folders:  # with all that had been in it
                self._folders = {folder for folder in self._folders if not folder.is_relative_to(gone)}
                self._entries = {path: kept for path, kept in self._entries.items() if not path.is_relative_to(gone)}
        if new is not None:
            self._entries[new] = content

    def power_cut(self) -> None:
        """Lose what was not made durable."""
        for folder in sorted(self._changes):
            changes = self._changes[folder]
            for change in changes[: self.schedule.rng.randint(0, len(changes))]:
                self._rename(*change)
        left = {path: content.after_a_cut(self.schedule) for path, content in sorted(self._entries.items())}
        for path in sorted(self.root.iterdir()):
            if path.is_dir():
                shutil.rmtree(path)
            elif path in self.live:
                path.unlink()
        self.live, self._entries, self._changes = {}, {}, {}
        for path, data in left.items():
            if all(folder in self._folders for folder in path.parents if folder.is_relative_to(self.root)):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
                wall_ns = self.clock.wall_ns()
                os.utime(path, ns=(wall_ns, wall_ns))
                self.live[path] = self._entries[path] = _Content(bytearray(data))

    def adopt(self) -> None:
        """Take what is there, and was written past this disk, as durable."""
        for path in [path for path in self.live if not path.exists()]:
            self._entries.pop(path, None)
            del self.live[path]
        for path in self.root.rglob("*"):
            if path.is_dir():
                self._folders.add(path)
            elif path not in self.live or self.live[path].as_programs_see_it() != path.read_bytes():
                self.live[path] = self._entries[path] = _Content(bytearray(path.read_bytes()))


class ProcessDisk(FileSystem):
    """A volume as one process has it, until it is killed.

    Args:
        volume: the disk.
        ops_left: it is killed at this operation; None: never.
    """

    def __init__(self, volume: Volume, *, ops_left: int | None = None) -> None:
        self.volume, self.ops_left = volume, ops_left
        self.commits_left: int | None = None  # it is killed at this commit of a database's
        self.dead = False
        self.on_kill: Callable[[], None] = lambda: None
        self.full = self.failing = self.unsynced = False  # no room, no device, no fsync
        self.short = 0.0  # probability
        self._open: dict[int, tuple[Path, tuple[int, int]]] = {}  # descriptor -> path and which file it is

    def path_of(self, fd: int) -> Path:
        """What a descriptor is open on."""
        return self._open[fd][0]

    def kill(self) -> None:
        """Let go of every file, as the end of a process does."""
        self.dead = True
        for fd, (_, which) in self._open.items():
            try:
                found = os.fstat(fd)
            except OSError:
                continue
            if (found.st_dev, found.st_ino) == which:
                os.close(fd)
        self._open = {}

    def open(self, path: Path, flags: int, mode: int = 0o644) -> int:
        """Open it; what is not on this volume is another machine's, and does not fail."""
        if not path.is_relative_to(self.volume.root):
            self._require_alive()
            fd = _OS.open(path, flags, mode)
            self._open.pop(fd, None)
            return fd
        self._operation(f"open {path.name}")
        new = not path.exists()
        if new and flags & os.O_CREAT:
            self._refuse(path)
        fd = _OS.open(path, flags, mode)
        found = os.fstat(fd)
        self._open[fd] = path, (found.st_dev, found.st_ino)
        if path.is_dir():
            return fd
        if new:
            self.volume.live[path] = _Content()
            self.volume.changed(None, path, self.volume.live[path])
        elif flags & os.O_TRUNC:
            self._content(path).pending.append(0)
        return fd

    def write(self, fd: int, data: bytes | memoryview) -> int:
        """Write it, or a part of it."""
        if fd not in self._open:
            self._require_alive()
            return _OS.write(fd, data)
        path = self._open[fd][0]
        dying = self._operation(f"write {path.name} {len(data)}", dies=False)
        self._refuse(path)
        rng = self.volume.schedule.rng
        cut = dying or (len(data) > 1 and self.volume.schedule.chance(self.short))
        appends = fcntl.fcntl(fd, fcntl.F_GETFL) & os.O_APPEND
        at = os.fstat(fd).st_size if appends else os.lseek(fd, 0, os.SEEK_CUR)
        taken = _OS.write(fd, data[: rng.randint(0 if dying else 1, len(data))] if cut else data)
        content = self.volume.live.get(path)
        if content is not None:
            content.pending.append((at, bytes(data[:taken])))
        wall_ns = self.volume.clock.wall_ns()
        os.utime(fd, ns=(wall_ns, wall_ns))
        if dying:
            self.die()
        return taken

    def sync(self, fd: int) -> None:
        """Make it durable."""
        if fd not in self._open:
            self._require_alive()
            _OS.sync(fd)
            return
        path = self._open[fd][0]
        self._operation(f"sync {path.name}")
        if path.is_dir():
            self._refuse(path, errno.EIO)
            self.volume.sync_folder(path)
            return
        content = self._content(path)
        if self.failing or self.unsynced:
            content.settle(lost=True)
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
        content.settle()

    def sync_folder(self, folder: Path) -> None:
        """Make its entries durable, as two operations: the process may be killed between them."""
        fd = self.open(folder, os.O_RDONLY)
        try:
            self.sync(fd)
        finally:
            os.close(fd)

    def truncate(self, fd: int, size_bytes: int) -> None:
        """Cut it off."""
        path = self._open[fd][0]
        self._operation(f"truncate {path.name}")
        _OS.truncate(fd, size_bytes)
        self._content(path).pending.append(size_bytes)

    def rename(self, source: Path, target: Path) -> None:
        """Rename it."""
        if not target.is_relative_to(self.volume.root):
            self._require_alive()
            _OS.rename(source, target)
            return
        self._operation(f"rename {source.name} {target.name}")
        self._refuse(source, errno.EIO)
        _OS.rename(source, target)
        content = self.volume.live.pop(source, None)
        if content is None:  # it was written past this disk, and durably
            content = _Content(bytearray(target.read_bytes()))
        self.volume.live[target] = content
        self.volume.changed(source, target, content)

    def unlink(self, path: Path) -> None:
        """Remove it."""
        if not path.is_relative_to(self.volume.root):
            self._require_alive()
            _OS.unlink(path)
            return
        self._operation(f"unlink {path.name}")
        _OS.unlink(path)
        if path in self.volume.live:
            self.volume.changed(path, None, self.volume.live.pop(path))

    def link(self, source: Path, target: Path) -> None:
        """Give it a second name, of which a power cut leaves what it leaves of the first."""
        self._operation(f"link {source.name} {target.name}")
        self._refuse(target)
        _OS.link(source, target)
        self.volume.live[target] = self._content(source)
        self.volume.changed(None, target, self.volume.live[target])

    def make_folder(self, folder: Path, mode: int = 0o700) -> None:
        """Make it; it lasts when the folder above it is synced."""
        if not folder.is_dir():
            self._refuse(folder)
        _OS.make_folder(folder, mode)

    def remove_folder(self, folder: Path) -> None:
        """Remove it; what was in it may come back as long as the folder above it is not synced."""
        if not folder.is_relative_to(self.volume.root):
            self._require_alive()
            _OS.remove_folder(folder)
            return
        self._operation(f"rmdir {folder.name}")
        _OS.remove_folder(folder)
        self.volume.changed(folder, None, _Content())

    def _content(self, path: Path) -> _Content:
        return self.volume.live.setdefault(path, _Content())

    def _require_alive(self) -> None:
        if self.dead:
            raise ProcessKilled

    def _operation(self, what: str, *, dies: bool = True) -> bool:
        """Count it; whether the process dies in it."""
        self._require_alive()
        self.volume.schedule.note(what)
        if self.ops_left is None:
            return False
        self.ops_left -= 1
        if self.ops_left >= 0:
            return False
        if dies:
            self.die()
        return True

    def commit(self, what: str) -> bool:
        """Count a commit of the process in a database; whether it dies once that is done, or before."""
        if self.dead:
            raise ProcessKilled
        if self.commits_left is None or what == "renew":  # there are hundreds
            return False
        self.commits_left -= 1
        if self.commits_left >= 0:
            return False
        if self.volume.schedule.chance(0.5):
            self.die()
        return True

    def die(self) -> None:
        """Be killed."""
        self.dead = True
        raise ProcessKilled

    def _refuse(self, path: Path, code: int = errno.ENOSPC) -> None:
        if self.full and code == errno.ENOSPC:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        if self.failing:
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
