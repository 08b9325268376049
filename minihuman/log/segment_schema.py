"""The schema version that a segment needs: the lowest whose readers read all of it correctly, according to its plan.

Version 2 is read by every release since the first that wrote it. Version 3 adds content that a reader of version 2
would misread. A segment that cannot have such content stays at version 2, so that older releases can still read it.
"""

from collections.abc import Mapping

from minihuman.experiment.machine.inputs import MESSAGE_RULES, TEXT_RULES
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.names import PLAIN_SCHEMA_VERSION, SCHEMA_VERSION
from minihuman.worlds.outcomes import LAST_REWARD


def find_schema_version(plan: SessionPlan, facts: Mapping[str, str]) -> int:
    """Return the schema version of a segment, which is higher if a reader of version 2 would misread the segment.

    Args:
        plan: the session's plan.
        facts: the facts about the station, which state by what rules texts are logged.
    """
    if has_outcome_rules(plan) or has_timelines(plan) or records_whole_texts(plan, facts):
        return SCHEMA_VERSION
    return PLAIN_SCHEMA_VERSION


def has_outcome_rules(plan: SessionPlan) -> bool:
    """Return whether any episode's outcome is decided by another rule than its last reward.

    Examples are the outcome ``ended``, and a goal that is reached at the step limit.
    """
    return any(episode.outcome_rule != LAST_REWARD for episode in plan.episodes)


def has_timelines(plan: SessionPlan) -> bool:
    """Return whether a trial's pictures may come from a timeline instead of its world's steps."""
    return any(getattr(part.plan, "timeline", None) for part in plan.parts)


def records_whole_texts(plan: SessionPlan, facts: Mapping[str, str]) -> bool:
    """Return whether answers or messages are logged as whole texts, from which a replay restores them.

    Args:
        plan: the session's plan.
        facts: the facts about the station, which state by what rules texts are logged.
    """
    has_whole_answers = facts.get("text_rules", "1") == TEXT_RULES and _has_part_with(plan, "has_text_fields")
    has_whole_messages = facts.get("message_rules", "1") == MESSAGE_RULES and _has_part_with(plan, "has_text_entry")
    return has_whole_answers or has_whole_messages


def _has_part_with(plan: SessionPlan, name: str) -> bool:
    """Return whether any part's plan has a property of this name that is true."""
    return any(getattr(part.plan, name, False) for part in plan.parts)
