"""Decide what a participant plays next: a new session, or the unfinished rest of an interrupted one."""

from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import msgspec

from minihuman.activities.play.plan import PlayPlan
from minihuman.admin.enrolment_entries import (
    NO_NOTE,
    AuditNote,
    DayOverridden,
    LogRecovered,
    list_replaced,
    read_enrolled,
    read_enrolment_log,
)
from minihuman.admin.enrolment_log import draw_slot, record_intervention, take_slot
from minihuman.admin.manifest import record_missing_heads
from minihuman.admin.session_index import read_session_index
from minihuman.admin.session_summary import SessionSummary
from minihuman.errors import AllocationError
from minihuman.experiment.machine.events import FINAL_END_REASONS, Answered, EpisodesSkipped, PartEnded, Scored
from minihuman.experiment.machine.part_sequence import is_only_closing_left
from minihuman.experiment.plan.designs import PlayedEpisode
from minihuman.experiment.plan.expansion import expand_protocol
from minihuman.experiment.plan.session_plan import Participant, ResumeState, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.model.session_log import CUT_OFF, SessionLog
from minihuman.log.paths import PART_SUFFIX, list_sessions, session_folder
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.log.record.finalization import find_leftovers, recover_log
from minihuman.storage.system import now_text, wall_time


def plan_next_session(
    protocol: Protocol,
    data: Path,
    *,
    participant: str | None = None,
    group: str | None = None,
    session: int = 1,
    any_day: bool = False,
    note: AuditNote | None = None,
    prefix: str = "sub",
    utc_offset_min: int | None = None,
    publish: Callable[[Path], None] = lambda _: None,
) -> SessionPlan:
    """Take the participant's slot and plan the session to play, or the rest of an incomplete one.

    A session is resumed under the plan with which it began, at the first episode that is not completed, with the same
    keys and seeds, even if the protocol file has changed. Logs that an earlier run left truncated are finished first.

    Args:
        protocol: the study's protocol.
        data: the data folder.
        participant: a participant code ("sub-07"); None takes the next free slot.
        group: a group that overrides the allocation list's.
        session: the session number; 1 is the participant's first.
        any_day: whether a later session may be played on a day that the protocol does not allow.
        note: the reason for an override and the experimenter, for the enrolment log; None to leave a session on another
            day unrecorded.
        prefix: the prefix of a new participant's code.
        utc_offset_min: the participant's offset from UTC in minutes; None uses that of the previous session.
        publish: stores each truncated log, once it is finished and before it is renamed, where all servers find it.

    Raises:
        AllocationError: if there is no slot to take, or the session is complete.
        LogError: if an earlier log is damaged.
        OSError: if the data folder cannot be read or written.
    """
    study_dir = data / protocol.study.name
    is_on_other_day = False
    if session > 1:
        previous = _read_previous_session(study_dir, participant, session)
        is_on_other_day = _is_on_other_day(protocol, previous, session, utc_offset_min, allowed=any_day)
    enrolled, slot = take_slot(
        protocol, study_dir, participant=participant, group=group, note=note or NO_NOTE, prefix=prefix
    )
    if is_on_other_day and note is not None:
        record_intervention(study_dir, DayOverridden(enrolled.id, session, now_text(), note.reason, note.experimenter))
    folder = session_folder(data, protocol.study.name, enrolled.id, session)
    _finish_leftovers(folder, study_dir, publish)
    if folder.is_dir() and list_sessions(folder):
        return _plan_remaining_session(read_log(folder))
    if protocol.allocation.stratify_by and session == 1:
        enrolled = Participant(enrolled.id, enrolled.index, "")  # drawn, or drawn again, after the answer
    return expand_protocol(
        protocol, enrolled, session=session, overridden=slot.overridden, outcome_rules=slot.outcome_rules
    )


def _finish_leftovers(folder: Path, study_dir: Path, publish: Callable[[Path], None]) -> None:
    """Finish the truncated logs in a session's folder, and record this in the enrolment log.

    Args:
        folder: the session's folder.
        study_dir: the study's folder.
        publish: stores each log, once it is finished and before it is renamed, where all servers find it.
    """
    for part in find_leftovers(folder):
        finished = recover_log(part, publish)
        if finished.readable:
            record_missing_heads(finished.path)
            recovered = LogRecovered(finished.path.name, now_text(), f"ended: {finished.end_reason}", "resumed")
            record_intervention(study_dir, recovered)


def plan_drawn_session(protocol: Protocol, data: Path, undrawn: SessionPlan, stratum: str) -> SessionPlan:
    """Draw the group of a participant who has answered the question about their stratum, and plan their session.

    Args:
        protocol: the study's protocol.
        data: the data folder.
        undrawn: the plan of the session without a group.
        stratum: the stratum that the answer determines.

    Raises:
        AllocationError: if the stratum has no free slot.
        OSError: if the data folder cannot be read or written.
    """
    participant = draw_slot(protocol, data / protocol.study.name, undrawn.participant.id, stratum)
    return expand_protocol(
        protocol,
        participant,
        session=undrawn.session,
        overridden=undrawn.overridden,
        outcome_rules=undrawn.outcome_rules,
    )


def _read_previous_session(study_dir: Path, participant: str | None, session: int) -> SessionLog:
    """Read the log of a participant's session before ``session``, and require that it is complete.

    Raises:
        AllocationError: if no participant is named, or the previous session is missing, incomplete or was screened out.
    """
    if participant is None:
        raise AllocationError(f"session {session} needs a participant; name one with --participant")
    previous = session - 1
    folder = session_folder(study_dir.parent, study_dir.name, participant, previous)
    if not folder.is_dir() or not list_sessions(folder):
        raise AllocationError(
            f"{participant} has not begun session {previous}; run it first: --participant {participant} "
            f"--session {previous}"
        )
    log = read_log(folder)
    if log.end_reason == "screened_out":
        raise AllocationError(
            f"{participant} was screened out in session {previous} and has no session {session}; choose another "
            "participant"
        )
    _require_complete(log)
    return log


def _is_on_other_day(
    protocol: Protocol, previous: SessionLog, session: int, utc_offset_min: int | None, *, allowed: bool
) -> bool:
    """Return whether a session is run today although the protocol plans it for another day.

    Args:
        protocol: the study's protocol.
        previous: the log of the participant's session before this one.
        session: the number of the session; 1 is the first.
        utc_offset_min: the participant's offset from UTC in minutes; None uses that of the previous session.
        allowed: whether it may be run on another day.

    Raises:
        AllocationError: if so, and this is not allowed.
    """
    try:
        _require_due_today(protocol, previous, session, utc_offset_min)
    except AllocationError:
        if allowed:
            return True
        raise
    return False


def _require_complete(log: SessionLog) -> None:
    """Raise AllocationError if a session is not complete and more than its closing pages are left."""
    if is_session_complete(log):
        return
    participant = log.plan.participant.id
    session = log.plan.session
    n_left = len(find_remaining_episodes(log))
    if n_left:
        unfinished = f"{n_left} episodes of session {session} left to play"
    elif not is_only_closing_left(log.plan.parts, _build_resume_state(log).part):
        unfinished = f"not ended session {session}"
    else:
        return
    raise AllocationError(
        f"{participant} has {unfinished}; finish it first: --participant {participant} --session {session}"
    )


def find_interrupted_session(study_dir: Path) -> SessionSummary | None:
    """Return the first session that a crash interrupted and that can be resumed; None if there is none.

    Running sessions, and those of participants who withdrew or were replaced, are not considered.
    """
    expected = {slot.participant for slot in read_enrolled(study_dir)} - {*list_replaced(read_enrolment_log(study_dir))}
    if not expected:
        return None
    for row in read_session_index(study_dir):
        summary = row.summary
        if summary is None or summary.participant not in expected:
            continue
        is_interrupted = summary.end_reason == CUT_OFF and not summary.complete
        if is_interrupted and not _is_running(row.path.parent):
            return summary
    return None


def _is_running(folder: Path) -> bool:
    """Return whether the session of a folder is being recorded."""
    return any(is_being_recorded(part) for part in folder.glob(f"*{PART_SUFFIX}"))


def find_unused_slots(study_dir: Path) -> tuple[str, ...]:
    """Return the codes of participants who have a slot and no log, as when a program is killed before consent.

    Participants who were replaced are left out.
    """
    excluded = set(list_replaced(read_enrolment_log(study_dir)))
    if study_dir.is_dir():
        excluded |= {row.path.name.partition("_")[0] for row in read_session_index(study_dir)}
    return tuple(slot.participant for slot in read_enrolled(study_dir) if slot.participant not in excluded)


def find_start_date(log: SessionLog) -> date:
    """Return the participant's calendar day when a session began; in UTC if the log records no UTC offset."""
    return find_local_date(datetime.fromisoformat(log.started_at), log)


def find_local_date(when: datetime, log: SessionLog, utc_offset_min: int | None = None) -> date:
    """Convert a time to the calendar day in a participant's time zone, which can differ from the server's.

    Args:
        when: the time, with its time zone.
        log: the participant's session, whose UTC offset is the default.
        utc_offset_min: the participant's UTC offset in minutes at that time, if known.
    """
    facts = log.segments[0].facts if log.segments else {}
    if utc_offset_min is None:
        offset_min = int(facts.get("utc_offset_min", 0))
    else:
        offset_min = utc_offset_min
    return (when.astimezone(UTC) + timedelta(minutes=offset_min)).date()


def _require_due_today(
    protocol: Protocol, previous: SessionLog, session: int, utc_offset_min: int | None = None
) -> None:
    """Raise AllocationError unless a session is due today, counted in days after the previous one.

    Args:
        protocol: the study's protocol.
        previous: the log of the participant's session before this one.
        session: the number of the session; 1 is the first.
        utc_offset_min: the participant's offset from UTC in minutes; None uses that of the previous session.
    """
    if session > len(protocol.sessions):
        return
    days_after_previous = protocol.sessions[session - 1].days_after_previous
    if days_after_previous is None:
        return
    earliest, latest = days_after_previous
    passed = (find_local_date(wall_time(), previous, utc_offset_min) - find_start_date(previous)).days
    if not earliest <= passed <= latest:
        raise AllocationError(
            f"session {session} is due {earliest} to {latest} days after session {session - 1}, which was {passed} "
            "days ago; run it when it is due, or add --any-day to run it now"
        )


def is_session_complete(log: SessionLog) -> bool:
    """Return whether a session ended for good or, in a log older than session parts, all episodes are finished."""
    return log.end_reason in FINAL_END_REASONS or (not log.plan.parts and not find_remaining_episodes(log))


def find_remaining_episodes(log: SessionLog) -> list[int]:
    """Return the numbers of a log's planned episodes that are neither completed nor skipped, in the order planned."""
    finished = {played.plan.episode for played in log.episodes if played.outcome not in (None, "abandoned")}
    for event in log.part_events:
        if isinstance(event, EpisodesSkipped):
            finished.update(range(event.first, event.first + event.count))
    return [episode.episode for episode in log.plan.episodes if episode.episode not in finished]


def _plan_remaining_session(log: SessionLog) -> SessionPlan:
    """Return the plan of an interrupted session, to be continued in a new segment at the first unfinished episode.

    Raises:
        AllocationError: if the session is complete.
    """
    participant = log.plan.participant.id
    session = log.plan.session
    if is_session_complete(log):
        raise AllocationError(
            f"{participant} has completed session {session} ({log.path}); start their next one with --session "
            f"{session + 1}"
        )
    remaining_episodes = find_remaining_episodes(log)
    if remaining_episodes:
        first_episode = remaining_episodes[0]
    else:
        first_episode = len(log.plan.episodes)
    last_segment = max(int(start["segment"]) for start in log.metadata["segments"])
    return msgspec.structs.replace(
        log.plan, first_episode=first_episode, segment=last_segment + 1, standing=_build_resume_state(log)
    )


def _build_resume_state(log: SessionLog) -> ResumeState:
    """Return the state from which a session is resumed: its part, points, attempts and outcomes so far."""
    part = log.plan.standing.part
    points = log.plan.standing.points
    tries = dict(log.plan.standing.tries)
    names = [planned.name for planned in log.plan.parts]
    for event in log.part_events:
        match event:
            case PartEnded():
                part = event.next
                if event.end == "again":
                    tries[names[event.part]] = tries.get(names[event.part], 0) + 1
            case Scored():
                points = event.total
            case Answered() if event.attempt > 1:
                tries[event.part_name] = max(tries.get(event.part_name, 0), event.attempt - 1)
    state = ResumeState(
        part, points, (), tries, waited_ns=log.waited_ns or msgspec.UNSET, stranded=log.stranded or msgspec.UNSET
    )
    if part >= len(log.plan.parts):
        return state
    part_plan = log.plan.parts[part].plan
    if not isinstance(part_plan, PlayPlan):
        return state
    history = _list_history(log, part_plan)
    state = msgspec.structs.replace(state, outcomes=tuple(episode.outcome for episode in history))
    if part_plan.design:
        return msgspec.structs.replace(state, history=history)
    return state


def _list_history(log: SessionLog, part_plan: PlayPlan) -> tuple[PlayedEpisode, ...]:
    """Return the episodes of a part that were played to an end, in the order planned."""
    finished = {episode.plan.episode: episode for episode in log.episodes if episode.outcome not in (None, "abandoned")}
    history = []
    for number in range(part_plan.first, part_plan.first + part_plan.count):
        episode = finished.get(number)
        if episode is not None:
            reward = sum(episode.rewards.tolist())
            outcome = str(episode.outcome)
            history.append(
                PlayedEpisode(episode.plan.options, episode.plan.seed, outcome, len(episode.actions), reward)
            )
    return tuple(history)
