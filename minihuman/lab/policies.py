"""The policies of a study: every file that ever played in it, kept under its SHA-256 beside the participants."""

import hashlib
import os
from pathlib import Path

from minihuman.errors import LogError

FOLDER = "policies"
SUFFIX = ".pt"


class Policies:
    """The policy files of one study, in its folder; a file that is there is never written again."""

    def __init__(self, study_dir: Path) -> None:
        self.folder = study_dir / FOLDER

    def keep(self, content: bytes) -> str:
        """Keep a policy file; returns its SHA-256, under which it is found.

        Raises:
            OSError: if it cannot be written.
        """
        sha256 = hashlib.sha256(content).hexdigest()
        path = self.path(sha256)
        if not path.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            unfinished = path.with_suffix(f".{os.getpid()}")
            with unfinished.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            unfinished.replace(path)
        return sha256

    def path(self, sha256: str) -> Path:
        """Where the file of that SHA-256 is, or would be."""
        return self.folder / f"{sha256}{SUFFIX}"

    def checked(self, sha256: str) -> Path:
        """Where the file of that SHA-256 is.

        Raises:
            LogError: if it is not there, or is another.
        """
        path = self.path(sha256)
        if not path.is_file():
            raise LogError(f"policy {sha256[:16]} is not in {self.folder}; copy the study's folder as a whole")
        if hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
            raise LogError(f"{path} is not the policy that its name says: it was changed")
        return path
