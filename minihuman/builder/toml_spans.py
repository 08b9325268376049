"""Where each table, key and value of a TOML text stands: spans of characters by path.

`tomllib` says what a text means, but not where. docs/decisions/toml-spans.md has why no library is used: tomlkit writes
1.50 as 1.5 and misplaces new fields, and tree-sitter's grammar would add two compiled packages for what 240 lines do.
The scanner reads only what `tomllib` has accepted, so it decides nothing of validity.
"""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

Steps = tuple[str | int, ...]

_SPACE = re.compile(r"[ \t]*")
_BLANKS = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")  # between the elements of an array
_LINE_END = re.compile(r"[^\n]*\n?")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_STRING = re.compile(
    r'"""(?:[^\\"]|\\.|"{1,2}(?!"))*"{3,5}'
    r"|'''(?:[^']|'{1,2}(?!'))*'{3,5}"
    r'|"(?:[^"\\\n]|\\.)*"'
    r"|'[^'\n]*'",
    re.DOTALL,
)
_SCALAR = re.compile(r"\d{4}-\d\d-\d\d(?:[Tt ]\d[^\s,\]}#]*)?|[^\s,\]}#]+")


@dataclass(frozen=True, slots=True)
class Value:
    """The span of a value, and the position at which its key or, in an array, the value itself begins."""

    begin: int
    end: int
    form: Literal["scalar", "array", "table"]
    member_begin: int  # where the key begins; ``begin`` for an element of an array


@dataclass(frozen=True, slots=True)
class Pair:
    """A statement ``key = value`` with its lines."""

    path: Steps
    begin: int  # of the first line
    end: int  # behind the last line
    value_end: int
    section: int  # index of the section that contains it


@dataclass(slots=True)
class Section:
    """A table's header with the statements below it; the first section of a text has no header."""

    path: Steps
    is_element: bool  # of an array of tables: [[path]]
    begin: int  # of the header's line
    header_end: int  # behind the header's line
    content_end: int  # behind its last statement's line
    pairs: list[Pair] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Spans:
    """The spans of a TOML text.

    Attributes:
        sections: the tables that have headers, in the order of the text, after the text's beginning.
        values: every value by path, those inside arrays and inline tables included.
    """

    text: str
    sections: list[Section]
    values: dict[Steps, Value]

    def find_line(self, position: int) -> int:
        """Return the number of the line that contains a position, from 1."""
        return self.text.count("\n", 0, position) + 1

    def position_of(self, path: Steps) -> int:
        """Return where a path, or the nearest table around it, begins in the text; 0 if neither is written."""
        positions = self.positions()
        while path and path not in positions:
            path = path[:-1]
        return positions.get(path, 0)

    def positions(self) -> dict[Steps, int]:
        """Return the position in the text at which each field, table and element begins, by path."""
        positions = {path: value.member_begin for path, value in self.values.items()}
        for section in self.sections[1:]:
            for length in range(len(section.path), 0, -1):
                positions.setdefault(section.path[:length], section.begin)
        for section in self.sections:
            for pair in section.pairs:
                for length in range(len(pair.path), len(section.path), -1):
                    positions.setdefault(pair.path[:length], pair.begin)
        return positions


class _Scanner:
    """Scans a valid TOML text once, from its beginning to its end."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.position = 0
        if text.startswith("\ufeff"):
            self.position = 1
        self.sections = [Section((), False, self.position, self.position, self.position)]
        self.values: dict[Steps, Value] = {}
        self._counts: dict[Steps, int] = {}  # of the elements of each array of tables

    def scan(self) -> Spans:
        """Scan the whole text, and return the spans of its tables and values."""
        while self.position < len(self.text):
            begin = self.position
            self._skip(_SPACE)
            match self.text[self.position : self.position + 1]:
                case "[":
                    self._scan_header(begin)
                case "" | "\n" | "\r" | "#":
                    self._skip(_LINE_END)
                case _:
                    self._scan_pair(begin)
        return Spans(self.text, self.sections, self.values)

    def _skip(self, pattern: re.Pattern[str]) -> str:
        """Move behind the match of a pattern, which must match at the present position, and return the matched text."""
        match = pattern.match(self.text, self.position)
        assert match is not None, f"position {self.position} of a text that tomllib accepts"
        self.position = match.end()
        return match.group()

    def _scan_header(self, begin: int) -> None:
        is_element = self.text.startswith("[[", self.position)
        self.position += 2 if is_element else 1
        keys = self._scan_keys()
        path: Steps = ()
        for number, key in enumerate(keys, 1):
            path = (*path, key)
            if is_element and number == len(keys):
                self._counts[path] = self._counts.get(path, 0) + 1
            if path in self._counts:  # a header below an array of tables is about the array's last element
                path = (*path, self._counts[path] - 1)
        self._skip(_LINE_END)
        self.sections.append(Section(path, is_element, begin, self.position, self.position))

    def _scan_pair(self, begin: int) -> None:
        section = self.sections[-1]
        key_begin = self.position
        keys = self._scan_keys()
        self.position += 1  # "="
        path = (*section.path, *keys)
        value_end = self._scan_value(path, key_begin)
        self._skip(_LINE_END)
        section.content_end = self.position
        section.pairs.append(Pair(path, begin, self.position, value_end, len(self.sections) - 1))

    def _scan_keys(self) -> list[str]:
        """Scan a key up to the "=" or "]" that follows, and return its parts, which dots separate, without quotes."""
        keys = []
        while True:
            self._skip(_SPACE)
            if self.text[self.position] in "\"'":
                literal = self._skip(_STRING)
                keys.append(str(tomllib.loads(f"key = {literal}")["key"]))
            else:
                keys.append(self._skip(_BARE_KEY))
            self._skip(_SPACE)
            if self.text[self.position] != ".":
                return keys
            self.position += 1

    def _scan_value(self, path: Steps, member_begin: int | None = None) -> int:
        """Scan the value that begins at the present position, record its span, and return where it ends.

        Args:
            path: the path of the value.
            member_begin: where its key begins; None for an element of an array.
        """
        self._skip(_SPACE)
        begin = self.position
        form: Literal["scalar", "array", "table"] = "scalar"
        match self.text[begin]:
            case "[":
                form = "array"
                self._scan_array(path)
            case "{":
                form = "table"
                self._scan_table(path)
            case '"' | "'":
                self._skip(_STRING)
            case _:
                self._skip(_SCALAR)
        self.values[path] = Value(begin, self.position, form, begin if member_begin is None else member_begin)
        return self.position

    def _scan_array(self, path: Steps) -> None:
        number = 0
        self.position += 1
        self._skip(_BLANKS)
        while self.text[self.position] != "]":
            self._scan_value((*path, number))
            number += 1
            self._skip(_BLANKS)
            if self.text[self.position] == ",":
                self.position += 1
                self._skip(_BLANKS)
        self.position += 1

    def _scan_table(self, path: Steps) -> None:
        self.position += 1
        self._skip(_BLANKS)
        while self.text[self.position] != "}":
            key_begin = self.position
            keys = self._scan_keys()
            self.position += 1
            self._scan_value((*path, *keys), key_begin)
            self._skip(_BLANKS)
            if self.text[self.position] == ",":
                self.position += 1
                self._skip(_BLANKS)
        self.position += 1


def scan_toml(text: str) -> Spans:
    """Return the spans of a TOML text.

    Raises:
        TOMLDecodeError: if the text is not valid.
    """
    tomllib.loads(text.removeprefix("\ufeff"))
    return _Scanner(text).scan()


def list_members(spans: Spans, path: Steps) -> Iterator[tuple[Steps, Value]]:
    """Yield the members of an inline table, or the elements of an array, in the order of the text.

    A member with dotted keys is yielded with its whole path.
    """
    outer = spans.values[path]
    inside = sorted(
        (value.member_begin, key) for key, value in spans.values.items() if key[: len(path)] == path and key != path
    )
    end = outer.begin
    for begin, key in inside:
        if begin >= end:  # otherwise it is inside the member before it
            end = spans.values[key].end
            yield key, spans.values[key]


def is_below(path: Steps, table: Steps) -> bool:
    """Return whether ``path`` is the path ``table`` itself or that of something inside this table."""
    return path[: len(table)] == table
