"""Tables of answers: each answer given, and each change before it."""

import json

from minihuman.activities.questions.columns import ANSWER_CHANGES, ANSWERS
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.experiment.machine.events import AnswerChanged, Answered, TextChanged
from minihuman.log import topics
from minihuman.log.model.session_log import SessionLog

_MS_PER_NS = 1e-6


def _build_answer_row(event: Answered, log: SessionLog) -> TableRow:
    answer = json.loads(event.value)
    is_number = isinstance(answer, int | float) and not isinstance(answer, bool)
    return {
        "part": event.part + 1,
        "questions": event.part_name,
        "item": event.item,
        "kind": event.kind,
        "attempt": event.attempt,
        "answer": _format_answer(answer),
        "number": float(answer) if is_number else None,
        "said": event.words,
        "right": event.right,
        "shown_ns": event.shown_ns or None,
        "first_ms": _find_latency_ms(event.shown_ns, event.first_ns),
        "answer_ms": _find_latency_ms(event.shown_ns, event.t_ns),
        "changes": event.changes,
    }


def _find_latency_ms(shown_ns: int, t_ns: int) -> float | None:
    """Return the milliseconds since a question's display; None if either time is 0, which means unknown."""
    if not shown_ns or not t_ns:
        return None
    return (t_ns - shown_ns) * _MS_PER_NS


def _format_answer(answer: object) -> str:
    """Return an answer as text: a text as it is, "" for no answer, and JSON for anything else."""
    if isinstance(answer, str):
        return answer
    if answer is None:
        return ""
    return json.dumps(answer, ensure_ascii=False)


def _build_change_row(event: AnswerChanged, log: SessionLog) -> TableRow:
    return {"part": event.part + 1, "item": event.item, "answer": event.value, "how": "", "keys": None}


def _build_text_row(event: TextChanged, log: SessionLog) -> TableRow:
    answer = json.dumps(event.text, ensure_ascii=False)
    how = " ".join(event.changes)
    return {"part": event.part + 1, "item": event.item, "answer": answer, "how": how, "keys": event.keys}


QUESTION_TABLES = (
    ActivityTable("answers", ANSWERS, {Answered: _build_answer_row}, topics=(topics.ANSWER,)),
    ActivityTable(
        "answer_changes",
        ANSWER_CHANGES,
        {AnswerChanged: _build_change_row, TextChanged: _build_text_row},
        topics=(topics.ANSWER_CHANGE, topics.ANSWER_TEXT),
    ),
)
