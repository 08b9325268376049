"""Which versions of the messages are read here, and how: one reader a version, none of them ever taken away.

A version's number goes up when an older reader would misread a newer log. A field or topic that is only added is a
minor change ("1.2"): readers of that version pass over what they do not know.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.decode import decode
from minihuman.log.topics import SCHEMA_VERSION
from minihuman.study.events import Event

Decode = Callable[[str, bytes], Event | None]

READERS: dict[int, Decode] = {1: decode}
assert max(READERS) == SCHEMA_VERSION, "every version that is written can be read"


def reader_for(facts: Mapping[str, str], path: Path) -> Decode:
    """How the messages of a segment are read, by what is said at its start.

    Raises:
        LogError: if no version is said, or one that is newer than this software.
    """
    said = facts.get("schema_version", "none")
    number, _, minor = said.partition(".")
    if not number.isdigit() or number == "0" or (minor and not minor.isdigit()):
        raise LogError(f"{path} has log schema version {said}, which no minihuman has written; is it a session log?")
    reader = READERS.get(int(number))
    if reader is None:
        raise LogError(
            f"{path} was written by a newer minihuman ({facts.get('minihuman', 'unknown')}, log schema version {said}; "
            f"this one reads up to {max(READERS)}): bring minihuman up to date to read it"
        )
    return reader
