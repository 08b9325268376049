"""Questionnaires as BIDS phenotypes: a table a questionnaire, a row a session, a column an item.

A row is known by participant and session alone, so what is asked for the second time in a session has columns of its
own: ``mental`` and ``mental_2``.
"""

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from minihuman.errors import ExportError
from minihuman.export.bids.files import label, write_json, write_tsv
from minihuman.recorded.episode import SessionLog
from minihuman.study.activities.questions import QuestionsPlan
from minihuman.study.events import Answered

_IDS = ("participant_id", "session_id")


class Phenotype:
    """The answers of a dataset's sessions, by questionnaire; the same name in several parts is one questionnaire."""

    def __init__(self) -> None:
        self._rows: dict[str, list[dict[str, Any]]] = {}
        self._meaning: dict[str, dict[str, Any]] = {}  # of each questionnaire's columns
        self._names: dict[str, str] = {}  # what each label stands for

    def add(self, log: SessionLog, who: str, session: str) -> None:
        """Take a session's answers: of what was asked again, the last."""
        given = {(event.part, event.item): event for event in _answers(log)}
        asked = Counter[str]()
        rows: dict[str, dict[str, Any]] = {}
        for number, part in enumerate(log.plan.parts):
            if not isinstance(part.plan, QuestionsPlan):
                continue
            asked[part.name] += 1
            self._describe(part.name, part.plan, asked[part.name])
            answers = {item: _value(event) for (of_part, item), event in given.items() if of_part == number}
            if answers:
                row = rows.setdefault(part.name, dict(zip(_IDS, (who, session), strict=True)))
                row |= {_column(item, asked[part.name]): value for item, value in answers.items()}
        for name, row in rows.items():
            self._rows.setdefault(name, []).append(row)

    def write(self, out: Path) -> tuple[Path, ...]:
        """Write every questionnaire that somebody answered, and what its columns mean."""
        folder = out / "phenotype"
        for name, rows in self._rows.items():
            meaning = self._meaning[name]
            columns = [*_IDS, *(column for column in meaning if column != "MeasurementToolMetadata")]
            write_tsv(folder / f"{label(name)}.tsv", columns, rows)
            write_json(folder / f"{label(name)}.json", meaning)
        return (folder,) if self._rows else ()

    def _describe(self, name: str, plan: QuestionsPlan, time: int) -> None:
        """Say what a questionnaire's columns mean; of groups that are asked in other words, the first's words.

        Raises:
            ExportError: if another questionnaire's name makes the same label.
        """
        if self._names.setdefault(label(name), name) != name:
            raise ExportError(f"questions {self._names[label(name)]!r} and {name!r} are one file in BIDS; rename one")
        meaning = self._meaning.setdefault(name, {"MeasurementToolMetadata": {"Description": plan.title or name}})
        for item in plan.items:
            again = "" if time == 1 else f" (time {time} in the session)"
            described: dict[str, Any] = {"Description": f"{item.ask}{again}"}
            if item.options:
                described["Levels"] = dict(zip(map(str, item.all_codes), item.options, strict=False))
            if item.unit:
                described["Units"] = item.unit
            meaning.setdefault(_column(item.name, time), described)


def _answers(log: SessionLog) -> list[Answered]:
    return [event for segment in log.segments for event in segment.part_events if isinstance(event, Answered)]


def _column(item: str, time: int) -> str:
    """An item's column: none that BIDS needs for its own."""
    name = f"item_{item}" if item in _IDS else item
    return name if time == 1 else f"{name}_{time}"


def _value(event: Answered) -> Any:
    """The option's code, the number or the text; several codes as a JSON list."""
    value: Any = json.loads(event.value)
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list | Mapping) else value
