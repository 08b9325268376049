"""What the register's file says: its lines, and who is in the study by them. Takes nothing and writes nothing."""

from pathlib import Path
from typing import Any, Literal

import msgspec

from minihuman.data.journal import Journal
from minihuman.data.journals import REGISTER, journal
from minihuman.errors import AllocationError


class Taken(msgspec.Struct, frozen=True, omit_defaults=True):
    """One line of the register: a place, and the allocation list it was taken from."""

    allocation_sha256: str
    list_length: int
    index: int
    participant: str
    group: str  # "" where it is still to be drawn
    overridden: bool  # chosen by hand with --participant or --group
    stratum: str = ""
    slot: int | None = None  # where the group was drawn after an answer: the place in the list


class Drawn(msgspec.Struct, frozen=True):
    """Somebody's group was drawn after an answer; the last such line counts."""

    drawn: str  # the code
    stratum: str
    slot: int
    group: str
    at: str  # ISO 8601 UTC


class Withdrawn(msgspec.Struct, frozen=True):
    """A tombstone: this participant's data count nowhere, and their slot is free again."""

    withdrawn: str  # the code
    at: str  # ISO 8601 UTC
    kept: Literal["erased", "sealed"]  # what became of the data


class Replaced(msgspec.Struct, frozen=True):
    """Somebody does not come back: what they did counts, and their slot is free again."""

    replaced: str  # the code
    at: str  # ISO 8601 UTC


class Freed(msgspec.Struct, frozen=True, omit_defaults=True):
    """Somebody took a slot and left no data: slot and code are as if they had never come."""

    freed: str  # the code, which the next one gets
    at: str  # ISO 8601 UTC
    why: str = ""  # why their session ended: "declined", "screened_out", ...; "" in registers of before


class Sealed(msgspec.Struct, frozen=True):
    """How a segment's log ended: the head of its hash chain."""

    sealed: str  # the log's name
    segment: str
    chain: str


Line = Taken | Drawn | Withdrawn | Replaced | Freed | Sealed


def read_register(study_dir: Path) -> tuple[Taken, ...]:
    """Who is in the study, in order of taking their slots; those who withdrew are not."""
    lines = read_lines(study_dir)
    gone = {line.withdrawn for line in lines if isinstance(line, Withdrawn)}
    return tuple(line for line in slots_taken(lines) if line.participant not in gone)


def read_lines(study_dir: Path) -> tuple[Line, ...]:
    """All that the register says, in order of writing; nothing if the study has not begun.

    Raises:
        AllocationError: if a whole line cannot be read.
    """
    return register_of(study_dir).read()


def register_of(study_dir: Path) -> Journal[Line]:
    """A study's register."""
    return journal(study_dir, REGISTER, _line)


def sealed_heads(study_dir: Path, log: str) -> dict[str, str]:
    """By what the register says a log's segments ended with: the head of the chain, the latest of each segment."""
    lines = read_lines(study_dir)
    return {line.segment: line.chain for line in lines if isinstance(line, Sealed) and line.sealed == log}


def slots_taken(lines: tuple[Line, ...]) -> tuple[Taken, ...]:
    """The slots that were taken and not freed, in order, each as the last draw left it."""
    taken: dict[str, Taken] = {}
    for line in lines:
        match line:
            case Taken():
                taken[line.participant] = line
            case Drawn() if (before := taken.get(line.drawn)) is not None:
                taken[line.drawn] = msgspec.structs.replace(
                    before, group=line.group, stratum=line.stratum, slot=line.slot
                )
            case Freed():
                taken.pop(line.freed, None)
    return tuple(taken.values())


def replaced_by_others(lines: tuple[Line, ...]) -> tuple[str, ...]:
    """Who does not come back, in the order in which that was said; whose slot was freed since is nobody."""
    replaced: dict[str, None] = {}
    for line in lines:
        match line:
            case Replaced():
                replaced.setdefault(line.replaced)
            case Freed():
                replaced.pop(line.freed, None)
    return tuple(replaced)


def _line(line: bytes, number: int) -> Line | None:
    """A whole line of ours; a cut-off one was never acknowledged and is passed over, as others' are.

    Raises:
        AllocationError: if a whole line cannot be read.
    """
    try:
        found = msgspec.json.decode(line, type=dict[str, Any]) if line else {}
        kind = next((kind for field, kind in _KINDS.items() if field in found), None)
        return None if kind is None else msgspec.convert(found, kind)
    except msgspec.DecodeError:
        if not line.endswith(b"}"):
            return None
        raise AllocationError(f"{REGISTER}:{number}: cannot be read: {line[:60]!r}; restore the file") from None


_KINDS: dict[str, type[Line]] = {
    "participant": Taken,
    "drawn": Drawn,
    "withdrawn": Withdrawn,
    "replaced": Replaced,
    "freed": Freed,
    "sealed": Sealed,
}
