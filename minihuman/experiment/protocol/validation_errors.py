"""Validation errors of a protocol file: each with its line, table, value and correction.

Python's TOML parser does not report the lines of values, so they are searched for in the text; an approximate line is
enough.
"""

import difflib
import re
import types
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from minihuman.errors import ProtocolError

_HEADER = re.compile(r"\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"\s*((?:[A-Za-z0-9_-]+|\"[^\"]*\"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|\"[^\"]*\"|'[^']*'))*)\s*=")
_TOKEN = re.compile(
    r'"""(?:[^\\]|\\.)*?"""|\'\'\'.*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|#[^\n]*|[\[\]{}\n]', re.DOTALL
)
LAST_STEP = re.compile(r"(\.[^.\[\]]+|\[\d+\])$")


class TomlLines:
    """The line numbers of a file's tables and keys by path, such as 23 for "$.blocks[1].episodes"."""

    def __init__(self, text: str) -> None:
        self._at = {"$": 1}
        table = "$"
        counts: Counter[str] = Counter()
        for number, line in _list_statements(text):
            header = _HEADER.match(line)
            key = _KEY.match(line)
            if header:
                brackets, name = header.group(1, 2)
                table = _find_table_path(name, counts, array=brackets == "[[")
                self._at.setdefault(table, number)
                if table.endswith("]"):  # the first element of an array is where the array begins
                    self._at.setdefault(LAST_STEP.sub("", table), number)
            elif key:
                self._at.setdefault(f"{table}.{_plain(key.group(1))}", number)

    def of(self, path: str) -> int:
        """Return the line of a path, or of the nearest table around it."""
        while path not in self._at and LAST_STEP.search(path):
            path = LAST_STEP.sub("", path)
        return self._at.get(path, 1)


def _list_statements(text: str) -> list[tuple[int, str]]:
    """Return the first line of each statement with its number, skipping continuations in strings and brackets."""
    lines = text.split("\n")
    statements: list[tuple[int, str]] = [(1, lines[0])]
    number = 1
    depth = 0
    for token in _TOKEN.finditer(text):
        word = token.group()
        if word == "\n":
            number += 1
            if depth == 0:
                statements.append((number, lines[number - 1]))
        elif word in "[{":
            depth += 1
        elif word in "]}":
            depth = max(0, depth - 1)
        else:
            number += word.count("\n")
    return statements


def _find_table_path(name: str, counts: "Counter[str]", *, array: bool) -> str:
    """Return the path of a table header; a table inside an array of tables belongs to the array's last element.

    ``counts`` has the number of elements of each array so far, by its path.
    """
    path = "$"
    parts = [part.strip().strip("\"'") for part in name.split(".")]
    last_place = len(parts) - 1
    for place, part in enumerate(parts):
        path = f"{path}.{part}"
        if array and place == last_place:
            counts[path] += 1
        if counts[path]:
            last_element = counts[path] - 1
            path = f"{path}[{last_element}]"
    return path


def _plain(key: str) -> str:
    return ".".join(part.strip().strip("\"'") for part in key.split("."))


FieldError = tuple[str, str]  # a path, and a message with the error and the way out


class InvalidFieldsError(ProtocolError):
    """The fields of a protocol file that are not valid."""

    field_errors: tuple[FieldError, ...] = ()


Bound = tuple[str, float, float]  # a field, its least and its greatest value
INTERNAL_FIELDS = frozenset({"toml", "files"})  # of Protocol, which the file itself does not have
_SHOWN = 60  # characters of a value in a message
_NAMED = {"blocks": "block", "groups": "group", "pages": "page", "questions": "questions", "sessions": "session"}


def find_structural_errors(tree: object, kind: type[msgspec.Struct], path: str = "$") -> Iterator[FieldError]:
    """Yield an error for each field that is unknown, missing, or has a value of the wrong type."""
    if not isinstance(tree, dict):
        yield path, f"is {format_value(tree)}; it is a table: {_as_table(path, kind)}"
        return
    hints = get_type_hints(kind)
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind) if field.name not in INTERNAL_FIELDS}
    meant = set()  # fields that probably are given under a misspelt name
    for name in tree:
        if name not in fields:
            meant.update(difflib.get_close_matches(name, fields, n=1))
            yield f"{path}.{name}", f"is not a field; {suggest_names(name, fields)}"
    for name, field in fields.items():
        if name in tree:
            yield from _find_value_errors(tree[name], hints[field.name], f"{path}.{name}")
        elif field.required and name not in meant:
            yield path, f"needs the field `{name}`: {_example(hints[field.name], name)}"


def check_bounds(path: str, spec: msgspec.Struct, bounds: Iterable[Bound]) -> Iterator[FieldError]:
    """Yield an error for each field of a table whose value is out of bounds."""
    for field, least, most in bounds:
        number = getattr(spec, field)
        if not least <= number <= most:
            yield f"{path}.{field}", f"is {number:g}; use {least:g} to {most:g}"


def suggest_names(wrong: str, known: Iterable[str]) -> str:
    """Return a hint that suggests the most similar known name, or lists all of them."""
    names = list(known)
    close = difflib.get_close_matches(wrong, names, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"known fields: {', '.join(names)}"


def format_value(value: object) -> str:
    """Format a value for a message, shortened if it is long."""
    if isinstance(value, bool):
        return str(value).lower()
    words = repr(value)
    if len(words) <= _SHOWN:
        return words
    return words[: _SHOWN - 3] + "..."


def build_protocol_error(
    errors: Iterable[FieldError], *, source: str, text: str, tree: dict[str, Any]
) -> ProtocolError | None:
    """Build one exception from all errors, in order of line; return None if there are no errors."""
    field_errors = list(errors)
    placed = format_field_errors(field_errors, source=source, text=text, tree=tree)
    if placed:
        error = InvalidFieldsError.of(placed, source)
        assert isinstance(error, InvalidFieldsError)
        error.field_errors = tuple(field_errors)
        return error
    return None


def format_field_errors(errors: Iterable[FieldError], *, source: str, text: str, tree: dict[str, Any]) -> list[str]:
    """Format one line per error in the order of the file's lines.

    An example is "study.toml:12: $.blocks[1].episodes is 0; ...".
    """
    lines = TomlLines(text)
    placed = sorted({(lines.of(path), path, message) for path, message in errors})
    return [f"{source}:{line}: {path}{_name_table(path, tree)} {message}" for line, path, message in placed]


def _name_table(path: str, tree: dict[str, Any]) -> str:
    """Return the name of the block, group or other part that contains a path, in parentheses; "" if none does."""
    steps = path.removeprefix("$.").split(".")
    table, _, number = steps[0].partition("[")
    rows = tree.get(table)
    if table not in _NAMED or not number or not isinstance(rows, list):
        return ""
    place = int(number.rstrip("]"))
    if place < len(rows) and isinstance(rows[place], dict):
        name = rows[place].get("name")
    else:
        name = None
    if isinstance(name, str):
        return f" ({_NAMED[table]} {name!r})"
    return ""


def _find_value_errors(value: object, hint: Any, path: str) -> Iterator[FieldError]:
    """Yield the errors of a field's value, which may be a table or a list of tables."""
    struct, many = _structs(hint)
    if struct is not None and many:
        name = path.rsplit(".", 1)[-1]
        if not isinstance(value, list):
            yield path, f"is {_name_type(value)}; write it with two brackets, [[{name}]], once for each"
            return
        for number, row in enumerate(value):
            yield from find_structural_errors(row, struct, f"{path}[{number}]")
    elif struct is not None:
        yield from find_structural_errors(value, struct, path)
    else:
        try:
            msgspec.convert(value, hint)
        except msgspec.ValidationError as error:
            yield _explain_mistake(value, hint, path, str(error))


def _structs(hint: Any) -> tuple[type[msgspec.Struct] | None, bool]:
    """Return the only struct type that a type hint allows, or None, and whether the hint is a list of it."""
    options = [option for option in _list_alternatives(hint) if option is not type(None)]
    if len(options) != 1:
        return None, False
    (only,) = options
    if isinstance(only, type) and issubclass(only, msgspec.Struct):
        return only, False
    if get_origin(only) is tuple:
        inner, many = _structs(get_args(only)[0])
        if inner is not None and not many:
            return (inner, True)
        return (None, False)
    return None, False


def _list_alternatives(hint: Any) -> tuple[Any, ...]:
    """Return the types that a type hint allows."""
    if get_origin(hint) in (Union, types.UnionType):
        return get_args(hint)
    return (hint,)


def _explain_mistake(value: object, hint: Any, path: str, message: str) -> FieldError:
    """Return the path and the explanation of a wrong value, from msgspec's message about it."""
    reason = message.partition(" - at ")[0]
    inner_path = message.partition(" - at `$")[2].rstrip("`")
    name = path.rsplit(".", 1)[-1]
    for step in filter(None, inner_path.replace("]", "").split("[")):
        if isinstance(value, list) and step.isdigit():
            value = value[int(step)]
    path += inner_path
    words = _list_words(hint)
    if words and isinstance(value, str):
        explanation = f"is {value!r}; it is one of {', '.join(words)}"
        for similar in difflib.get_close_matches(value, words, n=1):
            explanation += f"; did you mean {similar!r}?"
        return path, explanation
    extra = ""
    if not reason.startswith(("Expected", "Invalid enum")):
        extra = f" ({reason[0].lower()}{reason[1:]})"
    return path, f"is {format_value(value)}{extra}; {_example(hint, name)}"


def _list_words(hint: Any) -> list[str]:
    """Return the texts that a type hint allows; empty if it allows any text."""
    words: list[str] = []
    for option in _list_alternatives(hint):
        if get_origin(option) is Literal:
            words += get_args(option)
    return words


def _example(hint: Any, name: str) -> str:
    """Return an example of a valid value."""
    wishes = " or ".join(
        dict.fromkeys(_example_of_type(option, name) for option in _list_alternatives(hint) if option is not type(None))
    )
    return f"write {wishes}"


def _example_of_type(hint: Any, name: str) -> str:
    match hint:
        case _ if hint is bool:
            return f"true or false, as in {name} = true"
        case _ if hint is int:
            return f"a whole number, as in {name} = 10"
        case _ if hint is float:
            return f"a number, as in {name} = 1.5"
        case _ if hint is str:
            return f'a text in quotes, as in {name} = "..."'
    origin = get_origin(hint)
    inner = get_args(hint)
    if origin is Literal:
        return " or ".join(f'"{word}"' for word in inner)
    if origin is tuple:
        sample = {int: "1, 2", float: "0.5, 1.5"}.get(inner[0], '"...", "..."')
        struct, _ = _structs(hint)
        if struct is not None:
            return f"[[{name}]]"
        return f"a list, as in {name} = [{sample}]"
    if origin is dict:
        return f"a table, as in {name} = {{ ... }}"
    return f"a table [{name}]"


def _name_type(value: object) -> str:
    return {dict: "one table", str: "a text", int: "a number", float: "a number", bool: "true or false"}.get(
        type(value), format_value(value)
    )


def _as_table(path: str, kind: type[msgspec.Struct]) -> str:
    name = path.rsplit(".", 1)[-1].split("[")[0]
    first = next(iter(msgspec.structs.fields(kind))).encode_name
    brackets = f"[[{name}]]" if "[" in path.rsplit(".", 1)[-1] else f"[{name}]"
    return f"{brackets} and below it {first} = ..."
