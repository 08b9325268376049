"""A protocol file as text that is edited in place: an edit changes the span of its value alone, and is verified.

Comments, spacing, order and the way in which numbers and texts are written stay as they are. Each edit returns a new
text whose values are compared with what the edit means; a text that cannot be edited so is refused and stays as it is.
The module knows TOML, not protocols: `study_folder` decides what may be edited and what an edit means.
"""

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from minihuman.builder.toml_blocks import find_core, find_removable_span, list_runs
from minihuman.builder.toml_literals import LONGEST_LINE, format_key, format_literal
from minihuman.builder.toml_spans import Pair, Spans, Steps, is_below, list_members, scan_toml
from minihuman.errors import MinihumanError

MISSING = object()  # stands for a value that is absent, since no value of TOML can
_REST_OF_LINE = re.compile(r"[ \t]*,?[ \t]*(?:#[^\n]*)?")
_SPACE_AND_COMMA = re.compile(r"\s*,[ \t]*")

Replacement = tuple[int, int, str]  # from, to, new text


class NotEditableError(MinihumanError, ValueError):
    """A text cannot be edited in the way that was requested.

    Attributes:
        path: the path of the field.
        line: the line of the field, from 1.
    """

    def __init__(self, message: str, path: Steps = (), line: int = 1) -> None:
        super().__init__(message)
        self.path = path
        self.line = line


@dataclass(frozen=True, slots=True)
class TomlDocument:
    """A TOML text with its values and their spans. Each edit returns a new document."""

    text: str
    tree: dict[str, Any]
    spans: Spans

    @classmethod
    def parse(cls, text: str) -> "TomlDocument":
        """Parse a TOML text.

        Raises:
            NotEditableError: if it is not valid TOML.
        """
        try:
            tree = tomllib.loads(text.removeprefix("\ufeff"))
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise NotEditableError(f"this is not valid TOML: {error}", (), _parse_line_number(str(error))) from None
        return cls(text, tree, scan_toml(text))

    @property
    def newline(self) -> str:
        """Return the line break of the text: "\\r\\n" if it has any, else "\\n"."""
        if "\r\n" in self.text:
            return "\r\n"
        return "\n"

    def find(self, path: Steps) -> Any:
        """Return the value at a path; `MISSING` if there is none."""
        content: Any = self.tree
        for step in path:
            if isinstance(content, dict) and step in content:
                content = content[str(step)]
            elif isinstance(content, list) and isinstance(step, int) and 0 <= step < len(content):
                content = content[step]
            else:
                return MISSING
        return content

    def find_line(self, path: Steps) -> int:
        """Return the line of a path, from 1, or that of the nearest table around it."""
        return self.spans.find_line(self.spans.position_of(path))

    def literal(self, path: Steps) -> str:
        """Return the text of the value at a path; "" if it is a table with a header, or missing."""
        span = self.spans.values.get(path)
        if span is None:
            return ""
        return self.text[span.begin : span.end]

    def set(self, path: Steps, content: Any, literal: str = "") -> "TomlDocument":
        """Return a document in which a field has a value; a field that is missing is added.

        Args:
            path: the field.
            content: the value, which may be a table or a list.
            literal: the text that replaces the present value's text, if the field is not a table or list; "" formats
                the value.

        Raises:
            NotEditableError: if the text cannot be edited so that this field alone changes.
        """
        current = self.find(path)
        if current is MISSING:
            return self._add(path, content)
        if is_same_value(current, content):
            return self
        if isinstance(content, Mapping) and isinstance(current, dict):
            return self._set_members(path, current, content)
        if isinstance(content, list) and isinstance(current, list):
            return self._set_elements(path, current, content)
        span = self.spans.values.get(path)
        if span is None:
            return self.remove(path)._add(path, content)
        return self._rewrite(
            [(span.begin, span.end, literal or self._format(path, content))],
            path,
            lambda tree: _put(tree, path, content),
        )

    def remove(self, path: Steps) -> "TomlDocument":
        """Return a document without a field, a table, or an element of a list.

        Raises:
            NotEditableError: if there is nothing at the path, or it cannot be removed alone.
        """
        self._require_present(path)
        if path in self.spans.values and (lines := self._find_statement(path)) is not None:
            replacements = [(*lines, "")]
        elif path in self.spans.values:
            replacements = [self._cut_member(path)]
        else:
            replacements = [(*find_removable_span(self.spans, run), "") for run in list_runs(self.spans, path)]
            dotted = self._list_dotted_pairs(path)
            replacements += [(*self._include_line_break(pair.begin, pair.end), "") for pair in dotted]
        return self._rewrite(replacements, path, lambda tree: self._delete(tree, path))

    def insert(self, path: Steps, content: Any, literal: str = "") -> "TomlDocument":
        """Return a document with an element inserted into a list, at the number with which the path ends.

        Args:
            path: the list, and the element's number in it.
            content: the element.
            literal: the element's text if it was copied from the file; "" formats the element.

        Raises:
            NotEditableError: if there is no list at the path, or the number is beyond its end.
        """
        array, number = path[:-1], path[-1]
        current = self.find(array)
        if current is MISSING and number == 0:
            return self._add(array, [content])
        if not isinstance(current, list) or not isinstance(number, int) or not 0 <= number <= len(current):
            raise self._refuse(f"there is no place {number!r} in {format_path(array)}", path)
        if array in self.spans.values:
            replacements = self._insert_inline(array, number, literal or self._format(path, content))
        elif not isinstance(content, Mapping):
            raise self._refuse(f"{content!r} is not a table, as the elements of {format_path(array)} are", path)
        else:
            replacements = [self._insert_block(array, number, literal or self._format_section(array, content, True))]
        return self._rewrite(replacements, path, lambda tree: _get(tree, array).insert(number, deepcopy(content)))

    def move(self, path: Steps, to: int) -> "TomlDocument":
        """Return a document in which a list's element has another number; comments above a table's header go with it.

        Args:
            path: the element.
            to: the number that it gets.

        Raises:
            NotEditableError: if there is no such element, or its lines are in several places.
        """
        self._require_present(path)
        array, number = path[:-1], path[-1]
        elements = self.find(array)
        if not isinstance(elements, list) or not isinstance(number, int) or not 0 <= to < len(elements):
            raise self._refuse(f"there is no place {to} in {format_path(array)}", path)
        spans = [self._find_element((*array, index)) for index in range(len(elements))]
        order = list(range(len(elements)))
        order.insert(to, order.pop(number))
        replacements = [
            (begin, end, self.text[slice(*spans[source])]) for (begin, end), source in zip(spans, order, strict=True)
        ]
        return self._rewrite(replacements, path, lambda tree: _move(_get(tree, array), number, to))

    def duplicate(self, path: Steps) -> "TomlDocument":
        """Return a document with a copy of a list's element behind it, with the same text.

        Raises:
            NotEditableError: if there is no such element, or its lines are in several places.
        """
        self._require_present(path)
        number = path[-1]
        if not isinstance(number, int):
            raise self._refuse(f"{format_path(path)} is not an element of a list", path)
        text = self.text[slice(*self._find_element(path))]
        return self.insert((*path[:-1], number + 1), self.find(path), text)

    def _set_members(self, path: Steps, current: Mapping[str, Any], content: Mapping[str, Any]) -> "TomlDocument":
        """Return a document in which the table at ``path``, now ``current``, has exactly the members of ``content``."""
        document = self
        for key, member in content.items():
            document = document.set((*path, key), member)
        for key in current:
            if key not in content:
                document = document.remove((*path, key))
        return document

    def _set_elements(self, path: Steps, current: Sequence[Any], content: Sequence[Any]) -> "TomlDocument":
        """Return a document in which a list, now ``current``, is ``content``; equal elements at both ends are kept."""
        shorter = min(len(current), len(content))
        n_same_before = _count_same_start(current, content)
        n_same_after = min(_count_same_start(current[::-1], content[::-1]), shorter - n_same_before)
        document = self
        for index in range(n_same_before, shorter - n_same_after):
            document = document.set((*path, index), content[index])
        for index in range(shorter - n_same_after, len(content) - n_same_after):
            document = document.insert((*path, index), content[index])
        for index in reversed(range(shorter - n_same_after, len(current) - n_same_after)):
            document = document.remove((*path, index))
        return document

    def _add(self, path: Steps, content: Any) -> "TomlDocument":
        """Return a document with a field added, and with the table that contains it if that is missing."""
        parent, key = path[:-1], path[-1]
        table = self.find(parent)
        if table is MISSING:
            return self._add(parent, [content] if key == 0 else {str(key): content})
        if isinstance(table, list):
            return self.insert(path, content)
        if not isinstance(table, dict) or not isinstance(key, str):
            raise self._refuse(f"{format_path(parent)} is not a table, so it has no {key!r}", path)
        if parent in self.spans.values:
            replacements = self._insert_inline(parent, len(table), f"{format_key(key)} = {self._format(path, content)}")
        else:
            replacements = [self._insert_field(parent, key, content)]
        return self._rewrite(replacements, path, lambda tree: _put(tree, path, content))

    def _insert_field(self, parent: Steps, key: str, content: Any) -> Replacement:
        """Return the replacement that adds a field to a table that is not inline."""
        sections = [section for section in self.spans.sections if section.path == parent]
        pairs = self._list_dotted_pairs(parent)
        is_implicit = not sections and not pairs  # only tables below it have headers
        is_table = isinstance(content, Mapping) or _is_list_of_tables(content)
        if is_table and (parent == () or is_implicit or _needs_header(content)):
            return self._append_block(parent, self._format_member((*parent, key), content))
        if is_implicit:
            header = self._format_section(parent, {key: content}, False)  # [parent], not [[parent]]
            below = next(section for section in self.spans.sections if is_below(section.path, parent))
            begin, _ = find_core(self.spans, (below, below))
            return begin, begin, f"{header}{self.newline}{self.newline}"
        if sections:
            section = sections[0]
            neighbours = section.pairs
            dotted_key = format_key(key)
        else:  # the table has only statements with dotted keys, below the header of another table
            section = self.spans.sections[pairs[-1].section]
            neighbours = pairs
            dotted_key = ".".join(format_key(str(step)) for step in (*parent, key)[len(section.path) :])
        position = neighbours[-1].end if neighbours else section.header_end
        indent = re.match(r"[ \t]*", self.text[neighbours[-1].begin :]) if neighbours else None
        line = f"{indent[0] if indent else ''}{dotted_key} = {self._format((*parent, key), content)}"
        return position, position, self._fit_line(position, line)

    def _fit_line(self, position: int, line: str) -> str:
        """Return a line to insert at a position, with a line break: before it after an unfinished line, else behind."""
        if position and self.text[position - 1] != "\n":
            return f"{self.newline}{line}"
        return f"{line}{self.newline}"

    def _format(self, path: Steps, content: Any) -> str:
        try:
            return format_literal(content, self.literal(path), self.newline)
        except ValueError as error:
            raise self._refuse(str(error), path) from None

    def _format_section(self, path: Steps, table: Mapping[str, Any], is_element: bool) -> str:
        """Return the lines of a table with its header, [[name]] if ``is_element``; no line break is at the end."""
        name = ".".join(format_key(step) for step in path if isinstance(step, str))
        header = f"[[{name}]]" if is_element else f"[{name}]"
        lines = [header]
        tables = []
        for key, content in table.items():
            if _needs_header(content):
                tables.append(self._format_member((*path, key), content))
            else:
                lines.append(f"{format_key(key)} = {self._format((*path, key), content)}")
        return (self.newline * 2).join([self.newline.join(lines), *tables])

    def _format_member(self, path: Steps, content: Any) -> str:
        """Return the lines of a value that has headers: a table, or a list of tables."""
        if isinstance(content, list):
            return (self.newline * 2).join(self._format_section(path, element, True) for element in content)
        if content and all(isinstance(member, Mapping) for member in content.values()):
            return (self.newline * 2).join(
                self._format_section((*path, key), member, False) for key, member in content.items()
            )
        return self._format_section(path, content, False)

    def _insert_block(self, array: Steps, number: int, block: str) -> Replacement:
        """Return the replacement that puts ``block``, an element with a header, at ``number`` in an array of tables."""
        gap = self.newline * 2
        if number < len(self.find(array)):
            begin, _ = find_core(self.spans, list_runs(self.spans, (*array, number))[0])
            return begin, begin, f"{block}{gap}"
        run = list_runs(self.spans, (*array, number - 1))[-1]
        _, end = find_core(self.spans, run)
        _, gap_end = find_removable_span(self.spans, run)
        if gap_end > end:  # other tables follow
            gap = self.text[end:gap_end]
        return end, end, f"{gap}{block}"

    def _append_block(self, parent: Steps, block: str) -> Replacement:
        """Return the replacement that puts a table with a header behind the table ``parent``, () for the whole file."""
        gap = self.newline * 2
        if not parent:
            end = len(self.text.rstrip())
            return end, end, f"{gap if end else ''}{block}"
        run = list_runs(self.spans, parent)[-1]
        _, end = find_core(self.spans, run)
        _, gap_end = find_removable_span(self.spans, run)
        if gap_end > end:
            gap = self.text[end:gap_end]
        return end, end, f"{gap}{block}"

    def _insert_inline(self, container: Steps, number: int, literal: str) -> list[Replacement]:
        """Return the replacements that put a text into an inline table or a list, before member ``number`` or last."""
        members = list(list_members(self.spans, container))
        span = self.spans.values[container]
        if not members:
            padding = " " if span.form == "table" else ""
            return [(span.begin + 1, span.begin + 1, f"{padding}{literal}{padding}")]
        if number < len(members):
            begin = members[number][1].member_begin
            separator = f",{self.newline}{self._indent(begin)}" if self._begins_line(begin) else ", "
            return [(begin, begin, f"{literal}{separator}")]
        last = members[-1][1]
        if not self._begins_line(last.member_begin):
            return [(last.end, last.end, f", {literal}")]
        rest_of_line = _REST_OF_LINE.match(self.text, last.end)
        assert rest_of_line is not None
        comma = "," if "," not in rest_of_line[0].partition("#")[0] else ""
        line = f"{self.newline}{self._indent(last.member_begin)}{literal}{'' if comma else ','}"
        return [(last.end, rest_of_line.end(), f"{comma}{rest_of_line[0]}{line}")]

    def _begins_line(self, position: int) -> bool:
        line_begin = self.text.rfind("\n", 0, position) + 1
        return not self.text[line_begin:position].strip()

    def _indent(self, position: int) -> str:
        return self.text[self.text.rfind("\n", 0, position) + 1 : position]

    def _find_statement(self, path: Steps) -> tuple[int, int] | None:
        """Return the span of the lines of a field that is a statement; None if the field is inside another value."""
        for section in self.spans.sections:
            for pair in section.pairs:
                if pair.path == path:
                    return self._include_line_break(pair.begin, pair.end)
        return None

    def _list_dotted_pairs(self, path: Steps) -> list[Pair]:
        """Return the statements that set something in the table at ``path`` by dotted keys, below another header."""
        sections = (section for section in self.spans.sections if not is_below(section.path, path))
        return [pair for section in sections for pair in section.pairs if is_below(pair.path, path)]

    def _include_line_break(self, begin: int, end: int) -> tuple[int, int]:
        """Return a span of lines to remove, with the line break before it if it ends a text without a last one."""
        if end == len(self.text) and not self.text.endswith("\n"):
            return len(self.text[:begin].removesuffix("\n").removesuffix("\r")), end
        return begin, end

    def _cut_member(self, path: Steps) -> Replacement:
        """Return the replacement that removes a member of an inline table, or an element of a list, with its comma."""
        container = next(path[:length] for length in range(len(path) - 1, 0, -1) if path[:length] in self.spans.values)
        members = [span for _, span in list_members(self.spans, container)]
        span = self.spans.values[path]
        index = members.index(span)
        rest_of_line = _REST_OF_LINE.match(self.text, span.end)
        assert rest_of_line is not None
        line_begin = self.text.rfind("\n", 0, span.member_begin) + 1
        line_end = rest_of_line.end()
        is_alone = self._begins_line(span.member_begin) and self.text[line_end : line_end + 2].strip(" \t\r") == "\n"
        if is_alone:  # on its lines
            return line_begin, self.text.index("\n", line_end) + 1, ""
        if index + 1 < len(members):
            return span.member_begin, members[index + 1].member_begin, ""
        if index:
            return members[index - 1].end, span.end, ""
        comma = _SPACE_AND_COMMA.match(self.text, span.end)
        return span.member_begin, comma.end() if comma else span.end, ""

    def _find_element(self, path: Steps) -> tuple[int, int]:
        """Return where the text of a list's element begins and ends.

        Raises:
            NotEditableError: if the element's lines are in several places.
        """
        if path in self.spans.values:
            span = self.spans.values[path]
            return span.begin, span.end
        runs = list_runs(self.spans, path)
        if len(runs) != 1:
            raise self._refuse(f"the lines of {format_path(path)} are in {len(runs)} places; put them together", path)
        return find_core(self.spans, runs[0])

    def _delete(self, tree: dict[str, Any], path: Steps) -> None:
        """Delete a value from a tree, and each table around it that is then empty and is not written in the text."""
        del _get(tree, path[:-1])[path[-1]]
        parent = path[:-1]
        is_written = parent in self.spans.values or any(section.path == parent for section in self.spans.sections)
        if parent and not is_written and not _get(tree, parent):
            self._delete(tree, parent)

    def _require_present(self, path: Steps) -> None:
        if not path or self.find(path) is MISSING:
            raise self._refuse(f"there is no {format_path(path)} in the file", path)

    def _rewrite(
        self, replacements: Sequence[Replacement], path: Steps, change: Callable[[dict[str, Any]], object]
    ) -> "TomlDocument":
        """Return the document with replacements; raise NotEditableError if its values are not what ``change`` makes."""
        text = self.text
        for begin, end, new_text in sorted(replacements, reverse=True):
            text = f"{text[:begin]}{new_text}{text[end:]}"
        expected = deepcopy(self.tree)
        change(expected)
        try:
            document = TomlDocument.parse(text)
        except NotEditableError:
            document = None
        if document is None or not is_same_value(document.tree, expected):
            raise self._refuse(f"{format_path(path)} is written in a way that the builder leaves alone", path)
        return document

    def _refuse(self, problem: str, path: Steps) -> NotEditableError:
        line = self.find_line(path)
        return NotEditableError(f"line {line}: {problem}; edit the file", path, line)


def format_path(path: Steps) -> str:
    """Format a path as `check` writes it: blocks[1].episodes."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).lstrip(".")


def is_same_value(first: Any, second: Any) -> bool:
    """Return whether two values mean the same in a protocol: 2 and 2.0 do, 1 and true do not."""
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(is_same_value(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple) and isinstance(second, list | tuple):
        return len(first) == len(second) and all(map(is_same_value, first, second))
    if isinstance(first, bool) or isinstance(second, bool):
        return first is second
    return bool(first == second) or (first != first and second != second)  # not-a-numbers are the same


def _count_same_start(first: Sequence[Any], second: Sequence[Any]) -> int:
    """Return how many elements at the start of two lists are the same, up to the first that differs."""
    pairs = enumerate(zip(first, second, strict=False))
    return next((number for number, pair in pairs if not is_same_value(*pair)), min(len(first), len(second)))


def _is_list_of_tables(content: Any) -> bool:
    return isinstance(content, list) and bool(content) and all(isinstance(element, Mapping) for element in content)


def _needs_header(content: Any) -> bool:
    """Return whether a new value gets a header: a list of tables, a table of tables, or one too long for a line."""
    if _is_list_of_tables(content):
        return True
    if not isinstance(content, Mapping) or not content:
        return False
    if all(isinstance(member, Mapping) for member in content.values()):
        return True
    try:
        return len(format_literal(content)) > LONGEST_LINE
    except ValueError:
        return False


def _get(tree: Any, path: Steps) -> Any:
    for step in path:
        tree = tree[step]
    return tree


def _put(tree: dict[str, Any], path: Steps, content: Any) -> None:
    _get(tree, path[:-1])[path[-1]] = deepcopy(content)


def _move(elements: list[Any], number: int, to: int) -> None:
    elements.insert(to, elements.pop(number))


def _parse_line_number(message: str) -> int:
    """Return the line that an error of tomllib names; 1 if it names none."""
    match = re.search(r"line (\d+)", message)
    return int(match[1]) if match else 1
