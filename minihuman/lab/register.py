"""The register: who took which slot of the allocation list, and who left it. Append-only, fsynced, one line each.

Two stations that share the data folder never get the same slot: a slot is taken under an exclusive lock of the file.
Lines of other kinds, which other programs may add, are passed over.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Literal

import msgspec

from minihuman.errors import AllocationError, naming
from minihuman.log.record.claim import lock
from minihuman.study.allocation import allocation, allocation_sha256
from minihuman.study.expand import enrol, participant_code, participant_index
from minihuman.study.plan import Participant
from minihuman.study.protocol import Protocol

FILE_NAME = "register.jsonl"


class Taken(msgspec.Struct, frozen=True):
    """One line of the register: a slot, and the allocation list it was taken from."""

    allocation_sha256: str
    list_length: int
    index: int
    participant: str
    group: str
    overridden: bool  # chosen by hand with --participant or --group


class Withdrawn(msgspec.Struct, frozen=True):
    """A tombstone: this participant's data count nowhere, and their slot is free again."""

    withdrawn: str  # the code
    at: str  # ISO 8601 UTC
    kept: Literal["erased", "sealed"]  # what became of the data


class Replaced(msgspec.Struct, frozen=True):
    """Somebody does not come back: what they did counts, and their slot is free again."""

    replaced: str  # the code
    at: str  # ISO 8601 UTC


class Sealed(msgspec.Struct, frozen=True):
    """How a segment's log ended: the head of its hash chain."""

    sealed: str  # the log's name
    segment: str
    chain: str


Line = Taken | Withdrawn | Replaced | Sealed


def read_register(study_dir: Path) -> tuple[Taken, ...]:
    """Who is in the study, in order of taking their slots; those who withdrew are not."""
    lines = read_lines(study_dir)
    gone = {line.withdrawn for line in lines if isinstance(line, Withdrawn)}
    return tuple(line for line in lines if isinstance(line, Taken) and line.participant not in gone)


def read_lines(study_dir: Path) -> tuple[Line, ...]:
    """All that the register says, in order of writing; nothing if the study has not begun."""
    path = study_dir / FILE_NAME
    return _lines(path.read_bytes(), path) if path.exists() else ()


def take_slot(
    protocol: Protocol, study_dir: Path, *, participant: str | None = None, group: str | None = None
) -> tuple[Participant, Taken]:
    """Take the next free slot, or the one of a participant named by hand, and make it last.

    A participant who has a slot keeps it: asked for again, the line already written is the answer.

    Raises:
        AllocationError: if every slot is taken, the code is no code, the participant's group is another,
            or the study began with another allocation list.
    """
    slots = allocation(protocol)
    study_dir.mkdir(parents=True, exist_ok=True)
    with _locked(study_dir / FILE_NAME) as file:
        lines = _lines(file.read(), study_dir / FILE_NAME)
        holders = _Holders(lines)
        _check_list(holders.taken, study_dir, protocol)
        if participant is not None and (line := holders.line_of(participant)) is not None:
            return _again(line, group)
        index = holders.next_free(protocol) if participant is None else holders.free(participant)
        who = msgspec.structs.replace(enrol(protocol, index, group), id=participant or holders.next_code(index))
        by_hand = participant is not None or group is not None
        taken = Taken(allocation_sha256(slots), len(slots), index, who.id, who.group, by_hand)
        _append(file, taken)
    return who, taken


def note_seal(study_dir: Path, sealed: Sealed) -> None:
    """Write down how a log ended, unless that is there already.

    Raises:
        OSError: if the register cannot be written.
    """
    with _locked(study_dir / FILE_NAME) as file:
        if sealed not in _lines(file.read(), study_dir / FILE_NAME):
            _append(file, sealed)


def sealed_heads(study_dir: Path, log: str) -> dict[str, str]:
    """By what the register says a log's segments ended with: the head of the chain, the latest of each segment."""
    lines = read_lines(study_dir)
    return {line.segment: line.chain for line in lines if isinstance(line, Sealed) and line.sealed == log}


def leave(study_dir: Path, parting: Withdrawn | Replaced) -> None:
    """Write that somebody left the study, and make it last; said twice it is written once.

    Raises:
        AllocationError: if there is no such participant, or they withdrew before.
    """
    code = parting.withdrawn if isinstance(parting, Withdrawn) else parting.replaced
    path = study_dir / FILE_NAME
    if not path.exists():
        raise AllocationError(f"{study_dir} is no study's folder: it has no {FILE_NAME}; name one with --study")
    with _locked(path) as file:
        lines = _lines(file.read(), path)
        holders = _Holders(lines)
        if holders.line_of(code) is None:
            known = ", ".join(line.participant for line in read_register(study_dir)[:8]) or "nobody yet"
            raise AllocationError(f"{code!r} has no slot in {study_dir}; there are {known}")
        if not any(type(line) is type(parting) and code in (holders.left_by(line)) for line in lines):
            _append(file, parting)


class _Holders:
    """Who holds which slot, from the register's lines."""

    def __init__(self, lines: tuple[Line, ...]) -> None:
        self.taken = tuple(line for line in lines if isinstance(line, Taken))
        self._withdrawn = {line.withdrawn for line in lines if isinstance(line, Withdrawn)}
        self._replaced = {line.replaced for line in lines if isinstance(line, Replaced)}
        self._held = {
            line.index: line for line in self.taken if line.participant not in self._withdrawn | self._replaced
        }

    @staticmethod
    def left_by(line: Line) -> tuple[str, ...]:
        """Whose parting a line is."""
        match line:
            case Withdrawn():
                return (line.withdrawn,)
            case Replaced():
                return (line.replaced,)
        return ()

    def line_of(self, code: str) -> Taken | None:
        """The slot that a participant took.

        Raises:
            AllocationError: if they withdrew.
        """
        if code in self._withdrawn:
            raise AllocationError("this participant has withdrawn; leave --participant out to offer the slot again")
        return next((line for line in self.taken if line.participant == code), None)

    def free(self, code: str) -> int:
        """The slot of a code that has none yet.

        Raises:
            AllocationError: if it is no code, or somebody else has that slot.
        """
        index = participant_index(code)
        if index in self._held:
            raise AllocationError(f"{code} and {self._held[index].participant} are the same slot; choose another code")
        return index

    def next_free(self, protocol: Protocol) -> int:
        """The first slot that nobody holds.

        Raises:
            AllocationError: if all are held.
        """
        count = protocol.study.participants
        for index in range(count):
            if index not in self._held:
                return index
        raise AllocationError(
            f"all {count} slots of study {protocol.study.name!r} are taken; raise $.study.participants in the protocol"
        )

    def next_code(self, index: int) -> str:
        """The code of the next participant in a slot: never one that was somebody's."""
        return participant_code(index, sum(line.index == index for line in self.taken))


def _again(line: Taken, group: str | None) -> tuple[Participant, Taken]:
    if group is not None and group != line.group:
        raise AllocationError(f"{line.participant} is in group {line.group!r}, not {group!r}; leave --group out")
    return Participant(line.participant, line.index, line.group), line


def _check_list(lines: tuple[Taken, ...], study_dir: Path, protocol: Protocol) -> None:
    """A study may make its list longer, which keeps the slots it had, but not draw another."""
    if not lines:
        return
    begun = lines[-1]
    study = msgspec.structs.replace(protocol.study, participants=begun.list_length)
    digest = allocation_sha256(allocation(msgspec.structs.replace(protocol, study=study)))
    if digest != begun.allocation_sha256:
        raise AllocationError(
            f"{study_dir}: the study began with allocation list {begun.allocation_sha256[:12]}, this protocol makes "
            f"{digest[:12]}; its seed, groups, keys or actions changed: restore them or rename {protocol.study.name!r}"
        )


@contextmanager
def _locked(path: Path) -> Iterator[BinaryIO]:
    with naming(path), path.open("a+b") as file:
        lock(file.fileno(), path)
        file.seek(0)
        yield file


def _append(file: BinaryIO, line: Line) -> None:
    file.seek(0, os.SEEK_END)
    if file.tell():
        file.seek(-1, os.SEEK_END)
        if file.read(1) != b"\n":  # a crash cut the last line off: it was never acknowledged
            file.write(b"\n")
    file.write(msgspec.json.encode(line) + b"\n")
    file.flush()
    os.fsync(file.fileno())


def _lines(data: bytes, path: Path) -> tuple[Line, ...]:
    """Every whole line of ours; a cut-off one was never acknowledged and is passed over.

    Raises:
        AllocationError: if a whole line cannot be read.
    """
    lines: list[Line] = []
    for number, line in enumerate(data.split(b"\n"), 1):
        try:
            found = msgspec.json.decode(line, type=dict[str, Any]) if line else {}
            kind = next((kind for field, kind in _KINDS.items() if field in found), None)
            if kind is not None:
                lines.append(msgspec.convert(found, kind))
        except msgspec.DecodeError:
            if not line.endswith(b"}"):
                continue
            raise AllocationError(f"{path}:{number}: cannot be read: {line[:60]!r}; restore the file") from None
    return tuple(lines)


_KINDS: dict[str, type[Line]] = {"participant": Taken, "withdrawn": Withdrawn, "replaced": Replaced, "sealed": Sealed}
