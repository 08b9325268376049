"""Files as they were last written, kept beside the store: what would come out the same is copied, not made again.

They are a cache like the store, believed only with the SHA-256 that was noted when they were written: the copy that was
taken is what is compared. So others may write here meanwhile, and at worst nothing is kept.
"""

import hashlib
import os
import shutil
from contextlib import suppress
from pathlib import Path

import msgspec


class _Note(msgspec.Struct, frozen=True):
    """What a kept file was made of, and what was in it."""

    made_of: str
    of: list[str]
    sha256: str


class KeptFiles:
    """The kept files of one study.

    Args:
        folder: where they are; made when there is something to keep.
        made_of: says what the content of all of them follows from; with what ``take`` and ``keep`` are told a file is
            made ``of``, that is all. Files that were made of something else are not taken.
    """

    def __init__(self, folder: Path, made_of: str) -> None:
        self._folder = folder
        self._made_of = made_of

    def take(self, wanted: Path, of: list[str]) -> bool:
        """Copy the kept file of a path's name there; False, and nothing is there, if none is kept or it was changed."""
        kept, note = self._places(wanted.name)
        try:
            said = msgspec.json.decode(note.read_bytes(), type=_Note)
            if (said.made_of, said.of) != (self._made_of, of):
                return False
            shutil.copyfile(kept, wanted)
            if _sha256(wanted) == said.sha256:
                return True
            wanted.unlink()
        except (OSError, msgspec.DecodeError):
            wanted.unlink(missing_ok=True)
        return False

    def keep(self, written: Path, of: list[str]) -> None:
        """Keep a copy of a file that was written; where that cannot be, nothing is kept."""
        kept, note = self._places(written.name)
        unfinished = note.with_name(f"{note.name}.{os.getpid()}.part")
        try:
            self._folder.mkdir(exist_ok=True)
            note.unlink(missing_ok=True)  # first: a file without its note is not believed
            shutil.copyfile(written, kept)
            unfinished.write_bytes(msgspec.json.encode(_Note(self._made_of, of, _sha256(kept))))
            os.replace(unfinished, note)
        except OSError:  # a full disk, most likely: it is not to be filled by half a copy
            for left in (kept, unfinished):
                with suppress(OSError):
                    left.unlink(missing_ok=True)

    def _places(self, name: str) -> tuple[Path, Path]:
        return self._folder / name, self._folder / f"{name}.json"


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
