"""The schema version that a segment needs: the lowest whose readers read all of it correctly, as its plan shows.

Version 2 is read by every release since the first that wrote it. Version 3 adds what a reader of version 2 would
misread. A segment that cannot contain any of that stays at version 2, so that older releases can still read it.
"""

from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.names import PLAIN_SCHEMA_VERSION, SCHEMA_VERSION
from minihuman.worlds.outcomes import LAST_REWARD


def find_schema_version(plan: SessionPlan) -> int:
    """Return the schema version of a segment, which depends on what a reader of version 2 would misread in it."""
    if has_outcome_rules(plan):
        return SCHEMA_VERSION
    return PLAIN_SCHEMA_VERSION


def has_outcome_rules(plan: SessionPlan) -> bool:
    """Return whether an outcome may differ from what the last reward says: ``ended``, or a goal at a step limit."""
    return any(episode.outcome_rule != LAST_REWARD for episode in plan.episodes)
