"""The history of a protocol file: every version that the builder replaced or wrote, in a folder beside the file.

The history survives the program and the browser. It is no second truth: a version that another program wrote is added
when the builder next writes the file, and deleting the folder loses nothing but undo.
"""

from pathlib import Path

from minihuman.storage.durable_files import replace_durably
from minihuman.storage.system import current_system

HISTORY_FOLDER = ".minihuman-history"  # with a folder for each file
LONGEST = 500  # versions of a file
_SUFFIX = ".version"  # no protocol, so that no list of studies shows it


class FileHistory:
    """The versions of one file, and the position of the file's present content among them.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        self._folder = path.parent / HISTORY_FOLDER / f"{path.name}.history"
        self._position: int | None = None  # index of the version that this process wrote last

    def record(self, old: bytes, new: bytes) -> None:
        """Add a version behind the present one, and delete the versions that had been undone.

        Args:
            old: the present content of the file, which is added too if another program has written it.
            new: the content that the file is about to get.

        Raises:
            OSError: if the history cannot be written.
        """
        position = self._find_or_add(old)
        versions = self._truncate(self._list(), position + 1)
        versions.append(self._write(versions, new))
        if len(versions) > LONGEST:
            current_system().disk.unlink(versions.pop(0))
        self._position = len(versions) - 1

    def can_step(self, content: bytes, by: int) -> bool:
        """Return whether there is a version before (``by`` is -1) or after (+1) the file's present content.

        If the content is not in the history, as another program wrote it, it counts as following the versions.
        """
        versions = self._list()
        position = self._locate(versions, content)
        if position is None:  # another program has changed the file since
            return by < 0 and bool(versions)
        return 0 <= position + by < len(versions)

    def peek(self, content: bytes, by: int) -> bytes:
        """Return the version before (``by`` is -1) or after (+1) the file's present content, and change nothing.

        Raises:
            IndexError: if there is none.
            OSError: if the history cannot be read.
        """
        if not self.can_step(content, by):
            raise IndexError("there is no such version")
        versions = self._list()
        position = self._locate(versions, content)
        if position is None:
            position = len(versions) if self._position is None else self._position + 1
        return versions[position + by].read_bytes()

    def step(self, content: bytes, by: int) -> bytes:
        """Return the version before (``by`` is -1) or after (+1) the file's present content, as the file's new content.

        ``can_step`` must have returned True for it.

        Raises:
            OSError: if the history cannot be read or written.
        """
        self._position = self._find_or_add(content) + by  # added, so that what another program wrote is not lost
        return self._list()[self._position].read_bytes()

    def _find_or_add(self, content: bytes) -> int:
        """Return the index of the version with a content, after adding it if another program has written it."""
        versions = self._list()
        position = self._locate(versions, content)
        if position is not None:
            return position
        if self._position is not None:
            versions = self._truncate(versions, self._position + 1)
        versions.append(self._write(versions, content))
        return len(versions) - 1

    def _truncate(self, versions: list[Path], length: int) -> list[Path]:
        """Delete all but the first ``length`` versions; return those."""
        for version in versions[length:]:
            current_system().disk.unlink(version)
        return versions[:length]

    def _locate(self, versions: list[Path], content: bytes) -> int | None:
        """Return the index of a version that has a content, or None if there is none.

        Of several such versions, the one that this process wrote last is chosen, else the latest.
        """
        candidates = list(reversed(range(len(versions))))
        if self._position is not None and self._position < len(versions):
            candidates.insert(0, self._position)
        return next((index for index in candidates if versions[index].read_bytes() == content), None)

    def _list(self) -> list[Path]:
        """Return the files of all versions, the oldest first."""
        if not self._folder.is_dir():
            return []
        return sorted(path for path in self._folder.iterdir() if path.suffix == _SUFFIX)

    def _write(self, versions: list[Path], content: bytes) -> Path:
        """Write a version with the number after that of the last of ``versions``; return its file."""
        number = int(versions[-1].stem) + 1 if versions else 1
        path = self._folder / f"{number:08}{_SUFFIX}"
        with replace_durably(path) as file:
            file.write(content)
        return path
