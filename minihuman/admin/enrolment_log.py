"""Enrol participants: take, draw and free allocation slots in a study's enrolment log.

The log is append-only and fsynced, with one line per entry. Two stations that share the data folder never get the same
slot, because a slot is taken under an exclusive lock on the file. Lines of kinds that other programs add are ignored.
"""

import os
from collections.abc import Sequence
from functools import cache
from itertools import count
from pathlib import Path

import msgspec

from minihuman.admin.design_decisions import assign_group, require_not_stopped, take_look
from minihuman.admin.enrolment_entries import (
    NO_NOTE,
    AuditNote,
    ChainHeadRecorded,
    DayOverridden,
    EnrolmentEntry,
    GroupDrawn,
    LogRecovered,
    ParticipantReplaced,
    ParticipantWithdrawn,
    SlotFreed,
    SlotTaken,
    TeamRecorded,
    open_enrolment_log,
)
from minihuman.errors import AllocationError
from minihuman.experiment.plan.allocation import AllocationSlot, allocation_sha256, build_allocation_list, find_slot
from minihuman.experiment.plan.expansion import assign_slot, enrol_participant
from minihuman.experiment.plan.participant_codes import format_participant_code, parse_participant_code
from minihuman.experiment.plan.session_plan import Participant
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.operating_system import make_private_folder
from minihuman.portable_names import find_case_twin
from minihuman.storage.journal import Journal, JournalState
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from minihuman.storage.system import now_text
from minihuman.worlds.outcomes import OUTCOME_RULES


def take_slot(
    protocol: Protocol,
    study_dir: Path,
    *,
    participant: str | None = None,
    group: str | None = None,
    note: AuditNote = NO_NOTE,
    prefix: str = "sub",
) -> tuple[Participant, SlotTaken]:
    """Take the next free slot, or the slot of a participant named by hand, and record it durably.

    A participant who has a slot keeps it: a second call returns the line already written. If groups are drawn after an
    answer, the participant has no group until ``draw_slot``, unless one was chosen by hand.

    Args:
        protocol: the study's protocol.
        study_dir: the study's folder.
        participant: a participant code; None takes the next free slot.
        group: a group that overrides the allocation list's.
        note: the reason why a code or a group is chosen by hand, and the experimenter who chooses.
        prefix: the prefix of a new code.

    Raises:
        AllocationError: if every slot is taken, the code is not valid, the participant is in another group, the study
            began with another allocation list, or another study's name differs only in case.
    """
    slots = build_allocation_list(protocol)
    _require_own_folder(study_dir)
    make_private_folder(study_dir)
    journal = open_enrolment_log(study_dir)
    with journal.hold() as register:
        holders = _SlotHolders.of(journal, register.lines)
        _check_list(next(reversed(holders.slots.values()), None), study_dir, protocol)
        if participant is not None and (line := holders.slot_entry_of(participant)) is not None:
            return _taken_before(line, group)
        if participant is None:
            index = holders.next_free(protocol)
        else:
            index = holders.find_free_index(participant)
        if look := take_look(protocol, register.lines, study_dir, now_text()):
            register.append(look)
            require_not_stopped([look])
        chosen = group
        assigned = None
        if group is None and not protocol.allocation.stratify_by:
            chosen, assigned = assign_group(protocol, register.lines, study_dir, index, "")
        enrolled = msgspec.structs.replace(
            enrol_participant(protocol, index, chosen or None),
            id=participant or holders.find_new_code(index, prefix),
            assigned=assigned,
        )
        if enrolled.slot is not None:
            enrolled = Participant(enrolled.id, enrolled.index, group or "")
        is_overridden = participant is not None or group is not None
        if not is_overridden:
            note = NO_NOTE
        slot = SlotTaken(
            allocation_sha256(slots),
            protocol.study.participants,
            index,
            enrolled.id,
            enrolled.group,
            is_overridden,
            at=now_text(),
            reason=note.reason,
            experimenter=note.experimenter,
            assigned=assigned,
            outcome_rules=_find_outcome_rules(register.lines),
        )
        register.append(slot)
    return enrolled, slot


def _require_own_folder(study_dir: Path) -> None:
    """Require that no other study's folder has the same name on file systems that ignore case.

    Raises:
        AllocationError: if one has.
    """
    if not study_dir.parent.is_dir():
        return
    twin = find_case_twin(study_dir.name, os.listdir(study_dir.parent))
    if twin:
        raise AllocationError(
            f"study {study_dir.name!r} would share its folder with {twin!r} on Windows and macOS; rename the study, "
            "or choose another folder with --data"
        )


def require_free_slots(protocol: Protocol, study_dir: Path, count: int) -> None:
    """Require that a number of participants can be enrolled, before any of them takes a slot.

    Raises:
        AllocationError: if fewer slots are free, or the enrolment log cannot be read.
    """
    journal = open_enrolment_log(study_dir)
    holders = _SlotHolders.of(journal, journal.read())
    n_free = sum(index not in holders.slots_by_index for index in range(protocol.study.participants))
    if count > n_free:
        raise AllocationError(
            f"study {protocol.study.name!r} has too few free slots ({n_free}) for {count} participants; ask for fewer, "
            f"or raise $.study.participants in the protocol, which is {protocol.study.participants}"
        )


def draw_slot(protocol: Protocol, study_dir: Path, code: str, stratum: str) -> Participant:
    """Draw the group of a participant who has answered from the first free slot of their stratum; record it durably.

    If a killed program makes a second draw for the same stratum necessary, it returns the same slot.

    Raises:
        AllocationError: if the participant has no slot in the study, or the stratum has no slot left.
    """
    journal = open_enrolment_log(study_dir)
    with journal.hold() as register:
        holders = _SlotHolders.of(journal, register.lines)
        line = holders.slot_entry_of(code)
        if line is None:
            raise AllocationError(
                f"{code} has no slot in {study_dir}, so no group can be allocated; check the participant's code"
            )
        if line.stratum == stratum and line.slot is not None:
            return _taken_before(line, None)[0]
        chosen = holders.began[code].group  # the group that was chosen by hand; "" if none was
        slot = holders.next_in_stratum(protocol, stratum)
        assigned = None
        if not chosen:
            chosen, assigned = assign_group(protocol, register.lines, study_dir, line.index, stratum)
        drawn_participant = assign_slot(protocol, Participant(code, line.index, chosen, assigned=assigned), slot)
        register.append(GroupDrawn(code, stratum, slot.index, drawn_participant.group, now_text(), assigned))
    return drawn_participant


def record_chain_heads(study_dir: Path, heads: Sequence[ChainHeadRecorded], *, only_missing: bool = False) -> int:
    """Record the chain heads of a log's segments that are not recorded yet; return how many lines were added.

    For all segments but the last, only a missing head is added, because a head that differs is evidence.

    Args:
        study_dir: the study's folder.
        heads: the chain heads of one log, in order.
        only_missing: whether to treat the last segment like the others.

    Raises:
        OSError: if the enrolment log cannot be written.
    """
    with open_enrolment_log(study_dir).hold() as register:
        recorded = [line for line in register.lines if isinstance(line, ChainHeadRecorded)]
        known = {(line.sealed, line.segment) for line in recorded}
        added = [head for head in heads if (head.sealed, head.segment) not in known]
        if heads and not only_missing:
            last = heads[-1]
            if last not in recorded and last not in added:
                added.append(last)
        if added:
            register.append(*added)
    return len(added)


def record_intervention(study_dir: Path, entry: DayOverridden | LogRecovered) -> None:
    """Add an entry to the audit trail of a study that has an enrolment log.

    Raises:
        OSError: if the enrolment log cannot be written.
    """
    journal = open_enrolment_log(study_dir)
    if journal.begun:
        with journal.hold() as register:
            register.append(entry)


def record_team(study_dir: Path, entry: TeamRecorded) -> None:
    """Record the seats of a team, unless they are recorded already.

    Raises:
        OSError: if the enrolment log cannot be written.
    """
    make_private_folder(study_dir)
    with open_enrolment_log(study_dir).hold() as register:
        known = [line for line in register.lines if isinstance(line, TeamRecorded)]
        if not any((line.team, line.block, line.session) == (entry.team, entry.block, entry.session) for line in known):
            register.append(entry)


def record_departure(study_dir: Path, parting: ParticipantWithdrawn | ParticipantReplaced) -> None:
    """Record durably that a participant left the study; a repeated departure is written once.

    Raises:
        AllocationError: if there is no such participant, or they withdrew before.
    """
    if isinstance(parting, ParticipantWithdrawn):
        code = parting.withdrawn
    else:
        code = parting.replaced
    journal = open_enrolment_log(study_dir)
    if not journal.begun:
        raise AllocationError(
            f"{study_dir} is not a study folder: it has no {ENROLMENT_FILE_NAME}; name a study folder with --study"
        )
    with journal.hold() as register:
        holders = _SlotHolders.of(journal, register.lines)
        if holders.slot_entry_of(code) is None:
            gone = {line.withdrawn for line in register.lines if isinstance(line, ParticipantWithdrawn)}
            participants = [participant for participant in holders.slots if participant not in gone]
            known = ", ".join(participants[:8]) or "none yet"
            raise AllocationError(f"{code!r} has no slot in {study_dir}; participants with a slot: {known}")
        if not isinstance(parting, ParticipantReplaced) or code not in holders.replaced:
            register.append(parting)


def free_slot(study_dir: Path, code: str, why: str) -> None:
    """Free the slot and the code of a participant without data for the next participant.

    A repeated call writes nothing.

    Args:
        study_dir: the study's folder.
        code: the participant's code.
        why: the reason why their session ended, the only fact about it that is kept.

    Raises:
        AllocationError: if the participant has data, and so must withdraw or be replaced, or the enrolment log cannot
            be read.
    """
    if (study_dir / code).exists():
        raise AllocationError(f"{code} has data in {study_dir}; use `minihuman withdraw` or `replace` instead")
    journal = open_enrolment_log(study_dir)
    with journal.hold() as register:
        if _SlotHolders.of(journal, register.lines).slot_entry_of(code) is not None:
            register.append(SlotFreed(code, now_text(), why))


class _SlotHolders:
    """The participants who hold slots according to the entries of the enrolment log."""

    def __init__(self) -> None:
        self.slots: dict[str, SlotTaken] = {}  # as `list_taken_slots` lists them, by participant
        self.replaced: set[str] = set()
        self.began: dict[str, SlotTaken] = {}  # the line with which each participant enrolled, before any draw
        self._withdrawn: set[str] = set()
        self.slots_by_index: dict[int, SlotTaken] = {}
        self._held_places: set[int | None] = set()  # the list indices of drawn slots that are held
        self._next = 0  # all slots below this index are held
        self._next_in_stratum: dict[str, int] = {}

    @classmethod
    def of(cls, journal: Journal[EnrolmentEntry], lines: Sequence[EnrolmentEntry]) -> "_SlotHolders":
        """Return the slot holders after all of a journal's lines."""
        return _holders_of(journal).after(lines)

    def take(self, line: EnrolmentEntry) -> None:
        """Update the slot holders with a line of the enrolment log."""
        match line:
            case SlotTaken():
                self.began[line.participant] = line
                self._assign_slot(line)
            case GroupDrawn() if (before := self.slots.get(line.drawn)) is not None:
                if self.slots_by_index.get(before.index) is before:
                    self._held_places.discard(before.slot)
                    self._next_in_stratum.clear()
                allocation = {
                    "group": line.group,
                    "stratum": line.stratum,
                    "slot": line.slot,
                    "assigned": line.assigned,
                }
                self._assign_slot(msgspec.structs.replace(before, **allocation))
            case SlotFreed():
                self._let_go(line.freed)
                self.slots.pop(line.freed, None)
                self.replaced.discard(line.freed)
            case ParticipantWithdrawn():
                self._let_go(line.withdrawn)
                self._withdrawn.add(line.withdrawn)
            case ParticipantReplaced():
                self._let_go(line.replaced)
                self.replaced.add(line.replaced)

    def _assign_slot(self, line: SlotTaken) -> None:
        """Record a participant's slot; it stays free if the participant withdrew or was replaced."""
        self.slots[line.participant] = line
        if line.participant not in self._withdrawn and line.participant not in self.replaced:
            self.slots_by_index[line.index] = line
            self._held_places.add(line.slot)

    def _let_go(self, code: str) -> None:
        """Free the slot that a participant holds, if they hold one."""
        line = self.slots.get(code)
        if line is not None and self.slots_by_index.get(line.index) is line:
            del self.slots_by_index[line.index]
            self._held_places.discard(line.slot)
            self._next = min(self._next, line.index)
            self._next_in_stratum.clear()

    def slot_entry_of(self, code: str) -> SlotTaken | None:
        """Return the entry of the slot that a participant took; None if they took none.

        Raises:
            AllocationError: if they withdrew.
        """
        if code in self._withdrawn:
            raise AllocationError("this participant has withdrawn; remove --participant to offer the slot again")
        return self.slots.get(code)

    def find_new_code(self, index: int, prefix: str) -> str:
        """Return the first code of a slot that no participant has ever had."""
        codes = (format_participant_code(index, earlier, prefix=prefix) for earlier in count())
        return next(code for code in codes if code not in self.slots)

    def find_free_index(self, code: str) -> int:
        """Return the slot index of a code that has no slot yet, after checking that the slot is free.

        Raises:
            AllocationError: if the code is not valid, or another participant has that slot.
        """
        index = parse_participant_code(code)
        if index in self.slots_by_index:
            raise AllocationError(
                f"{code} would take the same slot as {self.slots_by_index[index].participant}; choose another code"
            )
        return index

    def next_free(self, protocol: Protocol) -> int:
        """Return the index of the first free slot.

        Raises:
            AllocationError: if all slots are taken.
        """
        self._next = next(index for index in count(self._next) if index not in self.slots_by_index)
        if self._next < protocol.study.participants:
            return self._next
        raise AllocationError(
            f"all {protocol.study.participants} slots of study {protocol.study.name!r} are taken; raise "
            "$.study.participants in the protocol"
        )

    def next_in_stratum(self, protocol: Protocol, stratum: str) -> AllocationSlot:
        """Return the first free slot of a stratum.

        Raises:
            AllocationError: if all slots of the stratum are taken.
        """
        for place in range(self._next_in_stratum.get(stratum, 0), protocol.study.participants):
            slot = find_slot(protocol, place, stratum)
            if slot.index not in self._held_places:
                self._next_in_stratum[stratum] = place
                return slot
        raise AllocationError(
            f"all slots of stratum {stratum!r} of study {protocol.study.name!r} are taken; raise "
            "$.study.participants in the protocol"
        )


@cache
def _holders_of(journal: Journal[EnrolmentEntry]) -> JournalState[EnrolmentEntry, _SlotHolders]:
    return JournalState(_SlotHolders, _SlotHolders.take)


def _taken_before(line: SlotTaken, group: str | None) -> tuple[Participant, SlotTaken]:
    """Return an enrolled participant with the line of their slot.

    Raises:
        AllocationError: if ``group`` is given and is not the participant's group.
    """
    if group is not None and not line.group:
        raise AllocationError(f"the group of {line.participant} is not allocated yet; remove --group")
    if group is not None and group != line.group:
        raise AllocationError(f"{line.participant} is in group {line.group!r}, not {group!r}; remove --group")
    return Participant(line.participant, line.index, line.group, line.stratum, line.slot, line.assigned), line


def _find_outcome_rules(lines: Sequence[EnrolmentEntry]) -> int:
    """Return the version of the outcome rules under which a study began, which an upgrade does not change."""
    first = next((line for line in lines if isinstance(line, SlotTaken)), None)
    if first is None:
        return OUTCOME_RULES
    return first.outcome_rules


def _check_list(first_slot: SlotTaken | None, study_dir: Path, protocol: Protocol) -> None:
    """Require that the protocol's allocation list begins with the list of the study's first slot.

    Raises:
        AllocationError: if the study began with another list.
    """
    if first_slot is None:
        return
    study = msgspec.structs.replace(protocol.study, participants=first_slot.list_length)
    digest = allocation_sha256(build_allocation_list(msgspec.structs.replace(protocol, study=study)))
    if digest != first_slot.allocation_sha256:
        raise AllocationError(
            f"{study_dir}: the study began with allocation list {first_slot.allocation_sha256[:12]}, but this protocol "
            f"makes {digest[:12]}; restore its seed, groups, keys and actions, rename "
            f"{protocol.study.name!r}, or use another data folder"
        )
