"""The register: which slots of the allocation list are taken. Append-only, fsynced, one line a slot.

Two stations that share the data folder never get the same slot: a slot is taken under an exclusive lock of the file.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import msgspec

from minihuman.errors import AllocationError
from minihuman.study.allocation import allocation, allocation_sha256
from minihuman.study.expand import enrol, participant_index
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


def read_register(study_dir: Path) -> tuple[Taken, ...]:
    """The slots taken so far, in order of taking; none if the study has not begun."""
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
        _check_list(lines, study_dir, protocol)
        if participant is None:
            index = _next_free(lines, protocol)
        else:
            index = participant_index(participant)
            for line in lines:
                if line.index == index:
                    return _again(line, group)
        who = enrol(protocol, index, group)
        taken = Taken(
            allocation_sha256(slots), len(slots), index, who.id, who.group, participant is not None or group is not None
        )
        _append(file, taken)
    return who, taken


def _again(line: Taken, group: str | None) -> tuple[Participant, Taken]:
    if group is not None and group != line.group:
        raise AllocationError(f"{line.participant} is in group {line.group!r}, not {group!r}; leave --group out")
    return Participant(line.participant, line.index, line.group), line


def _next_free(lines: tuple[Taken, ...], protocol: Protocol) -> int:
    used = {line.index for line in lines}
    count = protocol.study.participants
    for index in range(count):
        if index not in used:
            return index
    raise AllocationError(
        f"all {count} slots of study {protocol.study.name!r} are taken; raise $.study.participants in the protocol"
    )


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
    with path.open("a+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        yield file


def _append(file: BinaryIO, taken: Taken) -> None:
    file.seek(0, os.SEEK_END)
    if file.tell():
        file.seek(-1, os.SEEK_END)
        if file.read(1) != b"\n":  # a crash cut the last line off: it was never acknowledged
            file.write(b"\n")
    file.write(msgspec.json.encode(taken) + b"\n")
    file.flush()
    os.fsync(file.fileno())


def _lines(data: bytes, path: Path) -> tuple[Taken, ...]:
    """Every whole line; a cut-off one was never acknowledged and is passed over.

    Raises:
        AllocationError: if a whole line cannot be read.
    """
    lines = []
    for number, line in enumerate(data.split(b"\n"), 1):
        try:
            if line:
                lines.append(msgspec.json.decode(line, type=Taken))
        except msgspec.DecodeError:
            if not line.endswith(b"}"):
                continue
            raise AllocationError(f"{path}:{number}: cannot be read: {line[:60]!r}; restore the file") from None
    return tuple(lines)
