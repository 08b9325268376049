"""Tables of blocks of episodes: points, skipped episodes, subgoals, and the decisions of adaptive designs."""

import json

from minihuman.activities.play.columns import DECISIONS, POINTS, SUBGOALS
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.experiment.machine.events import ClauseDone, DesignDecided, EpisodesSkipped, Scored
from minihuman.log import topics
from minihuman.log.model.session_log import SessionLog


def _build_points_row(event: Scored, log: SessionLog) -> TableRow:
    return {"episode": event.episode + 1, "points": event.points, "total": event.total, "skipped": None, "why": ""}


def _build_skip_row(event: EpisodesSkipped, log: SessionLog) -> TableRow:
    """Build the row of skipped episodes in the table of points."""
    return {
        "episode": event.first + 1,
        "points": None,
        "total": None,
        "skipped": event.count,
        "why": event.reason,
    }


def _build_subgoal_row(event: ClauseDone, log: SessionLog) -> TableRow:
    return {"episode": event.episode + 1, "step": event.step, "clause": event.clause + 1, "text": event.text}


def _build_decision_row(event: DesignDecided, log: SessionLog) -> TableRow:
    return {
        "part": event.part + 1,
        "block": log.plan.parts[event.part].name,
        "episode": event.episode + 1,
        "design": event.design,
        "design_version": event.version,
        "options": json.dumps(event.options, sort_keys=True),
        "seed": event.seed,
        "stop": event.stop,
        "estimates": json.dumps(event.estimates, sort_keys=True),
        "posterior": f"{event.posterior:016x}",
    }


PLAY_TABLES = (
    ActivityTable(
        "points",
        POINTS,
        {Scored: _build_points_row, EpisodesSkipped: _build_skip_row},
        topics=(topics.POINTS, topics.SKIP),
    ),
    ActivityTable("clauses", SUBGOALS, {ClauseDone: _build_subgoal_row}, topics=(topics.CLAUSE,)),
    ActivityTable("decisions", DECISIONS, {DesignDecided: _build_decision_row}, topics=(topics.DESIGN,)),
)
