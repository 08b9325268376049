"""The enrolment log: the kinds of its lines, and which participants are in the study according to them.

The module only reads. It imports neither worlds nor NumPy, so that ``minihuman status`` starts quickly; the module
``enrolment_log`` writes.
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
    """The reason for a manual intervention, and the experimenter who made it."""

    reason: str = ""
    experimenter: str = ""  # their code


NO_NOTE = AuditNote()


ENROLMENT_FORMAT = 2  # of the lines; increased when an older reader would misread a newer enrolment log
_MESSAGE_TO_OLDER = "a newer minihuman wrote this: update yours"  # older versions show a line's first 60 bytes


class FormatDeclared(msgspec.Struct, frozen=True):
    """The first line that this version adds to an enrolment log: the format of the lines.

    Readers of format 1 ignore unknown kinds of lines. They refuse a ``withdrawn`` that is not text, however, and with
    it the whole file, before they can do anything in the study.
    """

    withdrawn: tuple[str, ...] = (_MESSAGE_TO_OLDER,)
    format: int = ENROLMENT_FORMAT


class SlotTaken(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant took a slot of an allocation list, which the entry identifies by its digest and length."""

    allocation_sha256: str
    list_length: int
    index: int
    participant: str
    group: str  # "" if it has not been drawn yet
    overridden: bool  # chosen by hand with --participant or --group
    stratum: str = ""
    slot: int | None = None  # index in the list, if the group was drawn after an answer
    at: str = ""  # ISO 8601 UTC; "" in lines of earlier versions
    reason: str = ""  # for an override
    experimenter: str = ""
    assigned: GroupAssignment | None = None  # if a design assigned the group
    outcome_rules: int = 0  # of the whole study, from its first line; 0 for studies that predate them


class GroupDrawn(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant's group was drawn after an answer; the last such entry is valid."""

    drawn: str  # the code
    stratum: str
    slot: int
    group: str
    at: str  # ISO 8601 UTC
    assigned: GroupAssignment | None = None  # if a design assigned the group


class LookTaken(msgspec.Struct, frozen=True):
    """An interim look at a sequential study was taken, before a further participant was enrolled."""

    look: int  # 1 for the first
    design: str  # as the protocol names it
    version: int
    statistics: dict[str, Any]  # of the groups; no codes
    estimates: dict[str, float]
    stop: bool
    at: str  # ISO 8601 UTC


class ParticipantWithdrawn(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant withdrew: their data are excluded everywhere, and their slot is free again."""

    withdrawn: str  # the code
    at: str  # ISO 8601 UTC
    kept: Literal["erased", "sealed"]  # whether the data were erased or archived
    reason: str = ""
    experimenter: str = ""


class ParticipantReplaced(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant will not come back: their data remain included, and their slot is free again."""

    replaced: str  # the code
    at: str  # ISO 8601 UTC
    reason: str = ""
    experimenter: str = ""


class SlotFreed(msgspec.Struct, frozen=True, omit_defaults=True):
    """A participant left without data, so that their slot and code are free again."""

    freed: str  # the code, which the next participant gets
    at: str  # ISO 8601 UTC
    why: str = ""  # why their session ended: "declined", "screened_out", ...; "" in logs of earlier versions


class ChainHeadRecorded(msgspec.Struct, frozen=True):
    """The head of the hash chain at the end of a segment's log."""

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
    """A truncated log was finished, a damaged log was rewritten, or a log's missing chain heads were added."""

    recovered: str  # the log's name
    at: str  # ISO 8601 UTC
    what: str
    reason: str = ""
    experimenter: str = ""


class TeamRecorded(msgspec.Struct, frozen=True, omit_defaults=True):
    """The seats of a team; no other record maps a team's id to participant codes."""

    team: str  # its random id, as in the members' logs
    index: int  # of the team in the study
    block: str
    session: int
    members: dict[str, str]  # seat -> code
    seats: tuple[str, ...]  # by seat: "person", or the agent as the protocol names it
    at: str  # ISO 8601 UTC
    solo: bool = False  # whether one person plays with agents; the index is then the participant's


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
    """Read the slots of the participants in the study, in the order taken, without participants who withdrew.

    Raises:
        AllocationError: if a complete line of the enrolment log cannot be read.
    """
    lines = read_enrolment_log(study_dir)
    gone = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    return tuple(line for line in list_taken_slots(lines) if line.participant not in gone)


def read_enrolment_log(study_dir: Path) -> tuple[EnrolmentEntry, ...]:
    """Read all entries of the enrolment log, in the order written; return () if the study has not begun.

    Raises:
        AllocationError: if a complete line cannot be read.
    """
    return tuple(open_enrolment_log(study_dir).read())


def list_team_entries(study_dir: Path) -> tuple[TeamRecorded, ...]:
    """Return the entries of the study's teams, one for each team and block, in the order in which they were recorded.

    Members who withdrew are left out of them.
    """
    lines = read_enrolment_log(study_dir)
    withdrawn = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    teams = []
    for line in lines:
        if isinstance(line, TeamRecorded):
            members = {seat: code for seat, code in line.members.items() if code not in withdrawn}
            teams.append(msgspec.structs.replace(line, members=members))
    return tuple(teams)


def open_enrolment_log(study_dir: Path) -> Journal[EnrolmentEntry]:
    """Open a study's enrolment log."""
    return open_journal(study_dir, ENROLMENT_FILE_NAME, _decode_entry, chained=True, declaration=_DECLARATION)


def read_chain_heads(study_dir: Path) -> dict[str, dict[str, str]]:
    """Return the latest chain head of each segment, by log and then by segment, as recorded in the enrolment log."""
    heads: dict[str, dict[str, str]] = {}
    for line in read_enrolment_log(study_dir):
        if isinstance(line, ChainHeadRecorded):
            heads.setdefault(line.sealed, {})[line.segment] = line.chain
    return heads


def find_incomplete_logs(
    lines: Sequence[EnrolmentEntry], logs: Mapping[str, Collection[str]]
) -> Iterator[tuple[str, bool]]:
    """Yield a line for each missing log, and for each segment whose end is not in the enrolment log.

    Each line comes with whether it is acceptable: True only for a segment's end in the log of a participant whom an
    earlier version enrolled, since it did not record segments. The logs of participants who withdrew are not missing.

    Args:
        lines: the lines of the enrolment log.
        logs: the finished segments of each finished log, by the log's name.
    """
    for name in _list_missing_logs(lines, logs):
        yield f"{name} is gone: the enrolment log has the head of its chain", False
    recorded = {(line.sealed, line.segment) for line in lines if isinstance(line, ChainHeadRecorded)}
    of_earlier_version = {line.participant for line in lines if isinstance(line, SlotTaken) and not line.at}
    for name, segments in logs.items():
        is_acceptable = _find_participant(name) in of_earlier_version
        for segment in segments:
            if (name, segment) not in recorded:
                problem = f"the enrolment log does not say how segment {segment} of {name} ended"
                yield f"{problem}; add it with `minihuman recover LOG`", is_acceptable


def _list_missing_logs(lines: Sequence[EnrolmentEntry], logs: Collection[str]) -> list[str]:
    """List the logs that have a chain head but are not in ``logs``, without those of participants who withdrew."""
    withdrawn = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    # each log once, as it has a chain head for each of its segments
    recorded = dict.fromkeys(line.sealed for line in lines if isinstance(line, ChainHeadRecorded))
    return [name for name in recorded if name not in logs and _find_participant(name) not in withdrawn]


def _find_participant(log_name: str) -> str:
    """Return the code of the participant in the name of a log."""
    return log_name.partition("_")[0]


def find_slots_without_log(
    lines: Sequence[EnrolmentEntry], participants: Collection[str]
) -> Iterator[tuple[str, bool]]:
    """Yield a line for each participant who holds a slot and has no log.

    Each line comes with whether it is acceptable: True for a participant whom an earlier version enrolled.

    Args:
        lines: the lines of the enrolment log.
        participants: the codes of the participants who have a log, finished or not.
    """
    accounted_for = {*participants, *list_replaced(lines)}
    accounted_for |= {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    # ``find_incomplete_logs`` reports the logs that are gone
    accounted_for |= {_find_participant(line.sealed) for line in lines if isinstance(line, ChainHeadRecorded)}
    for slot in list_taken_slots(lines):
        if slot.participant not in accounted_for:
            code = slot.participant
            is_of_earlier_version = not slot.at
            yield (
                f"{code} has a slot and no log; if no session of theirs is running: minihuman replace {code}",
                is_of_earlier_version,
            )


def list_taken_slots(lines: Sequence[EnrolmentEntry]) -> tuple[SlotTaken, ...]:
    """List the slots that were taken and not freed, in order, each with the group from its latest draw."""
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
    """Return the number of manual interventions of each kind, by the kind's name.

    The number of interventions without a reason is under "without a reason". Kinds that never occurred are absent.
    """
    kinds = {
        ParticipantWithdrawn: "withdrawn",
        ParticipantReplaced: "replaced",
        LogRecovered: "logs recovered",
        DayOverridden: "run on another day",
        SlotTaken: "chosen by hand",
    }
    # a slot that was taken is an intervention only if it was chosen by hand
    by_hand = [line for line in lines if isinstance(line, tuple(kinds)) and getattr(line, "overridden", True)]
    counts = Counter(kinds[type(line)] for line in by_hand)
    counts["without a reason"] = sum(not getattr(line, "reason", "") for line in by_hand)
    return {kind: counts[kind] for kind in (*kinds.values(), "without a reason") if counts[kind]}


def list_replaced(lines: Sequence[EnrolmentEntry]) -> tuple[str, ...]:
    """List the participants who were replaced, in the order of replacement, without those whose slot was freed."""
    replaced: dict[str, None] = {}
    for line in lines:
        match line:
            case ParticipantReplaced():
                replaced.setdefault(line.replaced)
            case SlotFreed():
                replaced.pop(line.freed, None)
    return tuple(replaced)


def _decode_entry(line: bytes, number: int) -> EnrolmentEntry | None:
    """Decode a line; return None for an empty line, and for kinds that other programs add.

    Args:
        line: the line's bytes, without the line break.
        number: the line's number, for errors.

    Raises:
        AllocationError: if a complete line cannot be read, or a newer version wrote it.
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
_ENTRY_TYPES: dict[str, type[EnrolmentEntry]] = {  # by a field that identifies the kind; the first that is present
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
