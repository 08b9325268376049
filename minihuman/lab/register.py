"""The register: who took which slot of the allocation list, and who left it. Append-only, fsynced, one line each.

Two stations that share the data folder never get the same slot: a slot is taken under an exclusive lock of the file.
Lines of other kinds, which other programs may add, are passed over.
"""

from datetime import UTC, datetime
from itertools import count
from pathlib import Path

import msgspec

from minihuman.data.journals import REGISTER
from minihuman.errors import AllocationError
from minihuman.lab.register_lines import (
    Drawn,
    Freed,
    Line,
    Replaced,
    Sealed,
    Taken,
    Withdrawn,
    register_of,
    replaced_by_others,
    slots_taken,
)
from minihuman.study.allocation import Slot, allocation, allocation_sha256, slot_of
from minihuman.study.expand import enrol, participant_code, participant_index, placed
from minihuman.study.plan import Participant
from minihuman.study.protocol import Protocol


def take_slot(
    protocol: Protocol, study_dir: Path, *, participant: str | None = None, group: str | None = None
) -> tuple[Participant, Taken]:
    """Take the next free slot, or the one of a participant named by hand, and make it last.

    A participant who has a slot keeps it: asked for again, the line already written is the answer. Where groups are
    drawn after an answer they have no group until ``draw_slot``, unless one was chosen by hand.

    Raises:
        AllocationError: if every slot is taken, the code is no code, the participant's group is another,
            or the study began with another allocation list.
    """
    slots = allocation(protocol)
    study_dir.mkdir(parents=True, exist_ok=True)
    with register_of(study_dir).hold() as register:
        holders = _Holders(register.lines)
        _check_list(holders.taken, study_dir, protocol)
        if participant is not None and (line := holders.line_of(participant)) is not None:
            return _again(line, group)
        index = holders.next_free(protocol) if participant is None else holders.free(participant)
        who = msgspec.structs.replace(enrol(protocol, index, group), id=participant or holders.next_code(index))
        if who.slot is not None:
            who = Participant(who.id, who.index, group or "")
        by_hand = participant is not None or group is not None
        taken = Taken(allocation_sha256(slots), protocol.study.participants, index, who.id, who.group, by_hand)
        register.append(taken)
    return who, taken


def require_free_slots(protocol: Protocol, study_dir: Path, count: int) -> None:
    """Refuse more participants than there is room for, before any of them has a slot.

    Raises:
        AllocationError: if fewer slots are free, or the register cannot be read.
    """
    free = len(_Holders(register_of(study_dir).read()).free_slots(protocol))
    if count > free:
        raise AllocationError(
            f"{count} participants are more than the {free} free slots of study {protocol.study.name!r}; ask for "
            f"fewer, or raise $.study.participants in the protocol, which is {protocol.study.participants}"
        )


def draw_slot(protocol: Protocol, study_dir: Path, code: str, stratum: str) -> Participant:
    """Draw the group of somebody who has answered: the first slot of their stratum that nobody holds; make it last.

    Drawn again for the same stratum, since a program was killed in between, it is the same slot.

    Raises:
        AllocationError: if they have no place in the study, or the stratum has no slot left.
    """
    with register_of(study_dir).hold() as register:
        holders = _Holders(register.lines)
        line = holders.line_of(code)
        if line is None:
            raise AllocationError(f"{code} has no place in {study_dir}, so there is no group to draw")
        if (line.stratum, line.slot is None) == (stratum, False):
            return _again(line, None)[0]
        by_hand = holders.chosen_group(code)
        slot = holders.next_of(protocol, stratum)
        who = placed(protocol, Participant(code, line.index, by_hand), slot)
        register.append(Drawn(code, stratum, slot.index, who.group, _now()))
    return who


def note_seal(study_dir: Path, sealed: Sealed) -> None:
    """Write down how a log ended, unless that is there already.

    Raises:
        OSError: if the register cannot be written.
    """
    with register_of(study_dir).hold() as register:
        if sealed not in register.lines:
            register.append(sealed)


def leave(study_dir: Path, parting: Withdrawn | Replaced) -> None:
    """Write that somebody left the study, and make it last; said twice it is written once.

    Raises:
        AllocationError: if there is no such participant, or they withdrew before.
    """
    code = parting.withdrawn if isinstance(parting, Withdrawn) else parting.replaced
    journal = register_of(study_dir)
    if not journal.begun:
        raise AllocationError(f"{study_dir} is no study's folder: it has no {REGISTER}; name one with --study")
    with journal.hold() as register:
        holders = _Holders(register.lines)
        if holders.line_of(code) is None:
            gone = {line.withdrawn for line in register.lines if isinstance(line, Withdrawn)}
            here = [line.participant for line in holders.taken if line.participant not in gone]
            known = ", ".join(here[:8]) or "nobody yet"
            raise AllocationError(f"{code!r} has no slot in {study_dir}; there are {known}")
        if not isinstance(parting, Replaced) or code not in holders.replaced:
            register.append(parting)


def free(study_dir: Path, code: str, why: str) -> None:
    """Free the slot of somebody of whom there are no data, for the next one, code and all; written once.

    Args:
        study_dir: the study's folder.
        code: theirs.
        why: why their session ended, which is all that is kept of it.

    Raises:
        AllocationError: if there are data of them, who then withdraw or are replaced, or the register cannot be read.
    """
    if (study_dir / code).exists():
        raise AllocationError(f"{code} has data in {study_dir}; withdraw or replace them instead")
    with register_of(study_dir).hold() as register:
        if _Holders(register.lines).line_of(code) is not None:
            register.append(Freed(code, _now(), why))


class _Holders:
    """Who holds which slot, from the register's lines."""

    def __init__(self, lines: tuple[Line, ...]) -> None:
        self.taken = slots_taken(lines)
        self._began = {line.participant: line for line in lines if isinstance(line, Taken)}
        self._withdrawn = {line.withdrawn for line in lines if isinstance(line, Withdrawn)}
        self.replaced = set(replaced_by_others(lines))
        self._held = {
            line.index: line for line in self.taken if line.participant not in self._withdrawn | self.replaced
        }

    def line_of(self, code: str) -> Taken | None:
        """The slot that a participant took.

        Raises:
            AllocationError: if they withdrew.
        """
        if code in self._withdrawn:
            raise AllocationError("this participant has withdrawn; leave --participant out to offer the slot again")
        return next((line for line in self.taken if line.participant == code), None)

    def chosen_group(self, code: str) -> str:
        """The group that was chosen by hand for somebody whose draw is still to come; "" where none was."""
        return self._began[code].group

    def free(self, code: str) -> int:
        """The slot of a code that has none yet.

        Raises:
            AllocationError: if it is no code, or somebody else has that slot.
        """
        index = participant_index(code)
        if index in self._held:
            raise AllocationError(f"{code} and {self._held[index].participant} are the same slot; choose another code")
        return index

    def free_slots(self, protocol: Protocol) -> list[int]:
        """The slots that nobody holds, in order."""
        return [index for index in range(protocol.study.participants) if index not in self._held]

    def next_free(self, protocol: Protocol) -> int:
        """The first slot that nobody holds.

        Raises:
            AllocationError: if all are held.
        """
        if free := self.free_slots(protocol):
            return free[0]
        raise AllocationError(
            f"all {protocol.study.participants} slots of study {protocol.study.name!r} are taken; raise "
            "$.study.participants in the protocol"
        )

    def next_of(self, protocol: Protocol, stratum: str) -> Slot:
        """The first slot of a stratum that nobody holds.

        Raises:
            AllocationError: if all are held.
        """
        held = {line.slot for line in self._held.values()}
        slots = (slot_of(protocol, place, stratum) for place in range(protocol.study.participants))
        free = next((slot for slot in slots if slot.index not in held), None)
        if free is None:
            raise AllocationError(f"every slot of the stratum {stratum!r} of study {protocol.study.name!r} is taken")
        return free

    def next_code(self, index: int) -> str:
        """The code of the next participant in a slot: never one that was somebody's."""
        known = {line.participant for line in self.taken}
        codes = (participant_code(index, before) for before in count())
        return next(code for code in codes if code not in known)


def _again(line: Taken, group: str | None) -> tuple[Participant, Taken]:
    if group is not None and not line.group:
        raise AllocationError(f"{line.participant} has a place whose group is still to be drawn; leave --group out")
    if group is not None and group != line.group:
        raise AllocationError(f"{line.participant} is in group {line.group!r}, not {group!r}; leave --group out")
    return Participant(line.participant, line.index, line.group, line.stratum, line.slot), line


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


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
