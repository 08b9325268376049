"""The JSON schema of a protocol file, and its tables field by field with type, default, meaning and an example."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec

from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.validation_errors import INTERNAL_FIELDS

_TYPES = {"string": "string", "integer": "integer", "number": "number", "boolean": "true or false", "object": "table"}
_PLURALS = {"string": "strings", "integer": "integers", "number": "numbers", "table": "tables"}


@dataclass(frozen=True, slots=True)
class ProtocolField:
    """A field of a table of a protocol; the texts are Markdown."""

    name: str
    type: str  # "list of strings"
    default: str  # as TOML; "required" or "absent" where there is none
    meaning: str
    example: str  # a value, as TOML


def build_json_schema() -> dict[str, Any]:
    """Build the schema (draft 2020-12) of what ``decode_protocol`` takes, with each field's meaning and an example."""
    schema = msgspec.json.schema(Protocol)
    for name in INTERNAL_FIELDS:
        schema["$defs"]["Protocol"]["properties"].pop(name, None)
    for table, definition, _ in _walk_tables(schema):
        for name, (meaning, example) in _read_fields().get(table, {}).items():
            definition["properties"][name] |= {
                "description": meaning,
                "examples": [tomllib.loads(f"value = {example}")["value"]],
            }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "minihuman protocol", **schema}


def list_protocol_tables() -> dict[str, tuple[str, list[ProtocolField]]]:
    """List the tables of a protocol by path ("blocks.agent"), each with its TOML heading and its fields.

    Raises:
        KeyError: if a field has no meaning and example.
    """
    schema = msgspec.json.schema(Protocol)
    return {
        table: (
            f"[[{table}]]" if repeated else f"[{table}]",
            [
                ProtocolField(
                    name,
                    _describe_type(field, schema),
                    _describe_default(field) if name not in definition.get("required", ()) else "required",
                    *_read_fields()[table][name],
                )
                for name, field in definition["properties"].items()
            ],
        )
        for table, definition, repeated in _walk_tables(schema)
    }


@cache
def _read_fields() -> dict[str, dict[str, tuple[str, str]]]:
    return tomllib.loads((files(__package__) / "fields.toml").read_text(encoding="utf-8"))


def _walk_tables(schema: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Yield each table's path, its definition, and whether the file may have it several times."""
    waiting = [("", "Protocol", False)]
    while waiting:
        path, name, repeated = waiting.pop(0)
        definition = schema["$defs"][name]
        if path:
            yield path, definition, repeated
        inner = []
        for field, what in definition["properties"].items():
            if (found := _find_definition(what)) is not None:
                inner.append((f"{path}.{field}".lstrip("."), found, "items" in what))
        waiting = [*inner, *waiting]


def _find_definition(field: dict[str, Any]) -> str | None:
    for one in (field, field.get("items") or {}, *field.get("anyOf", ())):
        if "$ref" in one:
            return str(one["$ref"]).rpartition("/")[2]
    return None


def _describe_type(field: dict[str, Any], schema: dict[str, Any]) -> str:
    if "$ref" in field:
        return "table"
    if "enum" in field:
        *others, last = (f'`"{one}"`' for one in field["enum"])
        return f"{', '.join(others)} or {last}" if others else last
    if "anyOf" in field:
        described = (_describe_type(one, schema) for one in field["anyOf"] if one.get("type") != "null")
        return " or ".join(dict.fromkeys(described))
    if "prefixItems" in field:
        return "two integers"
    if field.get("type") == "array":
        each = _describe_type(field["items"], schema).split(" or ")
        return f"list of {' or '.join(_PLURALS.get(one, one.replace('list ', 'lists ')) for one in each)}"
    return _TYPES[field["type"]]


def _describe_default(field: dict[str, Any]) -> str:
    default = field.get("default")
    if default is None or "$ref" in field:
        return "absent"
    return f"`{msgspec.json.encode(default).decode()}`"
