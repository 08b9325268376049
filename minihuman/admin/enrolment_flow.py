"""The flow of participants through a study (CONSORT, JARS-Quant), counted from enrolment entries and sessions.

``count_flow`` is pure: it takes the contents of the enrolment log and the session index and returns counts without
names. Each stage equals the stage before it minus named losses. Participants whose data were erased are counted by the
heads of their logs' hash chains, which remain in the enrolment log.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from minihuman.admin.enrolment_entries import (
    ChainHeadRecorded,
    EnrolmentEntry,
    GroupDrawn,
    ParticipantReplaced,
    ParticipantWithdrawn,
    SlotFreed,
    SlotTaken,
    TeamRecorded,
)
from minihuman.admin.session_summary import SessionSummary

GroupCounts = Mapping[str, int]  # counts by group; "" counts participants without a group
SessionState = Literal["complete", "screened_out", "failed", "unfinished", "unreadable"]
_LOG_NAME = re.compile(r"(?P<participant>.+)_ses-(?P<session>\d+)(_seg-\d+)?\.mcap(\.part)?$")
_DEPARTURES = {
    "declined": "did not agree",
    "screened_out": "screened out before a group was drawn",
    "player_failed": "simulated participants that failed before anything was recorded",
}
_DEPARTED = "left before anything was recorded"
_UNDRAWN = {
    "withdrawn": "withdrew before a group was drawn",
    "replaced": "replaced before a group was drawn",
    "waiting": "no group drawn so far",
}


class SessionRecord(NamedTuple):
    """The outcome of one participant's session, according to its log."""

    participant: str
    session: int
    group: str
    state: SessionState


class FlowStage(NamedTuple):
    """A stage of the flow, with the losses between it and the next stage."""

    label: str
    counts: GroupCounts
    losses: Mapping[str, GroupCounts]


@dataclass(frozen=True, slots=True)
class SessionFlow:
    """The flow of participants through one session, as counts by group."""

    not_begun: GroupCounts  # finished the session before, and have not begun this one
    not_returned: GroupCounts  # finished the session before, and were replaced before they began this one
    withdrew_before: GroupCounts  # in the first session: withdrew without a recorded session
    began: GroupCounts
    screened_out: GroupCounts
    failed: GroupCounts  # simulated participants that crashed or gave no answer
    unfinished: GroupCounts
    unfinished_replaced: GroupCounts  # did not finish, and were replaced
    unreadable: GroupCounts  # their log is gone or cannot be read
    withdrew: GroupCounts  # withdrew, and began this session last
    complete: GroupCounts
    went_on: GroupCounts  # those in ``complete`` of whom only a later session shows that they finished this one
    lost: GroupCounts  # those in ``began`` who did not withdraw, and whose log is gone or cannot be read


@dataclass(frozen=True, slots=True)
class AnalysisFlow:
    """The flow from the participants who began a session to those whom a report includes, as counts by group."""

    began: GroupCounts
    withdrew: GroupCounts
    unreadable: GroupCounts  # have no readable log
    not_selected: GroupCounts  # have no session among those that the report is about
    excluded: Mapping[str, GroupCounts]  # by reason
    included: GroupCounts
    unregistered: int  # included participants who are not in the enrolment log


@dataclass(frozen=True, slots=True)
class ParticipantFlow:
    """The flow of a study's participants. Someone who declined and came again counts twice: no record connects them."""

    came: int
    before: Mapping[str, int]  # people without a group or without data, by a description of why they left
    allocated: GroupCounts
    withdrew: GroupCounts  # allocated participants who withdrew
    replaced: GroupCounts  # allocated participants who were replaced and did not withdraw
    without_data: GroupCounts  # allocated participants who did neither and have no recorded session
    courses: Mapping[int, SessionFlow]  # by session, from 1
    teams: GroupCounts = field(default_factory=dict)  # teams of several people, by the group of the first
    analysis: AnalysisFlow | None = None  # for a report; None without one


@dataclass(slots=True)
class _Person:
    """A holder of a slot, as the enrolment log and the session logs describe them."""

    group: str
    is_withdrawn: bool = False
    is_replaced: bool = False
    begun: set[int] = field(default_factory=set)  # numbers of the sessions that they began
    states: dict[int, SessionState] = field(default_factory=dict)  # by session

    def add_session(self, record: "SessionRecord") -> None:
        self.group = self.group or record.group
        self.begun.add(record.session)
        self.states[record.session] = record.state

    @property
    def last_session(self) -> int:
        """Return the number of the last session that the person began; 0 if none is on record."""
        return max(self.begun, default=0)


def parse_log_name(name: str) -> tuple[str, int] | None:
    """Return the participant and the session that the name of a log contains; None for the name of another file."""
    match = _LOG_NAME.match(name)
    if match is None:
        return None
    return match["participant"], int(match["session"])


def classify_session(summary: SessionSummary) -> SessionState:
    """Return the state of a session; "unfinished" if it is neither complete, nor screened out, nor failed."""
    if summary.end_reason == "screened_out":
        return "screened_out"
    if summary.end_reason == "player_failed":
        return "failed"
    if summary.complete:
        return "complete"
    return "unfinished"


def count_unrecorded_departures(entries: Iterable[EnrolmentEntry]) -> dict[str, int]:
    """Count the people who left before anything was recorded, by a description of why they left."""
    counts = Counter(_DEPARTURES.get(line.why, _DEPARTED) for line in entries if isinstance(line, SlotFreed))
    return {label: counts[label] for label in (*_DEPARTURES.values(), _DEPARTED) if counts[label]}


def count_flow(
    entries: Iterable[EnrolmentEntry],
    sessions: Iterable[SessionRecord],
    exclusion_reasons: Mapping[str, str] | None = None,
) -> ParticipantFlow:
    """Count a study's participants by what happened to them, stage by stage.

    Args:
        entries: the entries of the enrolment log, in order.
        sessions: one record per participant and session that has a log.
        exclusion_reasons: by participant of a report, the reason for exclusion, "" if included; None without a report.
    """
    entries = tuple(entries)
    people = _list_people(entries)
    for record in sessions:
        if record.participant in people:
            people[record.participant].add_session(record)
    departures = count_unrecorded_departures(entries)
    allocated = [person for person in people.values() if person.group]
    remaining = [person for person in allocated if not person.is_withdrawn]
    n_sessions = max((person.last_session for person in allocated), default=1)
    analysis = None
    if exclusion_reasons is not None:
        analysis = _count_analysis(people, exclusion_reasons)
    return ParticipantFlow(
        came=len(people) + sum(departures.values()),
        before=departures | _count_undrawn(people.values()),
        allocated=_count_by_group(allocated),
        withdrew=_count_by_group(person for person in allocated if person.is_withdrawn),
        replaced=_count_by_group(person for person in remaining if person.is_replaced),
        without_data=_count_by_group(person for person in remaining if not (person.is_replaced or person.last_session)),
        courses={number: _count_session(number, allocated) for number in range(1, max(n_sessions, 1) + 1)},
        teams=_count_teams(entries, people),
        analysis=analysis,
    )


def list_stages(flow: ParticipantFlow) -> Iterator[FlowStage]:
    """Yield the stages from the people who came to those who finished the last session.

    The counts of each stage are those of the stage before minus its losses. People in the first stage have no group
    yet, so all of its counts are under "".
    """
    yield FlowStage("came", {"": flow.came}, {label: {"": count} for label, count in flow.before.items()})
    label = "allocated to a group"
    counts = flow.allocated
    for number, course in flow.courses.items():
        prefix = f"session {number}: " if len(flow.courses) > 1 else ""
        yield FlowStage(label, counts, _label_losses_before(prefix, number, course))
        yield FlowStage(f"{prefix}began", course.began, _label_losses_during(prefix, course))
        label = f"{prefix}{_label_finished(course)}"
        counts = course.complete
    yield FlowStage(label, counts, {})


def list_analysis_stages(analysis: AnalysisFlow) -> Iterator[FlowStage]:
    """Yield the stages from the participants who began a session to those whom a report includes."""
    losses = {
        "withdrew, data erased or sealed": analysis.withdrew,
        "no log that can be read": analysis.unreadable,
        "not in this report's selection": analysis.not_selected,
        **{f"excluded: {reason}": counts for reason, counts in sorted(analysis.excluded.items())},
    }
    yield FlowStage("for the analysis: began a session", analysis.began, _drop_empty(losses))
    yield FlowStage("included in this report", analysis.included, {})


def _list_people(entries: Iterable[EnrolmentEntry]) -> dict[str, _Person]:
    """Return the holders of slots that were not freed, by participant code."""
    people: dict[str, _Person] = {}
    for line in entries:
        match line:
            case SlotTaken():
                people.setdefault(line.participant, _Person(line.group)).group = line.group
            case GroupDrawn() if line.drawn in people:
                people[line.drawn].group = line.group
            case SlotFreed():
                people.pop(line.freed, None)
            case ParticipantWithdrawn() if line.withdrawn in people:
                people[line.withdrawn].is_withdrawn = True
            case ParticipantReplaced() if line.replaced in people:
                people[line.replaced].is_replaced = True
            case ChainHeadRecorded():
                code, session = parse_log_name(line.sealed) or ("", 0)
                if code in people:
                    people[code].begun.add(session)
    return people


def _count_undrawn(people: Iterable[_Person]) -> dict[str, int]:
    """Count the participants for whom no group was drawn, by a description of the reason."""
    counts = Counter[str]()
    for person in people:
        if person.group:
            continue
        if person.is_withdrawn:
            counts[_UNDRAWN["withdrawn"]] += 1
        elif person.is_replaced:
            counts[_UNDRAWN["replaced"]] += 1
        else:
            counts[_UNDRAWN["waiting"]] += 1
    return {label: counts[label] for label in _UNDRAWN.values() if counts[label]}


def _count_by_group(people: Iterable[_Person]) -> GroupCounts:
    return Counter(person.group for person in people)


def _count_session(number: int, people: Iterable[_Person]) -> SessionFlow:
    """Count the flow through the session with a number, from the participants who finished the session before it."""
    counts = {name: Counter[str]() for name in SessionFlow.__dataclass_fields__}
    for person in people:
        for name in _trace_session(number, person):
            counts[name][person.group] += 1
    return SessionFlow(**counts)


def _trace_session(number: int, person: _Person) -> Iterator[str]:
    """Yield the names of the fields of ``SessionFlow`` that count a participant in the session with a number."""
    last = person.last_session
    if number > last:
        if number == last + 1 and _went_through(last, person):
            yield _name_absence(person)
        return
    yield "began"
    if not person.is_withdrawn and person.states.get(number, "unreadable") == "unreadable":
        yield "lost"
    if number < last or _went_through(number, person):
        yield "complete"
        if not person.is_withdrawn and person.states.get(number) != "complete":
            yield "went_on"
    elif person.is_withdrawn:
        yield "withdrew"
    else:
        state = person.states.get(number, "unreadable")
        yield "unfinished_replaced" if state == "unfinished" and person.is_replaced else state


def _went_through(session: int, person: _Person) -> bool:
    """Return whether a participant finished a session, by its log, and did not withdraw; True for session 0."""
    if session == 0:
        return True
    return not person.is_withdrawn and person.states.get(session) == "complete"


def _name_absence(person: _Person) -> str:
    """Return the name of the field of ``SessionFlow`` that counts a participant who has not begun a session."""
    if person.is_withdrawn:
        return "withdrew_before"
    if person.is_replaced:
        return "not_returned"
    return "not_begun"


def _count_teams(entries: Iterable[EnrolmentEntry], people: Mapping[str, _Person]) -> GroupCounts:
    """Count the teams of several people by the group of the first member; a team counts once for all its blocks."""
    first_members: dict[frozenset[str], str] = {}
    for line in entries:
        if not isinstance(line, TeamRecorded) or line.solo:
            continue
        members = list(line.members.values())
        if len(set(members)) > 1:
            first_members[frozenset(members)] = members[0]
    return Counter(people[first].group for first in first_members.values() if first in people)


def _count_analysis(people: Mapping[str, _Person], exclusion_reasons: Mapping[str, str]) -> AnalysisFlow:
    """Count the participants who began a session by whether a report includes them, and if not, why.

    Args:
        people: the holders of slots, by participant code.
        exclusion_reasons: by participant of the report, the reason for exclusion; "" if included.
    """
    counts = {name: Counter[str]() for name in ("began", "withdrew", "unreadable", "not_selected", "included")}
    excluded: dict[str, Counter[str]] = {}
    began = {code: person for code, person in people.items() if person.group and person.last_session}
    for code, person in began.items():
        counts["began"][person.group] += 1
        if person.is_withdrawn:
            counts["withdrew"][person.group] += 1
        elif code not in exclusion_reasons:
            is_unreadable = all(state == "unreadable" for state in person.states.values())
            name = "unreadable" if is_unreadable else "not_selected"
            counts[name][person.group] += 1
        elif exclusion_reasons[code]:
            excluded.setdefault(exclusion_reasons[code], Counter())[person.group] += 1
        else:
            counts["included"][person.group] += 1
    unregistered = sum(not reason and code not in began for code, reason in exclusion_reasons.items())
    return AnalysisFlow(**counts, excluded=excluded, unregistered=unregistered)


def _label_losses_before(prefix: str, number: int, course: SessionFlow) -> dict[str, GroupCounts]:
    """Return the losses between the stage before a session and the start of the session, by label.

    Args:
        prefix: the start of each label, which names the session if there are several; not used for the first session.
        number: the session's number.
        course: the flow through the session.
    """
    if number == 1:
        return _drop_empty(
            {
                "withdrew, no session on record": course.withdrew_before,
                "nothing recorded, slot reallocated": course.not_returned,
                "no data recorded so far": course.not_begun,
            }
        )
    return _drop_empty(
        {
            f"{prefix}did not return, slot reallocated": course.not_returned,
            f"{prefix}not begun so far": course.not_begun,
        }
    )


def _label_losses_during(prefix: str, course: SessionFlow) -> dict[str, GroupCounts]:
    """Return the losses between the start and the end of a session, by label; each label begins with the prefix."""
    losses = {
        "screened out": course.screened_out,
        "simulated participant failed": course.failed,
        "not finished, slot reallocated": course.unfinished_replaced,
        "not finished": course.unfinished,
        "log missing or unreadable": course.unreadable,
        "withdrew during or after it": course.withdrew,
    }
    return _drop_empty({f"{prefix}{label}": counts for label, counts in losses.items()})


def _label_finished(course: SessionFlow) -> str:
    """Return the label for the participants who finished a session, including what is uncertain about them."""
    label = "finished"
    if course.withdrew:
        label = "finished and did not withdraw"
    if course.went_on:
        label += f" ({sum(course.went_on.values())} of them by a later session alone)"
    return label


def _drop_empty(losses: Mapping[str, GroupCounts]) -> dict[str, GroupCounts]:
    """Return those of the losses, by label, that at least one participant is counted in."""
    return {label: counts for label, counts in losses.items() if sum(counts.values())}
