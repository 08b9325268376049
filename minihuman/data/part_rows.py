"""What a session's parts hold beside play, as rows: answers and their changes, parts, pages, points, inputs."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from minihuman.data.rows import Part
from minihuman.recorded.episode import SessionLog
from minihuman.recorded.segment import PartEvent
from minihuman.study.events import (
    AnswerChanged,
    Answered,
    ClauseDone,
    EpisodesSkipped,
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


_MAKERS: Mapping[str, Callable[[PartEvent, SessionLog], _Row | None]] = {
    "answers": _answer,
    "answer_changes": _change,
    "parts": _part,
    "pages": _page,
    "points": _points,
    "clauses": _clause,
    "other_inputs": _input,
}
