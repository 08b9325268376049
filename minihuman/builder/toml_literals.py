"""TOML literals: a value as the text that a person would write for it, in the form of the literal that it replaces."""

import math
import re
from collections.abc import Mapping, Sequence
from datetime import date, datetime, time
from typing import Any

LONGEST_LINE = 100  # of a list or an inline table, in characters
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_ESCAPES = {"\\": "\\\\", '"': '\\"', "\b": "\\b", "\t": "\\t", "\n": "\\n", "\f": "\\f", "\r": "\\r"}
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")
_MAX_INTEGER = 2**63 - 1


def format_key(key: str) -> str:
    """Format a key, in quotes only where TOML requires them."""
    if _BARE_KEY.fullmatch(key):
        return key
    return _format_basic(key)


def format_literal(content: Any, old: str = "", newline: str = "\n") -> str:
    """Format a value as TOML.

    Args:
        content: the value; a table becomes an inline table.
        old: the literal that it replaces, whose quotes and, for a number, decimal point are kept; "" for none.
        newline: how lines end in the file.

    Raises:
        ValueError: if TOML has no such value.
    """
    match content:
        case bool():
            return str(content).lower()
        case int():
            return _format_integer(content, old)
        case float():
            return _format_float(content)
        case str():
            return _format_string(content, old, newline)
        case datetime() | date() | time():
            return content.isoformat()
        case Mapping():
            members = ", ".join(f"{format_key(key)} = {_format_inline(member)}" for key, member in content.items())
            return f"{{ {members} }}" if members else "{}"
        case Sequence():
            return _format_list(content, newline)
    raise ValueError(f"{content!r} is not a value that TOML has")


def _format_inline(content: Any) -> str:
    """Format a value that stands inside an inline table, without line breaks."""
    match content:
        case str():
            return _format_basic(content)
        case Mapping():
            return format_literal(content)
        case Sequence():
            return f"[{', '.join(map(_format_inline, content))}]"
        case _:
            return format_literal(content)


def _format_list(elements: Sequence[Any], newline: str) -> str:
    """Format a list on one line, or with an element on each line if one line would exceed `LONGEST_LINE`."""
    literals = [format_literal(element, newline=newline) for element in elements]
    line = f"[{', '.join(literals)}]"
    if len(line) <= LONGEST_LINE:
        return line
    return f"[{newline}" + "".join(f"    {literal},{newline}" for literal in literals) + "]"


def _format_integer(content: int, old: str) -> str:
    if not -_MAX_INTEGER - 1 <= content <= _MAX_INTEGER:
        raise ValueError(f"{content} is not an integer of 64 bits, which are those that TOML has")
    if is_float_literal(old):
        return _format_float(float(content))
    return str(content)


def _format_float(content: float) -> str:
    if math.isnan(content):
        return "nan"
    return repr(content).replace("e+", "e")


def is_float_literal(literal: str) -> bool:
    """Return whether a literal is a number with a point or an exponent, or is infinite or not a number."""
    number = literal.replace("_", "")
    try:
        float(number)
    except ValueError:
        return False
    return not number.lstrip("+-").isdecimal()


def _format_string(text: str, old: str, newline: str) -> str:
    """Format a text with the quotes of the literal that it replaces, or with the first quotes that can hold it.

    Raises:
        ValueError: if the text has a surrogate without its pair, which UTF-8 cannot encode.
    """
    if text.encode("utf-8", "replace").decode() != text:
        raise ValueError(f"{text!r} has half of a character; type it again")
    if "\n" in text and "\r" not in text:
        return _format_lines(text, old, newline)
    is_literal = old.startswith("'") and not old.startswith("'''")
    if is_literal and "'" not in text and "\n" not in text and not _CONTROL.search(text):
        return f"'{text}'"
    return _format_basic(text)


def _format_lines(text: str, old: str, newline: str) -> str:
    """Format a text of several lines between triple quotes; it begins on the line after the opening quotes.

    Args:
        text: the text, with "\\n" between its lines.
        old: the literal that it replaces, whose kind of quotes is kept if it can hold the text; "" for none.
        newline: how lines end in the file.
    """
    lines = text.replace("\n", newline)
    if old.startswith("'''") and "'''" not in text and not text.endswith("'") and not _CONTROL.search(text):
        return f"'''{newline}{lines}'''"
    escaped = lines.replace("\\", "\\\\").replace('"""', '""\\"')
    escaped = _CONTROL.sub(lambda match: match[0] if match[0] == "\r" else _escape(match[0]), escaped)
    if escaped.endswith('"'):
        escaped = f'{escaped[:-1]}\\"'
    return f'"""{newline}{escaped}"""'


def _format_basic(text: str) -> str:
    return '"' + "".join(_ESCAPES.get(letter) or _escape(letter) for letter in text) + '"'


def _escape(letter: str) -> str:
    """Return a control character as an escape sequence, and any other character unchanged."""
    if _CONTROL.match(letter):
        return f"\\u{ord(letter):04x}"
    return letter
