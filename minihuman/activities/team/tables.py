"""Tables of team blocks: each episode's team, and each joint step."""

import json
from collections import Counter

from minihuman.activities.team import rows
from minihuman.activities.team.columns import ABSENCES, JOINT_STEPS, TEAMS
from minihuman.activities.team.events import JointStepped, SeatSeen
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.log.model.session_log import EpisodeLog, SessionLog, TeamRecord


def _count_agent_steps(team: TeamRecord) -> int:
    """Count the joint steps in which an agent acted in the seat of at least one person."""
    count = 0
    for sources in team.sources:
        if any(sources[seat] == "agent" for seat in team.persons):
            count += 1
    return count


def _build_team_row(episode: EpisodeLog) -> TableRow | None:
    """Build an episode's row of the table of teams; None if no team played it."""
    team = episode.team
    if team is None:
        return None
    return {
        "team": team.team,
        "team_index": team.index + 1,
        "seat": team.seat,
        "role": team.role,
        "partner": team.partner,
        "seats": json.dumps(team.seats, sort_keys=True),
        "outcome": episode.outcome_word,
        "joint_steps": len(team.actions),
        "team_reward": float(team.rewards.mean(axis=1).sum()),
        "late": team.late,
        "idled": sum(sources[team.seat] == "late" for sources in team.sources),
        "corrected": team.corrected,
        "takeovers": team.takeovers,
        "agent_steps": _count_agent_steps(team),
        "played_by": json.dumps(team.steps_by_source),
        "absent_share": team.absent_share,
        "absences": json.dumps([_count_states(team, seat) for seat in range(len(team.seats))]),
        "digest": f"{team.digest:016x}",
    }


def _count_states(team: TeamRecord, seat: int) -> dict[str, int]:
    """Count how often each state other than "here" was seen of a seat's person, sorted by the state's name."""
    states = Counter(
        sighting.state for sighting in team.sightings if sighting.seat == seat and sighting.state != "here"
    )
    return dict(sorted(states.items()))


def _build_absence_row(event: SeatSeen, log: SessionLog) -> TableRow:
    return {
        "episode": event.episode + 1,
        "step": event.step,
        "seat": event.seat,
        "state": event.state,
        "for_ms": event.for_ms,
    }


def _build_joint_step_row(event: JointStepped, log: SessionLog) -> TableRow:
    return {
        "episode": event.episode + 1,
        "step": event.step,
        "actions": json.dumps(event.actions),
        "rewards": json.dumps(event.rewards),
        "sources": json.dumps(event.sources),
    }


TEAM_TABLES = (
    ActivityTable(
        "teams",
        TEAMS,
        episode_row=_build_team_row,
        topics=(
            rows.TEAM_TOPIC,
            rows.JOINT_STEP_TOPIC,
            rows.PICTURE_CORRECTION_TOPIC,
            rows.LATE_TOPIC,
            rows.SEAT_TOPIC,
            rows.SEEN_TOPIC,
        ),
    ),
    ActivityTable("absences", ABSENCES, {SeatSeen: _build_absence_row}, topics=(rows.SEEN_TOPIC,)),
    ActivityTable("joint_steps", JOINT_STEPS, {JointStepped: _build_joint_step_row}, topics=(rows.JOINT_STEP_TOPIC,)),
)
