"""The flow of a study's participants: how many came, declined, got a group, were screened out, left and finished.

Counted from the register and the sessions beside it. It names nobody, and of those who left before anything was
recorded it knows that they did, and why, from the register's line that freed their slot.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from minihuman.lab.register_lines import Freed, Line, Taken, Withdrawn, read_lines, replaced_by_others, slots_taken
from minihuman.lab.session_table import sessions
from minihuman.lab.summary import Summary

Counts = Mapping[str, int]  # by group
_LEFT_BEFORE = {
    "declined": "did not agree",
    "screened_out": "screened out before a group was drawn",
}
_LEFT = "left before anything was recorded"


@dataclass(frozen=True, slots=True)
class Course:
    """What became of one session; counts of participants by group."""

    began: Counts
    complete: Counts
    screened_out: Counts
    unfinished: Counts


@dataclass(frozen=True, slots=True)
class Flow:
    """Counts of participants. Who declined and came again came twice: nothing is kept that could tell."""

    came: int
    before: Mapping[str, int]  # who left no data, by what they did
    given_group: Counts
    withdrew: Counts
    replaced: Counts
    unrecorded: Counts  # have a slot and no data
    courses: Mapping[int, Course]  # by session, from 1


def flow(study_dir: Path) -> Flow:
    """Count.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the register cannot be read.
    """
    lines = read_lines(study_dir)
    taken = {line.participant: line.group for line in slots_taken(lines)}
    gone = {line.withdrawn for line in lines if isinstance(line, Withdrawn)}
    replaced = set(replaced_by_others(lines))
    found: dict[tuple[int, str], Summary] = {}
    for row in sessions(study_dir):
        one = row.summary
        if one is not None and one.participant in taken.keys() - gone:
            found.setdefault((one.session, one.participant), one)
    unrecorded = taken.keys() - gone - {participant for _, participant in found}
    return Flow(
        came=sum(isinstance(line, Taken) for line in lines),
        before=left_before(lines),
        given_group=_by_group(taken, taken),
        withdrew=_by_group(taken, taken.keys() & gone),
        replaced=_by_group(taken, (taken.keys() & replaced) - gone),
        unrecorded=_by_group(taken, unrecorded),
        courses={number: _course(number, found) for number in sorted({number for number, _ in found})},
    )


def left_before(lines: Iterable[Line]) -> dict[str, int]:
    """How many left no data, by what they did."""
    left = Counter(_LEFT_BEFORE.get(line.why, _LEFT) for line in lines if isinstance(line, Freed))
    return {what: left[what] for what in (*_LEFT_BEFORE.values(), _LEFT) if left[what]}


def _by_group(groups: Mapping[str, str], codes: Collection[str]) -> Counts:
    return Counter(groups[code] for code in codes if groups[code])


def _course(number: int, found: Mapping[tuple[int, str], Summary]) -> Course:
    here = [one for (session, _), one in found.items() if session == number]
    states = [(one.group, _state(one)) for one in here]
    of = {state: Counter(group for group, its in states if its == state) for state in ("complete", "out", "unfinished")}
    return Course(Counter(one.group for one in here), of["complete"], of["out"], of["unfinished"])


def _state(one: Summary) -> str:
    if one.end_reason == "screened_out":
        return "out"
    return "complete" if one.complete else "unfinished"
