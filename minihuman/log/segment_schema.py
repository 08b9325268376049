"""Which schema version a segment needs: the lowest whose readers read all of it right, known from its plan.

Version 2 is read by every release since the first that wrote it. Version 3 adds what a reader of 2 would misread; a
segment that cannot hold any of it stays 2, so that older releases go on reading it.
"""

from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.names import PLAIN_SCHEMA_VERSION, SCHEMA_VERSION
from minihuman.worlds.outcomes import LAST_REWARD


def find_schema_version(plan: SessionPlan) -> int:
    """Find the schema version of a segment with this plan; each rule names what a reader of 2 would misread."""
    if has_outcome_rules(plan):
        return SCHEMA_VERSION
    return PLAIN_SCHEMA_VERSION


def has_outcome_rules(plan: SessionPlan) -> bool:
    """Tell whether an end may mean something else than the last reward says: ``ended``, or a goal at a step limit."""
    return any(episode.outcome_rule != LAST_REWARD for episode in plan.episodes)
