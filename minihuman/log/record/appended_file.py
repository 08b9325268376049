"""A live file that is appended to, and stays where it is while somebody writes it."""

import fcntl
import logging
import os
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.record.claim import is_at, sync_folder
from minihuman.log.record.live_file import Piece
from minihuman.log.record.space import require_space

LOG = logging.getLogger("minihuman")


class AppendedFile:
    """A live file that its owner has made and locked. One thread writes it, another may make it durable.

    Args:
        fd: its descriptor, which stays its owner's.
        part: where it is.
        sync: makes a file descriptor's writes durable.
        put: writes to a file descriptor, and says how many bytes it took.
        crc: of what it holds already.
    """

    def __init__(
        self,
        fd: int,
        part: Path,
        *,
        sync: Callable[[int], None] = os.fsync,
        put: Callable[[int, memoryview], int] = os.write,
        crc: int = 0,
    ) -> None:
        self.fd = fd
        self.crc = crc  # of all that was written
        self._part = part
        self._sync = sync
        self._put = put
        self._whole = threading.Lock()  # held while it is written, or written again

    def append(self, pieces: Iterable[Piece]) -> None:
        """Hand pieces to the operating system.

        Raises:
            LogError: if there is too little room.
            OSError: if the disk does not take them.
        """
        for piece in _joined(pieces):
            if piece.room_for is not None:
                require_space(self._part.parent, piece.room_for)
            rest = memoryview(piece.data)
            with self._whole:
                while rest:
                    taken = self._put(self.fd, rest)
                    rest = rest[taken:]
                self.crc = zlib.crc32(piece.data, self.crc)

    def sync(self) -> None:
        """Make durable what was written.

        Raises:
            OSError: if it cannot be.
        """
        self._sync(self.fd)

    def stay(self) -> None:
        """Where somebody took the file away or moved it, write it again from the open handle, and make it durable.

        Raises:
            LogError: if it cannot be written again.
        """
        if is_at(self.fd, self._part):
            return
        try:
            with self._whole:
                self._part.parent.mkdir(parents=True, exist_ok=True)
                again = os.open(self._part, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_APPEND | os.O_CLOEXEC, 0o644)
                try:
                    copied = self._copy_to(again)
                    os.dup2(again, self.fd, inheritable=False)
                finally:
                    os.close(again)
        except OSError as error:
            raise LogError(f"{self._part} was taken away and cannot be put back ({error.strerror})") from error
        LOG.warning("%s was taken away while it was being written; it is back, with all %d bytes", self._part, copied)

    def _copy_to(self, again: int) -> int:
        """Copy all that was written, and make it last."""
        fcntl.flock(again, fcntl.LOCK_EX)
        copied = 0
        while found := os.pread(self.fd, 1 << 20, copied):
            copied += os.write(again, found)
        self._sync(again)
        for folder in self._part.parents[:4]:
            sync_folder(folder)
        return copied


def _joined(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """The same bytes in as few writes as can be."""
    held: list[bytes] = []
    for piece in pieces:
        if piece.room_for is not None and held:
            yield Piece(b"".join(held))
            held = []
        if piece.room_for is not None:
            yield piece
        else:
            held.append(piece.data)
    if held:
        yield Piece(b"".join(held))
