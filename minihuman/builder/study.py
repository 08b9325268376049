"""A study folder that is open for editing. The file on disk is the truth; nothing else is kept of its content."""

import hashlib
import tomllib
from pathlib import Path
from typing import Any

from minihuman.builder.messages import (
    Document,
    Lane,
    Mistake,
    Part,
    Pay,
    Refusal,
    Restrictions,
    Studies,
    StudyCard,
)
from minihuman.errors import MinihumanError, ProtocolError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.validation_errors import TomlLines
from minihuman.web.server.desk import StudyEntry, find_studies

MAX_PROTOCOL_BYTES = 2**20


class EditRefusedError(MinihumanError, ValueError):
    """A request that was not carried out.

    Attributes:
        refusal: what the page is answered.
    """

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.message)
        self.refusal = refusal


class StudyFolder:
    """The studies of a folder.

    Args:
        folder: the folder of the protocols.
        data: the folder of the studies' data.
    """

    def __init__(self, folder: Path, data: Path) -> None:
        self._folder = folder
        self._data = data

    def list_studies(self) -> Studies:
        """Describe every study of the folder, and the templates."""
        cards = [self._describe(entry) for entry in find_studies(self._folder, self._data)]
        return Studies(self._folder.resolve().name, cards, [])

    def open(self, key: str) -> "OpenStudy":
        """Open a study.

        Raises:
            EditRefusedError: if there is no such file.
        """
        for entry in find_studies(self._folder, self._data):
            if entry.key == key and entry.protocol is not None:
                return OpenStudy(entry)
        raise EditRefusedError(Refusal("not_there", f"there is no study {key!r} in this folder"))

    def _describe(self, entry: StudyEntry) -> StudyCard:
        tree: dict[str, Any] = {}
        mistakes = 0
        if entry.protocol is not None:
            document = OpenStudy(entry).read()
            tree = document.tree
            mistakes = len(document.mistakes)
        study = tree.get("study", {})
        return StudyCard(
            key=entry.key,
            name=entry.name,
            title=tree.get("about", {}).get("title", "") or entry.name,
            language=study.get("language", "en"),
            groups=[group.get("name", "") for group in tree.get("groups", [])],
            parts=_list_parts(tree, {}),
            lanes=_list_lanes(tree),
            minutes=None,
            participants=study.get("participants", 100),
            enrolled=0,
            sessions=dict(entry.counts()),
            mistakes=mistakes,
            problem=entry.problem,
            has_protocol=entry.protocol is not None,
        )


class OpenStudy:
    """A protocol file that is open in the builder."""

    def __init__(self, entry: StudyEntry) -> None:
        assert entry.protocol is not None
        self._entry = entry
        self._path = entry.protocol

    def read(self) -> Document:
        """Read the file and describe it."""
        content = self._path.read_bytes()
        text = content.decode("utf-8-sig", errors="replace")
        try:
            tree = tomllib.loads(text)
        except tomllib.TOMLDecodeError:
            tree = {}
        bonus = tree.get("bonus")
        pay = None
        if isinstance(bonus, dict):
            pay = Pay(bonus.get("currency", ""), bonus.get("base", 0.0), bonus.get("per_point", 0.0), bonus.get("most"))
        lines = TomlLines(text)
        return Document(
            key=self._entry.key,
            name=self._entry.name,
            version=hashlib.sha256(content).hexdigest(),
            text=text,
            tree=tree,
            lines={},
            parts=_list_parts(tree, lines),
            lanes=_list_lanes(tree),
            mistakes=_find_mistakes(content, lines),
            restrictions=Restrictions(0, [], ""),
            durations=[],
            pay=pay,
            can_undo=False,
            can_redo=False,
            trusted=True,
            read_only=[],
        )


def _find_mistakes(content: bytes, lines: TomlLines) -> list[Mistake]:
    try:
        decode_protocol(content)
    except ProtocolError as error:
        if error.field_errors:
            return [Mistake(_split(path), lines.of(path), message) for path, message in error.field_errors]
        return [Mistake([], 1, str(error))]
    return []


def _split(path: str) -> list[str | int]:
    steps: list[str | int] = []
    for step in path.removeprefix("$").replace("[", ".[").split("."):
        if step.startswith("["):
            steps.append(int(step[1:-1]))
        elif step:
            steps.append(step)
    return steps


_ARRAYS = {"blocks": "play", "pages": "page", "questions": "questions", "activities": "activity", "orders": "order"}


def _list_parts(tree: dict[str, Any], lines: Any) -> list[Part]:
    parts = []
    for table, usual_kind in _ARRAYS.items():
        for number, row in enumerate(tree.get(table, [])):
            kind = usual_kind
            if table in ("blocks", "activities"):
                kind = row.get("kind", usual_kind)
            line = lines.of(f"$.{table}[{number}]") if lines else 1
            parts.append(Part(row.get("name", ""), kind, [table, number], row.get("title", ""), [], line))
    return parts


def _list_lanes(tree: dict[str, Any]) -> list[Lane]:
    lanes = []
    for number, group in enumerate(tree.get("groups", [])):
        replaced = group.get("replace_parts", {})
        name = group.get("name", "")
        for session_number, session in enumerate(tree.get("sessions", [])):
            path: list[str | int] = ["sessions", session_number, "parts"]
            lanes.append(Lane(name, session.get("name", ""), session.get("parts", []), path, replaced))
        if not tree.get("sessions"):
            field = "parts" if "parts" in group else "blocks"
            lanes.append(Lane(name, "", group.get(field, []), ["groups", number, field], replaced))
    return lanes
