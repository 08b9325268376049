"""What a participant plays next: a new session, or the rest of one that was cut short."""

from datetime import UTC, datetime
from pathlib import Path

import msgspec

from minihuman.errors import AllocationError
from minihuman.lab.register import draw_slot, take_slot
from minihuman.log.paths import session_folder, sessions_in
from minihuman.log.read.open_log import open_log
from minihuman.log.record.finish import leftovers, recover
from minihuman.recorded.episode import SessionLog
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.events import SETTLED, Answered, EpisodesSkipped, PartEnded, Scored
from minihuman.study.expand import expand
from minihuman.study.parts import only_last_words
from minihuman.study.plan import Participant, SessionPlan, Standing
from minihuman.study.protocol import Protocol


def next_session(
    protocol: Protocol,
    data: Path,
    *,
    participant: str | None = None,
    group: str | None = None,
    session: int = 1,
    any_day: bool = False,
) -> SessionPlan:
    """Take the participant's slot and say what is to be played; a session that is not complete is gone on with.

    A session is resumed by the plan it began with, at the first episode not completed: same keys, same seeds, whatever
    became of the protocol file. Logs that an earlier run left cut off are finished first.

    Args:
        participant: a code ("sub-07"); None takes the next free slot.
        group: overrides the allocation list's.
        session: 1 for the participant's first.
        any_day: whether a later session may be too early or too late.

    Raises:
        AllocationError: if there is no slot to take, or the session is complete.
        LogError: if an earlier log is damaged.
        OSError: if the data folder cannot be read or written.
    """
    study_dir = data / protocol.study.name
    if session > 1:
        _check_came_before(protocol, study_dir, participant, session, any_day=any_day)
    who, taken = take_slot(protocol, study_dir, participant=participant, group=group)
    folder = session_folder(data, protocol.study.name, who.id, session)
    for part in leftovers(folder):
        recover(part)
    if folder.is_dir() and sessions_in(folder):
        return _rest_of(open_log(folder))
    if protocol.allocation.stratify and session == 1:
        who = Participant(who.id, who.index, "")  # drawn, or drawn again, after the answer
    return expand(protocol, who, session=session, overridden=taken.overridden)


def drawn_session(protocol: Protocol, data: Path, undrawn: SessionPlan, stratum: str) -> SessionPlan:
    """The plan of somebody who has answered, their group drawn.

    Raises:
        AllocationError: if there is no slot of that stratum.
        OSError: if the data folder cannot be read or written.
    """
    who = draw_slot(protocol, data / protocol.study.name, undrawn.participant.id, stratum)
    return expand(protocol, who, session=undrawn.session, overridden=undrawn.overridden)


def _check_came_before(
    protocol: Protocol, study_dir: Path, participant: str | None, session: int, *, any_day: bool
) -> None:
    if participant is None:
        raise AllocationError(f"session {session} is somebody's: say whose with --participant")
    before = session_folder(study_dir.parent, study_dir.name, participant, session - 1)
    if not before.is_dir() or not sessions_in(before):
        raise AllocationError(
            f"{participant} has not begun session {session - 1}; run it first: --participant {participant} "
            f"--session {session - 1}"
        )
    log = open_log(before)
    if log.end_reason == "screened_out":
        raise AllocationError(f"{participant} was screened out in session {session - 1}: there is no session {session}")
    left = len(_left(log))
    if not is_complete(log) and (left or not only_last_words(log.plan.parts, _standing(log).part)):
        what = f"{left} episodes of session {session - 1} left to play" if left else f"not ended session {session - 1}"
        raise AllocationError(
            f"{participant} has {what}; finish it first: --participant {participant} --session {session - 1}"
        )
    if not any_day:
        _check_day(protocol, log, session)


def _check_day(protocol: Protocol, before: SessionLog, session: int) -> None:
    day = protocol.sessions[session - 1] if session <= len(protocol.sessions) else None
    if day is None or day.days_after is None:
        return
    earliest, latest = day.days_after
    began = datetime.fromisoformat(before.started_at).date()
    passed = (datetime.now(UTC).date() - began).days
    if not earliest <= passed <= latest:
        raise AllocationError(
            f"session {session} is {earliest} to {latest} days after session {session - 1}, which was {passed} days "
            "ago; come back in time, or run it even so with --any-day"
        )


def is_complete(log: SessionLog) -> bool:
    """Whether nothing of a session is left to do."""
    return log.end_reason in SETTLED or (not log.plan.parts and not _left(log))


def _left(log: SessionLog) -> list[int]:
    """The episodes that are neither completed nor skipped."""
    done = {played.plan.episode for played in log.episodes if played.outcome not in (None, "abandoned")}
    for event in log.part_events:
        if isinstance(event, EpisodesSkipped):
            done.update(range(event.first, event.first + event.count))
    return [episode.episode for episode in log.plan.episodes if episode.episode not in done]


def _rest_of(log: SessionLog) -> SessionPlan:
    who, session = log.plan.participant.id, log.plan.session
    if is_complete(log):
        raise AllocationError(
            f"{who} has completed session {session} ({log.path}); start their next one with --session {session + 1}"
        )
    left = _left(log)
    segments = [int(start["segment"]) for start in log.metadata["segments"]]
    return msgspec.structs.replace(
        log.plan,
        first_episode=left[0] if left else len(log.plan.episodes),
        segment=max(segments) + 1,
        standing=_standing(log),
    )


def _standing(log: SessionLog) -> Standing:
    """The part that was not ended, and what had been reached by then."""
    part, points = log.plan.standing.part, log.plan.standing.points
    tries = dict(log.plan.standing.tries)
    names = [its.name for its in log.plan.parts]
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
    its = log.plan.parts[part].plan if part < len(log.plan.parts) else None
    outcomes: tuple[str, ...] = ()
    if isinstance(its, PlayPlan):
        played = {episode.plan.episode: episode.outcome for episode in log.episodes}
        places = range(its.first, its.first + its.count)
        outcomes = tuple(outcome for place in places if (outcome := played.get(place)) and outcome != "abandoned")
    return Standing(part, points, outcomes, tries)
