"""The enrolment log: the lines of a study's register, and who is in the study according to them.

Read only. It imports no world and no NumPy, so that ``minihuman status`` starts fast; what writes is in
``enrolment``.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec

from minihuman.errors import AllocationError
from minihuman.experiment.plan.designs import GroupAssignment
from minihuman.storage.journal import Journal
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME, open_journal


class AuditNote(msgspec.Struct, frozen=True):
    """The reason for something done by hand, and who did it."""

    reason: str = ""
    experimenter: str = ""  # their code


NO_NOTE = AuditNote()


ENROLMENT_FORMAT = 2  # of the lines; goes up when an older reader would misread a newer enrolment log
_MESSAGE_TO_OLDER = "a newer minihuman wrote this: update yours"  # they show a line's first 60 bytes


class FormatDeclared(msgspec.Struct, frozen=True):
    """The first line that this version adds to an enrolment log.

    Readers of format 1 pass over kinds of lines that they do not know, but refuse a ``withdrawn`` that is no text, and
    so the whole file, before they can do anything in the study.
    """

    withdrawn: tuple[str, ...] = (_MESSAGE_TO_OLDER,)
    format: int = ENROLMENT_FORMAT


class SlotTaken(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant took a slot; the entry says of which allocation list."""

    allocation_sha256: str
    list_length: int
    index: int
    participant: str
    group: str  # "" where it is still to be drawn
    overridden: bool  # chosen by hand with --participant or --group
    stratum: str = ""
    slot: int | None = None  # where the group was drawn after an answer: the place in the list
    at: str = ""  # ISO 8601 UTC; "" in lines of earlier versions
    reason: str = ""  # of an override
    experimenter: str = ""
    assigned: GroupAssignment | None = None  # where a design assigned the group
    outcome_rules: int = 0  # of the whole study, by its first line; 0: it began before there were any


class GroupDrawn(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant's group was drawn after an answer; the last such entry counts."""

    drawn: str  # the code
    stratum: str
    slot: int
    group: str
    at: str  # ISO 8601 UTC
    assigned: GroupAssignment | None = None  # where a design assigned the group


class LookTaken(msgspec.Struct, frozen=True):
    """A sequential study was looked at, before a further participant was enrolled."""

    look: int  # 1 for the first
    design: str  # as the protocol names it
    version: int
    statistics: dict[str, Any]  # of the groups; no codes
    estimates: dict[str, float]
    stop: bool
    at: str  # ISO 8601 UTC


class ParticipantWithdrawn(msgspec.Struct, frozen=True, omit_defaults=True):
    """A tombstone: this participant's data count nowhere, and their slot is free again."""

    withdrawn: str  # the code
    at: str  # ISO 8601 UTC
    kept: Literal["erased", "sealed"]  # what became of the data
    reason: str = ""
    experimenter: str = ""


class ParticipantReplaced(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant does not come back: their data count, and their slot is free again."""

    replaced: str  # the code
    at: str  # ISO 8601 UTC
    reason: str = ""
    experimenter: str = ""


class SlotFreed(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant took a slot and left no data: slot and code are as if they had never come."""

    freed: str  # the code, which the next one gets
    at: str  # ISO 8601 UTC
    why: str = ""  # why their session ended: "declined", "screened_out", ...; "" in registers of before


class ChainHeadRecorded(msgspec.Struct, frozen=True):
    """The head of the hash chain with which a segment's log ended."""

    sealed: str  # the log's name
    segment: str
    chain: str


class DayOverridden(msgspec.Struct, frozen=True, omit_defaults=True):
    """A session was run on a day that the protocol does not allow."""

    any_day: str  # the participant's code
    session: int
    at: str  # ISO 8601 UTC
    reason: str = ""
    experimenter: str = ""


class LogRecovered(msgspec.Struct, frozen=True, omit_defaults=True):
    """A cut-off log was finished, a damaged one rewritten, or a log's missing chain heads were added."""

    recovered: str  # the log's name
    at: str  # ISO 8601 UTC
    what: str
    reason: str = ""
    experimenter: str = ""


class TeamRecorded(msgspec.Struct, frozen=True, omit_defaults=True):
    """The seats of a team: the only place that maps a team's id to codes."""

    team: str  # its random id, as in the members' logs
    index: int  # of the team in the study
    block: str
    session: int
    members: dict[str, str]  # seat -> code
    seats: tuple[str, ...]  # by seat: "person", or the agent as the protocol names it
    at: str  # ISO 8601 UTC
    solo: bool = False  # one person with agents: the index is the participant's


EnrolmentEntry = (
    FormatDeclared
    | SlotTaken
    | GroupDrawn
    | ParticipantWithdrawn
    | ParticipantReplaced
    | SlotFreed
    | ChainHeadRecorded
    | DayOverridden
    | LogRecovered
    | TeamRecorded
    | LookTaken
)


def read_enrolled(study_dir: Path) -> tuple[SlotTaken, ...]:
    """Read who is in the study, in order of taking their slots, without those who withdrew."""
    lines = read_enrolment_log(study_dir)
    gone = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    return tuple(line for line in list_taken_slots(lines) if line.participant not in gone)


def read_enrolment_log(study_dir: Path) -> tuple[EnrolmentEntry, ...]:
    """Read all entries of the enrolment log, in order of writing; none if the study has not begun.

    Raises:
        AllocationError: if a whole line cannot be read.
    """
    return tuple(open_enrolment_log(study_dir).read())


def list_team_entries(study_dir: Path) -> tuple[TeamRecorded, ...]:
    """List the study's teams in the order of forming, each block's once, without members who withdrew."""
    lines = read_enrolment_log(study_dir)
    gone = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    return tuple(
        msgspec.structs.replace(line, members={seat: code for seat, code in line.members.items() if code not in gone})
        for line in lines
        if isinstance(line, TeamRecorded)
    )


def open_enrolment_log(study_dir: Path) -> Journal[EnrolmentEntry]:
    """Open a study's enrolment log."""
    return open_journal(study_dir, ENROLMENT_FILE_NAME, _decode_entry, chained=True, declaration=_DECLARATION)


def read_chain_heads(study_dir: Path, log: str) -> dict[str, str]:
    """Read the chain heads with which a log's segments ended, by the enrolment log; the latest of each segment."""
    lines = read_enrolment_log(study_dir)
    return {line.segment: line.chain for line in lines if isinstance(line, ChainHeadRecorded) and line.sealed == log}


def find_incomplete_logs(
    lines: Sequence[EnrolmentEntry], logs: Mapping[str, Collection[str]]
) -> Iterator[tuple[str, bool]]:
    """Name each log that is gone, and each segment whose end the enrolment log does not hold; with whether it is fine.

    What an earlier version did not write down is fine. Who withdrew has no log.

    Args:
        lines: of the enrolment log.
        logs: the finished segments of each finished log, by its name.
    """
    gone = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    known = {(line.sealed, line.segment) for line in lines if isinstance(line, ChainHeadRecorded)}
    for name in dict.fromkeys(line.sealed for line in lines if isinstance(line, ChainHeadRecorded)):
        if name not in logs and name.partition("_")[0] not in gone:
            yield f"{name} is gone: the enrolment log holds the head of its chain", False
    earlier = {line.participant for line in lines if isinstance(line, SlotTaken) and not line.at}
    for name, segments in logs.items():
        for segment in segments:
            if (name, segment) not in known:
                lacks = f"the enrolment log does not say how segment {segment} of {name} ended"
                yield f"{lacks}; add it with `minihuman recover LOG`", name.partition("_")[0] in earlier


def find_slots_without_log(
    lines: Sequence[EnrolmentEntry], participants: Collection[str]
) -> Iterator[tuple[str, bool]]:
    """Name each participant who holds a slot and has no log; with whether it is fine, as in earlier versions' studies.

    Args:
        lines: of the enrolment log.
        participants: the codes of those who have a log, finished or not.
    """
    known = {*participants, *list_replaced(lines)}
    known |= {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    known |= {line.sealed.partition("_")[0] for line in lines if isinstance(line, ChainHeadRecorded)}  # a log gone
    for slot in list_taken_slots(lines):
        if slot.participant not in known:
            code = slot.participant
            yield (
                f"{code} has a slot and no log; if no session of theirs is running: minihuman replace {code}",
                (not slot.at),
            )


def list_taken_slots(lines: Sequence[EnrolmentEntry]) -> tuple[SlotTaken, ...]:
    """List the slots that were taken and not freed, in order, each as the last draw left it."""
    slots: dict[str, SlotTaken] = {}
    for line in lines:
        match line:
            case SlotTaken():
                slots[line.participant] = line
            case GroupDrawn() if (before := slots.get(line.drawn)) is not None:
                slots[line.drawn] = msgspec.structs.replace(
                    before, group=line.group, stratum=line.stratum, slot=line.slot, assigned=line.assigned
                )
            case SlotFreed():
                slots.pop(line.freed, None)
    return tuple(slots.values())


def count_interventions(lines: Sequence[EnrolmentEntry]) -> dict[str, int]:
    """Count what was done by hand, by kind, and how much of it has no reason; nothing that never occurred."""
    kinds = {
        ParticipantWithdrawn: "withdrawn",
        ParticipantReplaced: "replaced",
        LogRecovered: "logs recovered",
        DayOverridden: "run on another day",
        SlotTaken: "chosen by hand",
    }
    by_hand = [line for line in lines if isinstance(line, tuple(kinds)) and getattr(line, "overridden", True)]
    counts = Counter(kinds[type(line)] for line in by_hand)
    counts["without a reason"] = sum(not getattr(line, "reason", "") for line in by_hand)
    return {kind: counts[kind] for kind in (*kinds.values(), "without a reason") if counts[kind]}


def list_replaced(lines: Sequence[EnrolmentEntry]) -> tuple[str, ...]:
    """List the participants who do not come back, in the order of replacing them; none whose slot was freed."""
    replaced: dict[str, None] = {}
    for line in lines:
        match line:
            case ParticipantReplaced():
                replaced.setdefault(line.replaced)
            case SlotFreed():
                replaced.pop(line.freed, None)
    return tuple(replaced)


def _decode_entry(line: bytes, number: int) -> EnrolmentEntry | None:
    """Decode a line; those of kinds that other programs add are passed over.

    Raises:
        AllocationError: if a whole line cannot be read, or a newer version wrote it.
    """
    if not line:
        return None
    try:
        fields = msgspec.json.decode(line, type=dict[str, Any])
        kind = next((kind for field, kind in _ENTRY_TYPES.items() if field in fields), None)
        if kind is None:
            return None
        entry = msgspec.convert(fields, kind)
    except (msgspec.DecodeError, UnicodeDecodeError):
        raise AllocationError(
            f"{ENROLMENT_FILE_NAME}:{number}: {line[:60]!r} cannot be read; restore the file from a copy"
        ) from None
    if isinstance(entry, FormatDeclared) and entry.format > ENROLMENT_FORMAT:
        raise AllocationError(
            f"{ENROLMENT_FILE_NAME}:{number}: a newer minihuman wrote this entry (format {entry.format}; this version "
            f"reads up to {ENROLMENT_FORMAT}); upgrade minihuman to read it"
        )
    return entry


_DECLARATION = FormatDeclared()
_ENTRY_TYPES: dict[str, type[EnrolmentEntry]] = {
    "format": FormatDeclared,  # before its other field
    "participant": SlotTaken,
    "drawn": GroupDrawn,
    "withdrawn": ParticipantWithdrawn,
    "replaced": ParticipantReplaced,
    "freed": SlotFreed,
    "sealed": ChainHeadRecorded,
    "any_day": DayOverridden,
    "recovered": LogRecovered,
    "team": TeamRecorded,
    "look": LookTaken,
}
