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
    """The line numbers of a TOML file's tables and keys by path, such as 23 for "$.blocks[1].episodes"."""

    def __init__(self, text: str) -> None:
        self._line_numbers = {"$": 1}  # by path
        table = "$"
        counts: Counter[str] = Counter()
        for number, line in _list_statements(text):
            header = _HEADER.match(line)
            key = _KEY.match(line)
            if header:
                brackets, name = header.group(1, 2)
                table = _find_table_path(name, counts, is_array=brackets == "[[")
                self._line_numbers.setdefault(table, number)
                if table.endswith("]"):  # the first element of an array is where the array begins
                    self._line_numbers.setdefault(LAST_STEP.sub("", table), number)
            elif key:
                self._line_numbers.setdefault(f"{table}.{_strip_quotes(key.group(1))}", number)

    def of(self, path: str) -> int:
        """Return the line number of a path, or of the nearest table around it if the file does not contain the path."""
        while path not in self._line_numbers and LAST_STEP.search(path):
            path = LAST_STEP.sub("", path)
        return self._line_numbers.get(path, 1)


def _list_statements(text: str) -> list[tuple[int, str]]:
    """Return the number and the text of the first line of each statement of a TOML file.

    Lines that continue a string or a list are skipped.
    """
    lines = text.split("\n")
    statements: list[tuple[int, str]] = [(1, lines[0])]
    number = 1
    bracket_depth = 0
    for match in _TOKEN.finditer(text):
        token = match.group()
        if token == "\n":
            number += 1
            if bracket_depth == 0:
                statements.append((number, lines[number - 1]))
        elif token in "[{":
            bracket_depth += 1
        elif token in "]}":
            bracket_depth = max(0, bracket_depth - 1)
        else:  # a string or a comment
            number += token.count("\n")
    return statements


def _find_table_path(name: str, counts: "Counter[str]", *, is_array: bool) -> str:
    """Return the path of the table that a header begins, such as "$.blocks[1].options" for [blocks.options].

    A table inside an array of tables belongs to the array's last element.

    Args:
        name: the text between the header's brackets.
        counts: the number of elements of each array so far, by its path; a header of an array increases it.
        is_array: whether the header has double brackets.
    """
    path = "$"
    steps = _strip_quotes(name).split(".")
    for depth, step in enumerate(steps, 1):
        path = f"{path}.{step}"
        if is_array and depth == len(steps):
            counts[path] += 1
        if counts[path]:
            last_element = counts[path] - 1
            path = f"{path}[{last_element}]"
    return path


def _strip_quotes(key: str) -> str:
    """Return a dotted TOML key without the quotes and spaces around its parts."""
    return ".".join(part.strip().strip("\"'") for part in key.split("."))


FieldError = tuple[str, str]  # a path, and a message with the error and the way out


class InvalidFieldsError(ProtocolError):
    """The fields of a protocol file that are not valid."""

    field_errors: tuple[FieldError, ...] = ()


Bound = tuple[str, float, float]  # a field, its least and its greatest value
INTERNAL_FIELDS = frozenset({"toml", "files"})  # of Protocol, which the file itself does not have
_MAX_SHOWN_CHARACTERS = 60  # of a value in a message
_NAMED = {"blocks": "block", "groups": "group", "pages": "page", "questions": "questions", "sessions": "session"}


def find_structural_errors(tree: object, kind: type[msgspec.Struct], path: str = "$") -> Iterator[FieldError]:
    """Yield an error for each field of a decoded table that is unknown, missing, or has a value of the wrong type.

    Args:
        tree: the decoded table.
        kind: the struct to which it is to be converted.
        path: the table's path in errors.
    """
    if not isinstance(tree, dict):
        yield path, f"is {format_value(tree)}; it is a table: {_format_table_example(path, kind)}"
        return
    hints = get_type_hints(kind)
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind) if field.name not in INTERNAL_FIELDS}
    misspelt = set()  # fields that are probably given under a wrong name
    for name in tree:
        if name not in fields:
            misspelt.update(difflib.get_close_matches(name, fields, n=1))
            yield f"{path}.{name}", f"is not a field; {suggest_names(name, fields)}"
    for name, field in fields.items():
        if name in tree:
            yield from _find_value_errors(tree[name], hints[field.name], f"{path}.{name}")
        elif field.required and name not in misspelt:
            yield path, f"needs the field `{name}`: {_format_example(hints[field.name], name)}"


def check_bounds(path: str, spec: msgspec.Struct, bounds: Iterable[Bound]) -> Iterator[FieldError]:
    """Yield an error for each value of the table ``spec`` that is out of its bounds; ``path`` is the table's path."""
    for field, least, most in bounds:
        number = getattr(spec, field)
        if not least <= number <= most:
            yield f"{path}.{field}", f"is {number:g}; use {least:g} to {most:g}"


def suggest_names(wrong: str, known: Iterable[str]) -> str:
    """Return a hint with the known name that is most similar to a wrong one, or with all names if none is similar."""
    names = list(known)
    close = difflib.get_close_matches(wrong, names, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"known fields: {', '.join(names)}"


def format_value(value: object) -> str:
    """Return a value as text for a message, shortened if it is long."""
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value)
    if len(text) <= _MAX_SHOWN_CHARACTERS:
        return text
    return text[: _MAX_SHOWN_CHARACTERS - 3] + "..."


def build_protocol_error(
    errors: Iterable[FieldError], *, source: str, text: str, tree: dict[str, Any]
) -> ProtocolError | None:
    """Return one exception with all errors of a file, in order of line; None if there are no errors.

    The arguments are those of `format_field_errors`.
    """
    field_errors = list(errors)
    lines = format_field_errors(field_errors, source=source, text=text, tree=tree)
    if lines:
        error = InvalidFieldsError.of(lines, source)
        assert isinstance(error, InvalidFieldsError)
        error.field_errors = tuple(field_errors)
        return error
    return None


def format_field_errors(errors: Iterable[FieldError], *, source: str, text: str, tree: dict[str, Any]) -> list[str]:
    """Return one line per error in the order of the file's lines, such as "study.toml:12: $.blocks[1].episodes is 0".

    Args:
        errors: the paths and messages; equal ones are formatted once.
        source: the name of the file.
        text: its content.
        tree: its decoded content.
    """
    line_numbers = TomlLines(text)
    numbered_errors = sorted({(line_numbers.of(path), path, message) for path, message in errors})
    return [f"{source}:{line}: {path}{_name_table(path, tree)} {message}" for line, path, message in numbered_errors]


def _name_table(path: str, tree: dict[str, Any]) -> str:
    """Return the block, group or other part that contains a path, as " (block 'training')"; "" if none does."""
    first_step = path.removeprefix("$.").split(".")[0]
    table, _, bracketed_index = first_step.partition("[")
    rows = tree.get(table)
    if table not in _NAMED or not bracketed_index or not isinstance(rows, list):
        return ""
    index = int(bracketed_index.rstrip("]"))
    if index < len(rows) and isinstance(rows[index], dict):
        name = rows[index].get("name")
        if isinstance(name, str):
            return f" ({_NAMED[table]} {name!r})"
    return ""


def _find_value_errors(value: object, hint: Any, path: str) -> Iterator[FieldError]:
    """Yield the errors of a field's value, which may be a table or a list of tables, against the field's type hint."""
    struct, is_list = _find_struct(hint)
    if struct is not None and is_list:
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
            yield _explain_wrong_value(value, hint, path, str(error))


def _find_struct(hint: Any) -> tuple[type[msgspec.Struct] | None, bool]:
    """Return the struct type that a type hint allows, alone or in a tuple, and whether it is in a tuple.

    Return None and False for a type hint that allows anything else, apart from None.
    """
    alternatives = [alternative for alternative in _list_alternatives(hint) if alternative is not type(None)]
    if len(alternatives) != 1:
        return None, False
    (only_type,) = alternatives
    if isinstance(only_type, type) and issubclass(only_type, msgspec.Struct):
        return only_type, False
    if get_origin(only_type) is tuple:
        struct, is_nested = _find_struct(get_args(only_type)[0])
        if struct is not None and not is_nested:
            return struct, True
    return None, False


def _list_alternatives(hint: Any) -> tuple[Any, ...]:
    """Return the types of which a type hint is the union; the hint alone if it is not a union."""
    if get_origin(hint) in (Union, types.UnionType):
        return get_args(hint)
    return (hint,)


def _explain_wrong_value(value: object, hint: Any, path: str, message: str) -> FieldError:
    """Return the path of a wrong value, and a text that explains what is wrong and what to write instead.

    Args:
        value: the field's value; in a list, only one element may be wrong.
        hint: the field's type hint.
        path: the field's path.
        message: msgspec's message, such as "Expected `int`, got `str` - at `$[1]`".
    """
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
    stated_reason = ""
    if not reason.startswith(("Expected", "Invalid enum")):  # these only repeat the types
        stated_reason = f" ({reason[0].lower()}{reason[1:]})"
    return path, f"is {format_value(value)}{stated_reason}; {_format_example(hint, name)}"


def _list_words(hint: Any) -> list[str]:
    """Return the texts of the literals in a type hint; empty if it has none."""
    words: list[str] = []
    for alternative in _list_alternatives(hint):
        if get_origin(alternative) is Literal:
            words += get_args(alternative)
    return words


def _format_example(hint: Any, name: str) -> str:
    """Return the advice to write a value of one of the types that a field's hint allows, each with an example."""
    alternatives = [alternative for alternative in _list_alternatives(hint) if alternative is not type(None)]
    examples = dict.fromkeys(_format_type_example(alternative, name) for alternative in alternatives)
    return f"write {' or '.join(examples)}"


_SCALAR_EXAMPLES = {  # type -> what to write, and an example of it
    bool: ("true or false", "true"),
    int: ("a whole number", "10"),
    float: ("a number", "1.5"),
    str: ("a text in quotes", '"..."'),
}


def _format_type_example(hint: Any, name: str) -> str:
    """Return the TOML for a value of a single type, such as "a whole number, as in NAME = 10"."""
    if hint in _SCALAR_EXAMPLES:
        noun, example = _SCALAR_EXAMPLES[hint]
        return f"{noun}, as in {name} = {example}"
    origin = get_origin(hint)
    arguments = get_args(hint)
    if origin is Literal:
        return " or ".join(f'"{word}"' for word in arguments)
    if origin is tuple:
        struct, _ = _find_struct(hint)
        if struct is not None:
            return f"[[{name}]]"
        elements = {int: "1, 2", float: "0.5, 1.5"}.get(arguments[0], '"...", "..."')
        return f"a list, as in {name} = [{elements}]"
    if origin is dict:
        return f"a table, as in {name} = {{ ... }}"
    return f"a table [{name}]"


def _name_type(value: object) -> str:
    """Return the name of a value's type in errors, such as "one table"; for another type, the value itself."""
    names = {dict: "one table", str: "a text", int: "a number", float: "a number", bool: "true or false"}
    return names.get(type(value), format_value(value))


def _format_table_example(path: str, kind: type[msgspec.Struct]) -> str:
    """Return how the table at a path is written in TOML: its heading, and its first field."""
    last_step = path.rsplit(".", 1)[-1]
    name = last_step.split("[")[0]
    heading = f"[[{name}]]" if "[" in last_step else f"[{name}]"
    first_field = next(iter(msgspec.structs.fields(kind))).encode_name
    return f"{heading} and below it {first_field} = ..."
