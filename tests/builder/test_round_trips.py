"""Round trips: protocols in any style, changed and changed back; edits by the builder and an editor in turn."""

import random
import re
import tomllib
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from minihuman.builder.document import NotEditableError, TomlDocument, is_same_value
from minihuman.builder.edit_errors import EditRefusedError
from minihuman.builder.messages import Edit
from minihuman.builder.study_folder import OpenStudy, StudyFolder
from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.protocol import decode_protocol
from tests.builder.test_document import PROTOCOLS, walk
from tests.counts import count

N_MUTATED = count(30, 300)
N_EDITS = count(30, 1000)
TEXTS = ("other", "", 'a "quoted" word', "back\\slash", "two\nlines", "ünï 漢字 \U0001f600", "it's", "tab\there")
COMMENTS = ("\n", "# a comment\n", "  # [not] = a table\n", "\t\n", "#\n\n")


def restyle(literal: str, choose: random.Random) -> str:
    """Write a scalar in another way that means the same."""
    if re.fullmatch(r"-?\d+\.\d+", literal):
        return f"{literal}{choose.choice(['0', '00', 'e0'])}"
    if re.fullmatch(r"[1-9]\d+", literal):
        return f"{literal[0]}_{literal[1:]}"
    if re.fullmatch(r'"[^"\\\n\']*"', literal):
        return choose.choice([f"'{literal[1:-1]}'", f'"""{literal[1:-1]}"""', f"'''\n{literal[1:-1]}'''"])
    return literal


def mutate_style(text: str, choose: random.Random) -> str:
    """Write the same values in another style: quotes, numbers, comments, blank lines, indents, line ends."""
    spans = TomlDocument.parse(text).spans
    scalars = [span for span in spans.values.values() if span.form == "scalar" and choose.random() < 0.3]
    for span in sorted(scalars, key=lambda span: -span.begin):
        literal = restyle(text[span.begin : span.end], choose)
        candidate = f"{text[: span.begin]}{literal}{text[span.end :]}"
        with suppress(tomllib.TOMLDecodeError):  # lines in an inline table
            tomllib.loads(candidate)
            text = candidate
    spans = TomlDocument.parse(text).spans
    insertions = []
    for section in spans.sections:
        insertions += [(section.begin, choose.choice(COMMENTS))] * (choose.random() < 0.3)
        for pair in section.pairs:
            insertions += [(pair.begin, choose.choice((*COMMENTS, "  ", "\t")))] * (choose.random() < 0.2)
            insertions += [(pair.value_end, choose.choice(("  # a note", " ", "#")))] * (choose.random() < 0.2)
    for position, insertion in sorted(insertions, reverse=True):
        text = f"{text[:position]}{insertion}{text[position:]}"
    return choose.choice([text, text.replace("\n", "\r\n"), text.rstrip("\n"), f"\ufeff{text}"])


def choose_value(value: Any, choose: random.Random) -> Any:
    """Return another value for a field, mostly of its type."""
    match value:
        case bool():
            return not value
        case int():
            return value + choose.randrange(1, 9)
        case float():
            return value + choose.choice([0.5, 1, 1e-7])
        case str():
            return choose.choice([text for text in TEXTS if text != value])
        case list() if value:
            return [*value, deepcopy(value[0])]
        case dict():
            return {**value, "a new field": choose.choice([1, 2.5, "text", [1, 2]])}
    return "another"


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("seed", range(N_MUTATED))
def test_one_field_of_a_mutated_protocol_changed_and_changed_back_leaves_every_byte(seed: int) -> None:
    choose = random.Random(seed)
    path = PROTOCOLS[seed % len(PROTOCOLS)]
    text = mutate_style(path.read_text(encoding="utf-8"), choose)
    document = TomlDocument.parse(text)
    assert is_same_value(document.tree, tomllib.loads(path.read_text(encoding="utf-8")))
    fields = [(field, value) for field, value in walk(document.tree) if document.literal(field)]
    field, value = choose.choice(fields)
    other = choose_value(value, choose)
    edited = document.set(field, other)
    assert is_same_value(edited.find(field), other)
    assert edited.text != text
    back = edited.set(field, value, document.literal(field))
    assert back.text == text
    assert back.text.encode() == text.encode()


def find_mistakes(text: str) -> list[str]:
    """Return what `check` says of a text, without lines and without the tables that it quotes."""
    try:
        decode_protocol(text.encode(), "study")
    except ProtocolError as error:
        mistakes = getattr(error, "field_errors", ()) or error.mistakes or (str(error),)
        return sorted(re.sub(r"is \{.*", "is a table", str(mistake)) for mistake in mistakes)
    return []


class TwoWriters:
    """A study that the builder and an editor change in turn, and the values that it should have."""

    def __init__(self, study: OpenStudy, choose: random.Random) -> None:
        self.study = study
        self.choose = choose
        self.document = TomlDocument.parse(study.path.read_text(encoding="utf-8"))
        self.expected = deepcopy(self.document.tree)
        self.comments: set[str] = set()

    def edit_in_builder(self) -> None:
        """Set, add or remove a field, or move or copy an element, through the builder."""
        path, value = self.choose.choice(list(walk(self.expected)))
        other = choose_value(value, self.choose)
        edit = Edit("set", list(path), other)
        outcome = deepcopy(self.expected)
        parent = self._parent(outcome, path)
        if isinstance(path[-1], int) and self.choose.random() < 0.5:
            to = self.choose.randrange(len(parent))
            edit = Edit("move", list(path), to=to)
            parent.insert(to, parent.pop(path[-1]))
        else:
            parent[path[-1]] = other
        with suppress(EditRefusedError):
            self.study.edit(self.study.version(), [edit])
            self.expected = outcome

    def edit_by_hand(self, number: int) -> None:
        """Write a comment and another value into the file, as an editor does."""
        text = self.study.path.read_text(encoding="utf-8")
        document = TomlDocument.parse(text)
        section = self.choose.choice(document.spans.sections)
        comment = f"# note {number} by hand"
        text = f"{text[: section.begin]}{comment}\n\n{text[section.begin :]}"
        self.comments.add(comment)
        field = ("study", "seed")
        self.expected["study"]["seed"] = number
        self.study.path.write_text(TomlDocument.parse(text).set(field, number).text, encoding="utf-8")

    @staticmethod
    def _parent(tree: Any, path: tuple[str | int, ...]) -> Any:
        for step in path[:-1]:
            tree = tree[step]
        return tree


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("name", ["two-days", "team", "stroop"])
def test_edits_by_the_builder_and_an_editor_in_turn_lose_nothing(name: str, tmp_path: Path) -> None:
    source = next(path for path in PROTOCOLS if path.stem == name and "readers" not in path.parts)
    (tmp_path / "study.toml").write_bytes(source.read_bytes())
    choose = random.Random(name)
    writers = TwoWriters(StudyFolder(tmp_path, tmp_path / "sessions").open("study.toml"), choose)
    if name == "stroop":  # of inline tables
        assert "study = {" in writers.document.text
    for number in range(N_EDITS // 3):
        writers.edit_in_builder()
        if choose.random() < 0.3:
            writers.edit_by_hand(number)
        text = writers.study.path.read_text(encoding="utf-8")
        assert is_same_value(tomllib.loads(text), writers.expected)
        assert all(comment in text for comment in writers.comments)
    plain = TomlDocument.parse("")
    for table, value in writers.expected.items():
        with suppress(NotEditableError):
            plain = plain.set((table,), value)
    assert is_same_value(plain.tree, writers.expected)
    assert find_mistakes(plain.text) == find_mistakes(text)


def test_versions_of_all_edits_can_be_gone_through_backwards(tmp_path: Path) -> None:
    source = next(path for path in PROTOCOLS if path.stem == "team" and "readers" not in path.parts)
    file = tmp_path / "study.toml"
    file.write_bytes(source.read_bytes())
    writers = TwoWriters(StudyFolder(tmp_path, tmp_path / "sessions").open("study.toml"), random.Random(4))
    contents = [file.read_bytes()]
    for _ in range(12):
        writers.edit_in_builder()
        if file.read_bytes() != contents[-1]:
            contents.append(file.read_bytes())
    for content in reversed(contents[:-1]):
        writers.study.undo(writers.study.version())
        assert file.read_bytes() == content
    for content in contents[1:]:
        writers.study.redo(writers.study.version())
        assert file.read_bytes() == content
