"""Compares answers to questions with the exclusion rules about them."""

import json
from collections.abc import Collection
from typing import Any

from minihuman.experiment.machine.events import Answered
from minihuman.experiment.protocol.model import ExclusionSpec
from minihuman.log.model.session_log import SessionLog


def breaks_answer_rule(answer: Any, rule: ExclusionSpec) -> bool:
    """Return whether an exclusion rule excludes a logged answer: a number, a text, a list of codes, or None.

    None means that the question was not answered. Of several chosen codes, a single one in ``is_one_of`` excludes the
    answer, and a single one in ``is_none_of`` satisfies that condition.
    """
    if answer is None:
        return rule.is_missing
    codes = answer if isinstance(answer, list) else [answer]
    if any(code in rule.is_one_of for code in codes):
        return True
    if rule.is_none_of and not any(code in rule.is_none_of for code in codes):
        return True
    return isinstance(answer, int | float) and is_outside(answer, rule)


def is_outside(number: float, rule: ExclusionSpec) -> bool:
    """Return whether a number lies outside the range that a rule allows."""
    return (rule.below is not None and number < rule.below) or (rule.above is not None and number > rule.above)


def list_compared_answers(log: SessionLog, measures: Collection[str]) -> dict[str, list[Any]]:
    """Return the answers of a session that exclusion rules compare, by measure.

    A measure has one answer per part of the session that asked the question, or an empty list if no part has one. If
    the same part was answered several times, the last answer replaces the earlier ones.

    Args:
        log: the session's log.
        measures: the names of the answers, ``answer:PART.ITEM``.
    """
    answers: dict[str, dict[int, Any]] = {measure: {} for measure in measures}
    if not answers:
        return {}
    for event in log.part_events:
        if isinstance(event, Answered) and (measure := f"answer:{event.part_name}.{event.item}") in answers:
            answers[measure][event.part] = json.loads(event.value)
    return {measure: list(by_part.values()) for measure, by_part in answers.items()}
