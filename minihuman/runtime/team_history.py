"""The history of a team's block, read from its members' logs when a process begins to lead the team."""

import math
from dataclasses import dataclass
from pathlib import Path

from minihuman.activities.team.events import JointStepped, TeamEnded, TeamFormed
from minihuman.activities.team.joint_play import TeamHistory
from minihuman.activities.team.joint_step import JointAction
from minihuman.admin.enrolment_entries import list_team_entries
from minihuman.experiment.machine.events import FINAL_END_REASONS, EpisodeStarted, SessionEnded
from minihuman.log.paths import PART_SUFFIX, list_log_files, session_folder
from minihuman.log.read.reader import read_segment_starts
from minihuman.log.read.session_reader import read_events


@dataclass(frozen=True, slots=True, order=True)
class TeamSegment:
    """A segment of a team member's session."""

    started_ns: int
    path: Path
    seat: int


@dataclass(frozen=True, slots=True)
class TeamBlockKey:
    """The key of a team's block in a session."""

    team: str
    session: int
    block: str


def list_team_segments(study_dir: Path, data: Path, key: TeamBlockKey) -> list[TeamSegment]:
    """Return the segments of all sessions of a team's members for a block, in the order in which they began."""
    segments: set[TeamSegment] = set()
    for entry in list_team_entries(study_dir):
        if TeamBlockKey(entry.team, entry.session, entry.block) != key:
            continue
        for seat, code in entry.members.items():
            folder = session_folder(data, study_dir.name, code, entry.session)
            for path in list_log_files(folder, "*.mcap*"):
                starts = read_segment_starts(path, first=True).values()
                segments |= {TeamSegment(int(started_ns), path, int(seat)) for started_ns in starts}
    return sorted(segments)


def read_team_history(study_dir: Path, data: Path, key: TeamBlockKey, *, n_persons: int) -> TeamHistory:
    """Read the history of a block from the logs of a team that is still playing.

    If at some time every session of the team was over, the team restarts the episode that it did not complete. A live
    log counts as a session that is not over. ``n_persons`` is the number of people in the team; a team of one person
    always restarts the episode.
    """
    history = TeamHistory()
    until_ns = 0.0  # the latest end of the segments so far; infinite if one of them is still running
    for segment in list_team_segments(study_dir, data, key):
        if segment.started_ns > until_ns or n_persons == 1:
            _forget(history)
        end_ns = _read_segment(history, segment, key)
        is_cut_off = segment.path.name.endswith(PART_SUFFIX)
        if is_cut_off:
            until_ns = math.inf
        until_ns = max(until_ns, end_ns)
    if until_ns < math.inf or n_persons == 1:
        _forget(history)
    return history


def _forget(history: TeamHistory) -> None:
    """Discard the joint steps so far and the fact that the team had ended, since the team restarts its episode."""
    history.steps.clear()
    history.has_ended = False


def _read_segment(history: TeamHistory, segment: TeamSegment, key: TeamBlockKey) -> int:
    """Add the block's events in a segment's log to the history; return the time of the segment's last event.

    The time is in nanoseconds, on the clock of ``segment.started_ns``.
    """
    is_in_team = False
    is_in_block = False
    end_ns = segment.started_ns
    for event in read_events(segment.path):
        end_ns = segment.started_ns + event.t_ns
        match event:
            case TeamFormed():
                is_in_team = event.team == key.team
            case EpisodeStarted():
                is_in_block = is_in_team and event.plan.block_name == key.block
            case JointStepped() if is_in_block:
                _add_step(history, event)
            case TeamEnded() if is_in_block:
                history.has_ended |= event.reason == "partner_left"
            case SessionEnded() if event.reason in FINAL_END_REASONS:
                history.finished.add(segment.seat)
    return end_ns


def _add_step(history: TeamHistory, event: JointStepped) -> None:
    """Add a joint step, unless another member's log had it already."""
    steps = history.steps.setdefault(event.episode, [])
    if event.step == len(steps) + 1:
        steps.append(JointAction(event.actions, event.sources, event.silent_ms))  # type: ignore[arg-type]
