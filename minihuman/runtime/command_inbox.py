"""The command inbox of a running session: the experimenter's requests, one JSON line each in a file beside the log.

The file is all that connects the two: the sender may die at any time, and the session does not depend on it.
"""

import os
from pathlib import Path
from typing import Literal

import msgspec

from minihuman.log.paths import LOG_SUFFIX
from minihuman.operating_system import sync_file

CommandKind = Literal["pause", "go_on", "abort", "note"]


class CommandRequest(msgspec.Struct, frozen=True):
    """One thing asked for."""

    what: CommandKind
    text: str = ""  # the note, or why
    at: str = ""  # ISO 8601 UTC


def inbox_path(log: Path) -> Path:
    """Name the file of requests to a log's session: ``sub-07_ses-01.asked.jsonl``."""
    return log.with_name(log.name.removesuffix(LOG_SUFFIX) + ".asked.jsonl")


def send_command(log: Path, request: CommandRequest) -> None:
    """Send a request to a log's session, which looks several times per second."""
    with inbox_path(log).open("ab") as file:
        file.write(msgspec.json.encode(request) + b"\n")
        file.flush()
        sync_file(file.fileno())


class CommandInbox:
    """The session's side: returns the requests made from now on.

    Args:
        path: the file of requests; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = self._size()  # requests to an earlier segment are done

    def read_new(self) -> list[CommandRequest]:
        """Return new requests. Unreadable lines are skipped, and half a line waits for the rest."""
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
                requests.append(msgspec.json.decode(line, type=CommandRequest))
            except msgspec.DecodeError:
                continue
        return requests

    def _size(self) -> int:
        try:
            return os.stat(self._path).st_size
        except OSError:
            return 0
