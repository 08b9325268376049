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

_MAX_LISTED = 8  # participants that an error lists


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
        AllocationError: if every slot is taken, the code is not valid, the participant withdrew or is in another group,
            the study has stopped or began with another allocation list, or another study's name differs only in case.
    """
    slots = build_allocation_list(protocol)
    _require_own_folder(study_dir)
    make_private_folder(study_dir)
    journal = open_enrolment_log(study_dir)
    with journal.hold() as register:
        holders = _SlotHolders.of(journal, register.lines)
        _require_same_list(next(reversed(holders.slots.values()), None), study_dir, protocol)
        if participant is not None and (earlier_slot := holders.find_slot_entry(participant)) is not None:
            return _resume_enrolment(earlier_slot, group)
        if participant is None:
            index = holders.find_next_free_index(protocol)
        else:
            index = holders.find_free_index(participant)
        if look := take_look(protocol, register.lines, study_dir, now_text()):
            register.append(look)
            require_not_stopped([look])
        code = participant or holders.find_new_code(index, prefix)
        enrolled = _enrol(protocol, register.lines, study_dir, index, code, group)
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
            assigned=enrolled.assigned,
            outcome_rules=_find_outcome_rules(register.lines),
        )
        register.append(slot)
    return enrolled, slot


def _enrol(
    protocol: Protocol, lines: Sequence[EnrolmentEntry], study_dir: Path, index: int, code: str, group: str | None
) -> Participant:
    """Return a new participant with a group: the given one, the design's or the allocation list's.

    If groups are drawn after an answer, the participant has no group yet unless one is given.

    Args:
        protocol: the study's protocol.
        lines: the lines of the enrolment log so far.
        study_dir: the study's folder.
        index: the participant's index in the allocation list.
        code: the participant's code.
        group: a group that was chosen by hand.
    """
    chosen = group
    assigned = None
    if group is None and not protocol.allocation.stratify_by:
        chosen, assigned = assign_group(protocol, lines, study_dir, index, "")
    enrolled = enrol_participant(protocol, index, chosen or None)
    if enrolled.slot is not None:  # the group is drawn after an answer
        return Participant(code, index, group or "")
    return msgspec.structs.replace(enrolled, id=code, assigned=assigned)


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
    """Require that ``count`` participants can be enrolled, before any of them takes a slot.

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
    """Draw the group of a participant from the first free slot of their stratum, and record it durably.

    If a killed program makes a second draw for the same stratum necessary, it returns the same slot.

    Args:
        protocol: the study's protocol.
        study_dir: the study's folder.
        code: the participant's code.
        stratum: the stratum, which the participant's answer determines.

    Returns:
        The participant with the drawn slot and its group, or with a group that was chosen by hand.

    Raises:
        AllocationError: if the participant has no slot in the study, or the stratum has no slot left.
    """
    journal = open_enrolment_log(study_dir)
    with journal.hold() as register:
        holders = _SlotHolders.of(journal, register.lines)
        line = holders.find_slot_entry(code)
        if line is None:
            raise AllocationError(
                f"{code} has no slot in {study_dir}, so no group can be allocated; check the participant's code"
            )
        if line.stratum == stratum and line.slot is not None:
            return _resume_enrolment(line, None)[0]
        chosen = holders.began[code].group  # the group that was chosen by hand; "" if none was
        slot = holders.find_next_slot_in_stratum(protocol, stratum)
        assigned = None
        if not chosen:
            chosen, assigned = assign_group(protocol, register.lines, study_dir, line.index, stratum)
        drawn_participant = assign_slot(protocol, Participant(code, line.index, chosen, assigned=assigned), slot)
        register.append(GroupDrawn(code, stratum, slot.index, drawn_participant.group, now_text(), assigned))
    return drawn_participant


def record_chain_heads(study_dir: Path, heads: Sequence[ChainHeadRecorded], *, only_missing: bool = False) -> int:
    """Record the chain heads of a log's segments that are not recorded yet; return how many lines were added.

    A differing head is added for the last segment only, because for an earlier one it is evidence of a change.

    Args:
        study_dir: the study's folder.
        heads: the chain heads of one log, in order.
        only_missing: whether to add no differing head for the last segment either.

    Raises:
        OSError: if the enrolment log cannot be written.
    """
    with open_enrolment_log(study_dir).hold() as register:
        recorded = [line for line in register.lines if isinstance(line, ChainHeadRecorded)]
        recorded_segments = {(line.sealed, line.segment) for line in recorded}
        added = [head for head in heads if (head.sealed, head.segment) not in recorded_segments]
        if heads and not only_missing:
            last = heads[-1]
            if last not in recorded and last not in added:
                added.append(last)
        if added:
            register.append(*added)
    return len(added)


def record_intervention(study_dir: Path, entry: DayOverridden | LogRecovered) -> None:
    """Add an entry to a study's enrolment log, which is its audit trail, too; do nothing if the study has none.

    Raises:
        OSError: if the enrolment log cannot be written.
    """
    journal = open_enrolment_log(study_dir)
    if journal.begun:
        with journal.hold() as register:
            register.append(entry)


def record_team(study_dir: Path, entry: TeamRecorded) -> None:
    """Record the seats of a team in a block of a session, unless they are recorded already.

    Raises:
        OSError: if the enrolment log cannot be written.
    """
    make_private_folder(study_dir)
    with open_enrolment_log(study_dir).hold() as register:
        teams = [line for line in register.lines if isinstance(line, TeamRecorded)]
        if not any((line.team, line.block, line.session) == (entry.team, entry.block, entry.session) for line in teams):
            register.append(entry)


def record_departure(study_dir: Path, departure: ParticipantWithdrawn | ParticipantReplaced) -> None:
    """Record durably that a participant left the study; a repeated replacement is written once.

    Raises:
        AllocationError: if there is no such participant, or they withdrew before.
    """
    if isinstance(departure, ParticipantWithdrawn):
        code = departure.withdrawn
    else:
        code = departure.replaced
    journal = open_enrolment_log(study_dir)
    if not journal.begun:
        raise AllocationError(
            f"{study_dir} is not a study folder: it has no {ENROLMENT_FILE_NAME}; name a study folder with --study"
        )
    with journal.hold() as register:
        holders = _SlotHolders.of(journal, register.lines)
        if holders.find_slot_entry(code) is None:
            gone = {line.withdrawn for line in register.lines if isinstance(line, ParticipantWithdrawn)}
            participants = [participant for participant in holders.slots if participant not in gone]
            names = ", ".join(participants[:_MAX_LISTED]) or "none yet"
            raise AllocationError(f"{code!r} has no slot in {study_dir}; participants with a slot: {names}")
        is_repeated = isinstance(departure, ParticipantReplaced) and code in holders.replaced
        if not is_repeated:
            register.append(departure)


def free_slot(study_dir: Path, code: str, why: str) -> None:
    """Free the slot and the code of a participant without data for the next participant.

    Nothing is written if the participant holds no slot, as in a repeated call.

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
        if _SlotHolders.of(journal, register.lines).find_slot_entry(code) is not None:
            register.append(SlotFreed(code, now_text(), why))


class _SlotHolders:
    """The participants who hold slots according to the entries of the enrolment log."""

    def __init__(self) -> None:
        self.slots: dict[str, SlotTaken] = {}  # as `list_taken_slots` lists them, by participant
        self.replaced: set[str] = set()
        self.began: dict[str, SlotTaken] = {}  # the line with which each participant enrolled, before any draw
        self._withdrawn: set[str] = set()
        self.slots_by_index: dict[int, SlotTaken] = {}
        self._held_draws: set[int | None] = set()  # the list indices of drawn slots that are held
        self._first_free = 0  # all slots below this index are held
        self._first_free_draws: dict[str, int] = {}  # by stratum: all drawn slots of lower list indices are held

    @classmethod
    def of(cls, journal: Journal[EnrolmentEntry], lines: Sequence[EnrolmentEntry]) -> "_SlotHolders":
        """Return the slot holders according to ``lines``, which are all lines of the journal."""
        return _holders_of(journal).after(lines)

    def add(self, line: EnrolmentEntry) -> None:
        """Update the slot holders with a line of the enrolment log."""
        match line:
            case SlotTaken():
                self.began[line.participant] = line
                self._assign_slot(line)
            case GroupDrawn() if (before := self.slots.get(line.drawn)) is not None:
                if self.slots_by_index.get(before.index) is before:
                    self._held_draws.discard(before.slot)
                    self._first_free_draws.clear()
                allocation = {
                    "group": line.group,
                    "stratum": line.stratum,
                    "slot": line.slot,
                    "assigned": line.assigned,
                }
                self._assign_slot(msgspec.structs.replace(before, **allocation))
            case SlotFreed():
                self._release_slot(line.freed)
                self.slots.pop(line.freed, None)
                self.replaced.discard(line.freed)
            case ParticipantWithdrawn():
                self._release_slot(line.withdrawn)
                self._withdrawn.add(line.withdrawn)
            case ParticipantReplaced():
                self._release_slot(line.replaced)
                self.replaced.add(line.replaced)

    def _assign_slot(self, line: SlotTaken) -> None:
        """Record a participant's slot; it stays free if the participant withdrew or was replaced."""
        self.slots[line.participant] = line
        if line.participant not in self._withdrawn and line.participant not in self.replaced:
            self.slots_by_index[line.index] = line
            self._held_draws.add(line.slot)

    def _release_slot(self, code: str) -> None:
        """Free the slot that a participant holds, if they hold one."""
        line = self.slots.get(code)
        if line is not None and self.slots_by_index.get(line.index) is line:
            del self.slots_by_index[line.index]
            self._held_draws.discard(line.slot)
            self._first_free = min(self._first_free, line.index)
            self._first_free_draws.clear()

    def find_slot_entry(self, code: str) -> SlotTaken | None:
        """Return the entry of the slot that a participant took; None if they took none.

        Raises:
            AllocationError: if they withdrew.
        """
        if code in self._withdrawn:
            raise AllocationError("this participant has withdrawn; remove --participant to offer the slot again")
        return self.slots.get(code)

    def find_new_code(self, index: int, prefix: str) -> str:
        """Return the first code that can be formed for a slot and that no participant has or had.

        A code that was freed counts as unused.

        Args:
            index: the index of the slot, from which the code's number follows.
            prefix: the prefix of the code, such as "sub".
        """
        codes = (format_participant_code(index, n_earlier, prefix=prefix) for n_earlier in count())
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

    def find_next_free_index(self, protocol: Protocol) -> int:
        """Return the index of the first free slot.

        Raises:
            AllocationError: if all slots are taken.
        """
        self._first_free = next(index for index in count(self._first_free) if index not in self.slots_by_index)
        if self._first_free < protocol.study.participants:
            return self._first_free
        raise AllocationError(
            f"all {protocol.study.participants} slots of study {protocol.study.name!r} are taken; raise "
            "$.study.participants in the protocol"
        )

    def find_next_slot_in_stratum(self, protocol: Protocol, stratum: str) -> AllocationSlot:
        """Return the first slot of a stratum's part of the allocation list that no participant holds.

        Raises:
            AllocationError: if all slots of the stratum are taken.
        """
        for index in range(self._first_free_draws.get(stratum, 0), protocol.study.participants):
            slot = find_slot(protocol, index, stratum)
            if slot.index not in self._held_draws:
                self._first_free_draws[stratum] = index
                return slot
        raise AllocationError(
            f"all slots of stratum {stratum!r} of study {protocol.study.name!r} are taken; raise "
            "$.study.participants in the protocol"
        )


@cache
def _holders_of(journal: Journal[EnrolmentEntry]) -> JournalState[EnrolmentEntry, _SlotHolders]:
    """Return the state in which a journal's slot holders are kept in memory, so that each line is processed once."""
    return JournalState(_SlotHolders, _SlotHolders.add)


def _resume_enrolment(slot: SlotTaken, group: str | None) -> tuple[Participant, SlotTaken]:
    """Return the participant who took a slot earlier, and that slot, after checking the group that was asked for.

    Args:
        slot: the participant's slot.
        group: the group that was asked for; None for any.

    Raises:
        AllocationError: if ``group`` is given and is not the participant's group.
    """
    if group is not None and not slot.group:
        raise AllocationError(f"the group of {slot.participant} is not allocated yet; remove --group")
    if group is not None and group != slot.group:
        raise AllocationError(f"{slot.participant} is in group {slot.group!r}, not {group!r}; remove --group")
    return Participant(slot.participant, slot.index, slot.group, slot.stratum, slot.slot, slot.assigned), slot


def _find_outcome_rules(lines: Sequence[EnrolmentEntry]) -> int:
    """Return the version of the outcome rules under which a study began, which an upgrade does not change."""
    first = next((line for line in lines if isinstance(line, SlotTaken)), None)
    if first is None:
        return OUTCOME_RULES
    return first.outcome_rules


def _require_same_list(slot: SlotTaken | None, study_dir: Path, protocol: Protocol) -> None:
    """Require that the protocol's allocation list begins with the list from which an earlier slot was taken.

    Args:
        slot: the slot to compare with, which names its list by digest and length; None if no slot was taken.
        study_dir: the study's folder, for the error.
        protocol: the study's protocol.

    Raises:
        AllocationError: if the study began with another list.
    """
    if slot is None:
        return
    study = msgspec.structs.replace(protocol.study, participants=slot.list_length)
    digest = allocation_sha256(build_allocation_list(msgspec.structs.replace(protocol, study=study)))
    if digest != slot.allocation_sha256:
        raise AllocationError(
            f"{study_dir}: the study began with allocation list {slot.allocation_sha256[:12]}, but this protocol "
            f"makes {digest[:12]}; restore its seed, groups, keys and actions, rename "
            f"{protocol.study.name!r}, or use another data folder"
        )
