"""What a participant plays next: a new session, or the rest of one that was cut short."""

from pathlib import Path

import msgspec

from minihuman.errors import AllocationError
from minihuman.lab.register import take_slot
from minihuman.log.paths import session_folder, sessions_in
from minihuman.log.read.open_log import open_log
from minihuman.log.record.finish import leftovers, recover
from minihuman.recorded.episode import SessionLog
from minihuman.study.expand import expand
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Protocol


def next_session(
    protocol: Protocol, data: Path, *, participant: str | None = None, group: str | None = None, session: int = 1
) -> SessionPlan:
    """Take the participant's slot and say what is to be played; a session that is not complete is gone on with.

    A session is resumed by the plan it began with, at the first episode not completed: same keys, same seeds, whatever
    became of the protocol file. Logs that an earlier run left cut off are finished first.

    Args:
        participant: a code ("sub-07"); None takes the next free slot.
        group: overrides the allocation list's.
        session: 1 for the participant's first.

    Raises:
        AllocationError: if there is no slot to take, or the session is complete.
        LogError: if an earlier log is damaged.
        OSError: if the data folder cannot be read or written.
    """
    study_dir = data / protocol.study.name
    if session > 1:
        _check_came_before(study_dir, participant, session)
    who, taken = take_slot(protocol, study_dir, participant=participant, group=group)
    folder = session_folder(data, protocol.study.name, who.id, session)
    for part in leftovers(folder):
        recover(part)
    if not folder.is_dir() or not sessions_in(folder):
        return expand(protocol, who, session=session, overridden=taken.overridden)
    return _rest_of(open_log(folder))


def _check_came_before(study_dir: Path, participant: str | None, session: int) -> None:
    if participant is None:
        raise AllocationError(f"session {session} is somebody's: say whose with --participant")
    before = session_folder(study_dir.parent, study_dir.name, participant, session - 1)
    if not before.is_dir() or not sessions_in(before):
        raise AllocationError(
            f"{participant} has not begun session {session - 1}; run it first: --participant {participant} "
            f"--session {session - 1}"
        )
    left = _left(open_log(before))
    if left:
        raise AllocationError(
            f"{participant} has {len(left)} episodes of session {session - 1} left to play; finish it first: "
            f"--participant {participant} --session {session - 1}"
        )


def _left(log: SessionLog) -> list[int]:
    """The episodes that are not completed."""
    completed = {played.plan.episode for played in log.episodes if played.outcome not in (None, "abandoned")}
    return [episode.episode for episode in log.plan.episodes if episode.episode not in completed]


def _rest_of(log: SessionLog) -> SessionPlan:
    left = _left(log)
    who, session = log.plan.participant.id, log.plan.session
    if not left:
        raise AllocationError(
            f"{who} has completed session {session} ({log.path}); start their next one with --session {session + 1}"
        )
    segments = [int(start["segment"]) for start in log.metadata["segments"]]
    return msgspec.structs.replace(log.plan, first_episode=left[0], segment=max(segments) + 1)
