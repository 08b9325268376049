"""What is wrong with a protocol file: every mistake, each with its line, its block, its value and the way out."""

import difflib
import types
from collections.abc import Iterable, Iterator
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from minihuman.errors import ProtocolError
from minihuman.study.toml_lines import Lines

Complaint = tuple[str, str]  # path, what is wrong there and the way out
NO_FIELDS = frozenset({"toml", "files"})  # of Protocol, which the file itself does not have
_SHOWN = 60  # characters of a value
_NAMED = {"blocks": "block", "groups": "group", "pages": "page", "questions": "questions", "sessions": "session"}


def structural(tree: object, kind: type[msgspec.Struct], path: str = "$") -> Iterator[Complaint]:
    """Fields that there are not, that are missing, or that hold something else than they can."""
    if not isinstance(tree, dict):
        yield path, f"is {shown(tree)}; it is a table: {_as_table(path, kind)}"
        return
    hints = get_type_hints(kind)
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind) if field.name not in NO_FIELDS}
    meant = set()  # fields that are there under another name
    for name in tree:
        if name not in fields:
            meant.update(difflib.get_close_matches(name, fields, n=1))
            yield f"{path}.{name}", f"is not a field; {nearest(name, fields)}"
    for name, field in fields.items():
        if name in tree:
            yield from _value(tree[name], hints[field.name], f"{path}.{name}")
        elif field.required and name not in meant:
            yield path, f"needs the field `{name}`: {_example(hints[field.name], name)}"


def nearest(wrong: str, known: Iterable[str]) -> str:
    """What may have been meant, or all there is."""
    names = list(known)
    close = difflib.get_close_matches(wrong, names, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known fields: {', '.join(names)}"


def shown(value: object) -> str:
    """A value as it may stand in a message."""
    if isinstance(value, bool):
        return str(value).lower()
    words = repr(value)
    return words if len(words) <= _SHOWN else words[: _SHOWN - 3] + "..."


def told(complaints: Iterable[Complaint], *, source: str, text: str, tree: dict[str, Any]) -> ProtocolError | None:
    """All complaints as one error, in order of line; None if there are none."""
    lines = Lines(text)
    placed = sorted({(lines.of(path), path, complaint) for path, complaint in complaints})
    if not placed:
        return None
    return ProtocolError.of(
        [f"{source}:{line}: {path}{_whose(path, tree)} {complaint}" for line, path, complaint in placed], source
    )


def _whose(path: str, tree: dict[str, Any]) -> str:
    """The name of the block or group that a path leads into."""
    steps = path.removeprefix("$.").split(".")
    table, _, number = steps[0].partition("[")
    found = tree.get(table)
    if table not in _NAMED or not number or not isinstance(found, list):
        return ""
    place = int(number.rstrip("]"))
    name = found[place].get("name") if place < len(found) and isinstance(found[place], dict) else None
    return f" ({_NAMED[table]} {name!r})" if isinstance(name, str) else ""


def _value(value: object, hint: Any, path: str) -> Iterator[Complaint]:
    struct, many = _structs(hint)
    if struct is not None and many:
        name = path.rsplit(".", 1)[-1]
        if not isinstance(value, list):
            yield path, f"is {_kind(value)}; write it with two brackets, [[{name}]], once for each"
            return
        for number, one in enumerate(value):
            yield from structural(one, struct, f"{path}[{number}]")
    elif struct is not None:
        yield from structural(value, struct, path)
    else:
        try:
            msgspec.convert(value, hint)
        except msgspec.ValidationError as error:
            yield _leaf(value, hint, path, str(error))


def _structs(hint: Any) -> tuple[type[msgspec.Struct] | None, bool]:
    """The one struct that a hint asks for, and whether a list of it; None where it is another or several."""
    options = [one for one in _options(hint) if one is not type(None)]
    if len(options) != 1:
        return None, False
    (only,) = options
    if isinstance(only, type) and issubclass(only, msgspec.Struct):
        return only, False
    if get_origin(only) is tuple:
        inner, many = _structs(get_args(only)[0])
        return (inner, True) if inner is not None and not many else (None, False)
    return None, False


def _options(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)


def _leaf(value: object, hint: Any, path: str, message: str) -> Complaint:
    where = message.partition(" - at `$")[2].rstrip("`")
    name = path.rsplit(".", 1)[-1]
    for step in filter(None, where.replace("]", "").split("[")):
        if isinstance(value, list) and step.isdigit():
            value = value[int(step)]
    words = [word for one in _options(hint) if get_origin(one) is Literal for word in get_args(one)]
    if words and isinstance(value, str):
        close = difflib.get_close_matches(value, words, n=1)
        meant = f"; did you mean {close[0]!r}?" if close else ""
        return path + where, f"is {value!r}; it is one of {', '.join(words)}{meant}"
    reason = message.partition(" - at ")[0]
    known = reason.startswith(("Expected", "Invalid enum"))
    extra = "" if known else f" ({reason[0].lower()}{reason[1:]})"
    return path + where, f"is {shown(value)}{extra}; {_example(hint, name)}"


def _example(hint: Any, name: str) -> str:
    """What to write instead."""
    wishes = " or ".join(dict.fromkeys(_wish(one, name) for one in _options(hint) if one is not type(None)))
    return f"write {wishes}"


def _wish(one: Any, name: str) -> str:
    match one:
        case _ if one is bool:
            return f"true or false, as in {name} = true"
        case _ if one is int:
            return f"a whole number, as in {name} = 10"
        case _ if one is float:
            return f"a number, as in {name} = 1.5"
        case _ if one is str:
            return f'a text in quotes, as in {name} = "..."'
    origin, inner = get_origin(one), get_args(one)
    if origin is Literal:
        return " or ".join(f'"{word}"' for word in inner)
    if origin is tuple:
        sample = {int: "1, 2", float: "0.5, 1.5"}.get(inner[0], '"...", "..."')
        struct, _ = _structs(one)
        return f"[[{name}]]" if struct is not None else f"a list, as in {name} = [{sample}]"
    if origin is dict:
        return f"a table, as in {name} = {{ ... }}"
    return f"a table [{name}]"


def _kind(value: object) -> str:
    return {dict: "one table", str: "a text", int: "a number", float: "a number", bool: "true or false"}.get(
        type(value), shown(value)
    )


def _as_table(path: str, kind: type[msgspec.Struct]) -> str:
    name = path.rsplit(".", 1)[-1].split("[")[0]
    first = next(iter(msgspec.structs.fields(kind))).encode_name
    brackets = f"[[{name}]]" if "[" in path.rsplit(".", 1)[-1] else f"[{name}]"
    return f"{brackets} and below it {first} = ..."
