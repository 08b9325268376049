"""What a session's parts hold beside play, as rows: answers and their changes, parts, pages, points, inputs."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from minihuman.data.rows import Part
from minihuman.recorded.episode import SessionLog
from minihuman.recorded.segment import PartEvent
from minihuman.study.activities.agent_events import Advised, ControlChanged, LearnerAsked, PolicyGiven, Rated
from minihuman.study.activities.correction_events import CorrectionBegun
from minihuman.study.activities.pair_events import Preferred
from minihuman.study.events import (
    AnswerChanged,
    Answered,
    ClauseDone,
    EpisodesSkipped,
    Linked,
    PageShown,
    PartEnded,
    PartStarted,
    PointerUsed,
    Scored,
    TextTyped,
)

_Row = dict[str, Any]
_MS = 1e-6


def part_rows(log: SessionLog, who: Mapping[str, Any], *, wanted: bool = True) -> dict[str, Part]:
    """The rows of these tables, none where the session is not wanted."""
    found: dict[str, list[_Row]] = {table: [] for table in _MAKERS}
    for segment in log.segments if wanted else ():
        for event in segment.part_events:
            for table, make in _MAKERS.items():
                row = make(event, log)
                if row is not None:
                    found[table].append({**who, "segment": segment.number, "t_ns": event.t_ns, **row})
    return {table: Part.of(rows) for table, rows in found.items()}


def _answer(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, Answered):
        return None
    value = json.loads(event.value)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    told = value if isinstance(value, str) else "" if value is None else json.dumps(value, ensure_ascii=False)
    return {
        "part": event.part + 1,
        "questions": event.part_name,
        "item": event.item,
        "kind": event.kind,
        "attempt": event.attempt,
        "answer": told,
        "number": float(value) if is_number else None,
        "said": event.words,
        "right": event.right,
        "shown_ns": event.shown_ns or None,
        "first_ms": (event.first_ns - event.shown_ns) * _MS if event.first_ns and event.shown_ns else None,
        "answer_ms": (event.t_ns - event.shown_ns) * _MS if event.shown_ns else None,
        "changes": event.changes,
    }


def _change(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, AnswerChanged):
        return None
    return {"part": event.part + 1, "item": event.item, "answer": event.value}


def _part(event: PartEvent, log: SessionLog) -> _Row | None:
    match event:
        case PartStarted():
            return {"part": event.part + 1, "what": "started", "kind": event.kind, "name": event.name, "next": None}
        case PartEnded():
            its = log.plan.parts[event.part]
            return {
                "part": event.part + 1,
                "what": event.end,
                "kind": its.kind,
                "name": its.name,
                "next": event.next + 1,
            }
    return None


def _page(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, PageShown):
        return None
    name = log.plan.parts[event.part].name
    times = {"submit_ns": event.submit_ns, "flip_ns": event.flip_ns}
    return {"part": event.part + 1, "name": name, "page": event.page, "pages": event.pages, **times}


def _points(event: PartEvent, log: SessionLog) -> _Row | None:
    match event:
        case Scored():
            return {
                "episode": event.episode + 1,
                "points": event.points,
                "total": event.total,
                "skipped": None,
                "why": "",
            }
        case EpisodesSkipped():
            return {
                "episode": event.first + 1,
                "points": None,
                "total": None,
                "skipped": event.count,
                "why": event.reason,
            }
    return None


def _clause(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, ClauseDone):
        return None
    return {"episode": event.episode + 1, "step": event.step, "clause": event.clause + 1, "text": event.text}


def _input(event: PartEvent, log: SessionLog) -> _Row | None:
    match event:
        case TextTyped():
            return {"what": "typed", "text": event.text, "target": "", "x": None, "y": None, "along": None}
        case PointerUsed():
            place = {"x": event.x, "y": event.y, "along": event.along}
            return {"what": event.what, "text": "", "target": event.target, **place}
    return None


def _link(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, Linked):
        return None
    return {
        "offset_ms": event.offset_ns * _MS,
        "error_ms": event.error_ns * _MS,
        "rtt_ms": event.rtt_ns * _MS,
        "least_rtt_ms": event.least_rtt_ns * _MS,
        "drift_ppm": event.drift_ppm,
    }


def _policy(event: PartEvent, log: SessionLog) -> _Row | None:
    match event:
        case LearnerAsked():
            its = {"what": "asked", "policy": "", "failure": ""}
        case PolicyGiven():
            its = {"what": "failed" if event.failure else "given", "policy": event.policy, "failure": event.failure}
        case _:
            return None
    return {"part": event.part + 1, "episode": event.episode + 1, **its}


def _advice(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, Advised):
        return None
    said = json.dumps([round(chance, 9) for chance in event.probabilities])
    return {"episode": event.episode + 1, "step": event.step, "policy_action": event.action, "probabilities": said}


def _control(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, ControlChanged):
        return None
    its = {"who": event.who, "reason": event.reason, "pressed_ns": event.pressed_ns}
    return {"episode": event.episode + 1, "step": event.step, **its}


def _rating(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, Rated):
        return None
    its = {"value": event.value, "pressed_ns": event.pressed_ns}
    return {"episode": event.episode + 1, "step": event.step, **its}


def _correction(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, CorrectionBegun):
        return None
    found = next((its for its in log.corrections if its.part == event.part and its.t_ns[0] == event.t_ns), None)
    if found is None:
        return None
    return {
        "part": event.part + 1,
        "correction": event.correction + 1,
        "episode": event.episode + 1,
        "attempt": event.attempt,
        "step": event.step,
        "steps": len(found.actions),
        "outcome": found.outcome,
        "actions": json.dumps(found.actions.tolist()),
        "key_t_ns": json.dumps(found.key_t_ns.tolist()),
    }


def _preference(event: PartEvent, log: SessionLog) -> _Row | None:
    if not isinstance(event, Preferred):
        return None
    compared = next((its for its in log.comparisons if its.said is event), None)
    if compared is None:
        return None
    sides = {
        f"{side}_{name}": value
        for side, stretch in (("left", compared.left), ("right", compared.right))
        for name, value in (
            ("episode", stretch.episode + 1),
            ("attempt", stretch.attempt),
            ("first", stretch.first),
            ("last", stretch.last),
        )
    }
    return {
        "part": event.part + 1,
        "pair": event.pair + 1,
        **sides,
        "answer": event.answer,
        "shown_ns": event.shown_ns or None,
        "answer_ms": compared.answer_ms if event.shown_ns else None,
        "replays": event.replays,
    }


_MAKERS: Mapping[str, Callable[[PartEvent, SessionLog], _Row | None]] = {
    "answers": _answer,
    "answer_changes": _change,
    "parts": _part,
    "pages": _page,
    "points": _points,
    "clauses": _clause,
    "other_inputs": _input,
    "links": _link,
    "policies": _policy,
    "advice": _advice,
    "controls": _control,
    "ratings": _rating,
    "corrections": _correction,
    "preferences": _preference,
}
