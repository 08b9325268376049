"""The experimenter's desk: what is asked of a running session, one line each in a file beside its log.

The file is all there is between the two: whoever asks may die at any time, and the session need not know.
"""

import os
from pathlib import Path
from typing import Literal

import msgspec

from minihuman.log.paths import LOG_SUFFIX

Wish = Literal["pause", "go_on", "abort", "note"]


class Request(msgspec.Struct, frozen=True):
    """One thing asked for."""

    what: Wish
    text: str = ""  # the note, or why
    at: str = ""  # ISO 8601 UTC


def requests_path(log: Path) -> Path:
    """Where requests to the session of a log are: ``sub-07_ses-01.asked.jsonl``."""
    return log.with_name(log.name.removesuffix(LOG_SUFFIX) + ".asked.jsonl")


def ask(log: Path, request: Request) -> None:
    """Ask something of the session of a log; it looks several times a second."""
    with requests_path(log).open("ab") as file:
        file.write(msgspec.json.encode(request) + b"\n")
        file.flush()
        os.fsync(file.fileno())


class Desk:
    """The session's side: hands over what is asked from now on.

    Args:
        path: the file of requests; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = self._size()  # what was asked of an earlier segment was done then

    def asked(self) -> list[Request]:
        """What is new. Lines that cannot be read are passed over, half a line waits for the rest."""
        if self._size() <= self._read:
            return []
        with self._path.open("rb") as file:
            file.seek(self._read)
            data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        self._read += len(whole)
        requests = []
        for line in whole.splitlines():
            try:
                requests.append(msgspec.json.decode(line, type=Request))
            except msgspec.DecodeError:
                continue
        return requests

    def _size(self) -> int:
        try:
            return os.stat(self._path).st_size
        except OSError:
            return 0
