"""Strict decoding of a protocol file into a `Protocol`, and the JSON schema of protocols.

The module knows no participants and no file system. The schema lists every table field by field, with type, default,
meaning and an example.
"""

import difflib
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec

from minihuman.errors import ProtocolError
from minihuman.experiment.keys import BUTTON_NAMES, KEY_NAMES_TEXT, RESERVED_KEYS
from minihuman.experiment.protocol import specs, strata
from minihuman.experiment.protocol.about_spec import check_newer_person_columns
from minihuman.experiment.protocol.aliases import use_current_names
from minihuman.experiment.protocol.answer_exclusions import check_answer_exclusions
from minihuman.experiment.protocol.block_rules import check_block, check_useless_fields
from minihuman.experiment.protocol.carried_key_maps import check_carried_key_maps
from minihuman.experiment.protocol.consistency import check_design, check_newer_design_rules
from minihuman.experiment.protocol.design_spec import check_study_design
from minihuman.experiment.protocol.model import (
    MAX_SEED as MAX_SEED,
    BlockSpec as BlockSpec,
    ExclusionSpec as ExclusionSpec,
    GroupSpec as GroupSpec,
    KeysSpec as KeysSpec,
    Protocol as Protocol,
    StudySpec as StudySpec,
)
from minihuman.experiment.protocol.specs import (
    check_each,
    check_each_override,
)
from minihuman.experiment.protocol.validation_errors import (
    INTERNAL_FIELDS,
    FieldError,
    build_protocol_error,
    find_structural_errors,
    format_field_errors,
)
from minihuman.plugins import QUESTION_GROUP, list_plugin_names, load_plugin

MAX_ALLOCATED_BLOCKS = 1_000_000  # blocks of all participants, for each of which the allocation list draws keys


_Rules = Callable[[Protocol], Iterable[FieldError]]


def decode_protocol(toml: bytes, source: str = "protocol", files: Mapping[str, bytes] | None = None) -> Protocol:
    """Return the protocol in a file's bytes, after validating it.

    Args:
        toml: the content of the file.
        source: the name of the file in errors.
        files: the contents of the files that the protocol names, by name.

    Raises:
        ProtocolError: if anything is wrong, with a line for each error: file, line, path, value and correction.
    """
    return _decode_safely(toml, source, files or {}, (_check_values, _check_newer_rules))


def decode_logged_protocol(toml: bytes, source: str = "the protocol in a log") -> Protocol:
    """Return the protocol of a recorded session, without checking newer rules, which the protocol may break.

    Raises:
        ProtocolError: as `decode_protocol`.
    """
    return _decode_safely(toml, source, {}, (_check_values,))


def _decode_safely(toml: bytes, source: str, files: Mapping[str, bytes], rules: Sequence[_Rules]) -> Protocol:
    """Return the result of `_decode_tree`; convert any exception of a parser to a ProtocolError of one line."""
    try:
        return _decode_tree(toml, source, files, rules)
    except ProtocolError:
        raise
    except Exception as error:  # a malicious file can make a parser raise anything, as by deep nesting
        first_line = next(iter(str(error).splitlines()), "")
        raise ProtocolError(f"{source}: cannot be read: {type(error).__name__}: {first_line[:200]}") from error


def _decode_tree(toml: bytes, source: str, files: Mapping[str, bytes], rules: Sequence[_Rules]) -> Protocol:
    """Return a decoded protocol, checked by the given rules, which are skipped if fields or types are wrong.

    Raises:
        ProtocolError: if the file cannot be decoded or has errors.
    """
    try:
        text = toml.decode("utf-8-sig")  # an editor may begin the file with a byte-order mark
        tree = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise ProtocolError(f"{source}: byte {error.start} is not valid UTF-8; save the file as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise ProtocolError(f"{source}: this is not valid TOML: {error}") from None
    names = use_current_names(tree)
    field_errors = [*names.conflicts, *find_structural_errors(names.tree, Protocol)]
    if not field_errors:
        protocol = msgspec.convert(names.tree, Protocol)
        for rule in rules:
            field_errors += rule(protocol)
    errors = [(names.written_path(path), message) for path, message in field_errors]
    protocol_error = build_protocol_error(errors, source=source, text=text, tree=tree)
    if protocol_error:
        raise protocol_error
    return msgspec.structs.replace(protocol, toml=toml, files=dict(files))


def _check_values(protocol: Protocol) -> list[FieldError]:
    """Return a (path, message) for each value that has the right type but is not valid."""
    block_names = tuple(block.name for block in protocol.blocks)
    practice = tuple(block.name for block in protocol.blocks if not block.analysed)
    return [
        *_check_study(protocol.study),
        *_check_keys(protocol.keys),
        *_check_groups(protocol),
        *check_each("blocks", protocol.blocks, lambda block: check_block(block, protocol)),
        *check_each("blocks", protocol.blocks, lambda block: check_useless_fields(block, protocol.keys)),
        *check_design(protocol),
        *specs.check_about(protocol.about),
        *specs.check_analysis(protocol.analysis, block_names, practice=practice),
        *_check_study_design(protocol),
        *strata.check_allocation(protocol),
        *specs.check_devices(protocol.devices),
        *specs.check_web(protocol.web),
        *specs.check_model(protocol.model),
        *_check_exclusions(protocol),
    ]


def _check_exclusions(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error for each exclusion rule that compares nothing."""
    for number, rule in enumerate(protocol.exclusions):
        compares_number = rule.below is not None or rule.above is not None
        compares_answer = rule.is_one_of or rule.is_none_of or rule.is_missing
        if not compares_number and not compares_answer:
            yield (
                f"$.exclusions[{number}]",
                "compares nothing; give below or above, or for an answer is_one_of, is_none_of or is_missing",
            )


def _check_newer_rules(protocol: Protocol) -> list[FieldError]:
    """Return the errors found by newer rules, which are not applied to the protocols of recorded sessions."""
    return [
        *check_each_override("blocks", protocol.blocks, lambda block: check_block(block, protocol)),
        *check_carried_key_maps(protocol),
        *_check_allocation_size(protocol),
        *check_newer_design_rules(protocol),
        *check_answer_exclusions(protocol),
        *check_newer_person_columns(protocol.about),
    ]


def _check_study_design(protocol: Protocol) -> list[FieldError]:
    """Return the errors of the table [design] of a protocol."""
    return list(
        check_study_design(
            protocol.design,
            compared_blocks=protocol.analysis.conditions,
            condition_label=protocol.analysis.condition_label,
            options_by_block={block.name: block.options for block in protocol.blocks},
            has_groups=len(protocol.groups) > 1,
        )
    )


def _check_study(study: StudySpec) -> Iterator[FieldError]:
    if not specs.NAME_PATTERN.fullmatch(study.name):
        yield "$.study.name", f"is {study.name!r}; {specs.NAME_RULE}"
    if study.seed < 0:
        yield "$.study.seed", f"is {study.seed}; a seed is 0 or more"
    if study.seed > MAX_SEED:
        yield "$.study.seed", f"is {study.seed}; a seed is {MAX_SEED} or less"
    if not 1 <= study.participants <= 100_000:
        yield "$.study.participants", f"is {study.participants}; use 1 to 100000"
    if not 0 <= study.min_rest_s <= 86_400:
        yield "$.study.min_rest_s", f"is {study.min_rest_s}; a rest is 0 to 86400 s"


def _check_allocation_size(protocol: Protocol) -> Iterator[FieldError]:
    count = protocol.study.participants
    blocks = max(len(protocol.blocks), *(len(group.blocks) for group in protocol.groups))
    if count * blocks > MAX_ALLOCATED_BLOCKS:
        yield (
            "$.study.participants",
            f"is {count} with {blocks} blocks each; ask for at most {MAX_ALLOCATED_BLOCKS // blocks}",
        )


def _check_keys(keys: KeysSpec) -> Iterator[FieldError]:
    for number, key in enumerate(keys.pool):
        path = f"$.keys.pool[{number}]"
        if key not in BUTTON_NAMES:
            yield path, f"is {key!r}, which is not a key; {_suggest_key(key)}"
        elif key in RESERVED_KEYS:
            yield path, f"is {key!r}, which the session itself uses; choose another"
        elif key in keys.pool[:number]:
            yield path, f"is {key!r} again; name each key once"


def _suggest_key(name: str) -> str:
    close = difflib.get_close_matches(name, BUTTON_NAMES, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"keys are called {KEY_NAMES_TEXT}"


def _check_groups(protocol: Protocol) -> Iterator[FieldError]:
    if not protocol.groups:
        yield "$.groups", "is empty; a study has one group or more"
        return
    if not protocol.blocks and not protocol.lists_parts:
        yield "$.blocks", "is empty; a study has one block or more, or parts that are not played"
        return
    yield from specs.check_names("groups", protocol.groups)
    yield from specs.check_names("blocks", protocol.blocks)
    names = [block.name for block in protocol.blocks]
    for number, group in enumerate(protocol.groups):
        path = f"$.groups[{number}].blocks"
        if not group.blocks and not protocol.lists_parts:
            yield path, "is empty; a group plays one block or more"
        for index, name in enumerate(group.blocks):
            if name not in names:
                yield f"{path}[{index}]", f"is {name!r}, which is not a block; blocks: {', '.join(names)}"


def list_old_names(protocol: Protocol, source: str) -> list[str]:
    """Return a line for each old name of a field or value in a protocol's file, with its present name.

    ``source`` is the name of the file in the lines.
    """
    text = protocol.toml.decode("utf-8-sig")
    tree = tomllib.loads(text)
    return format_field_errors(use_current_names(tree).renamed, source=source, text=text, tree=tree)


_TYPES = {"string": "string", "integer": "integer", "number": "number", "boolean": "true or false", "object": "table"}


_PLURALS = {"string": "strings", "integer": "integers", "number": "numbers", "table": "tables"}


@dataclass(frozen=True, slots=True)
class ProtocolField:
    """A field of a protocol's table; its texts are Markdown."""

    name: str
    type: str  # "list of strings"
    default: str  # as TOML; "required" or "absent" without a default
    meaning: str
    example: str  # a value, as TOML


def build_json_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of protocol files, with each field's meaning and an example."""
    schema = msgspec.json.schema(Protocol)
    for name in INTERNAL_FIELDS:
        schema["$defs"]["Protocol"]["properties"].pop(name, None)
    for table, definition, _ in walk_tables(schema):
        for name, (meaning, example) in _read_fields().get(table, {}).items():
            definition["properties"][name] |= {
                "description": meaning,
                "examples": [tomllib.loads(f"value = {example}")["value"]],
            }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "minihuman protocol", **schema}


def list_protocol_tables() -> dict[str, tuple[str, list[ProtocolField]]]:
    """Return the tables of a protocol by path ("blocks.agent"), each with its TOML heading and its fields.

    Raises:
        KeyError: if a field has no meaning and example.
    """
    schema = msgspec.json.schema(Protocol)
    tables = {}
    for table, definition, is_repeated in walk_tables(schema):
        heading = f"[[{table}]]" if is_repeated else f"[{table}]"
        tables[table] = (heading, _list_fields(table, definition, schema))
    return tables


def _list_fields(table: str, definition: dict[str, Any], schema: dict[str, Any]) -> list[ProtocolField]:
    """Return the fields of a table, in the order of its struct.

    Args:
        table: the table's path, such as "blocks.agent".
        definition: the table's JSON schema.
        schema: the JSON schema of the whole protocol.
    """
    fields = []
    for name, field in definition["properties"].items():
        is_required = name in definition.get("required", ())
        default = "required" if is_required else _describe_default(field)
        fields.append(ProtocolField(name, _describe_type(field, schema), default, *_read_fields()[table][name]))
    return fields


@cache
def _read_fields() -> dict[str, dict[str, tuple[str, str]]]:
    """Return the meaning and example of each field of a protocol, by table and field.

    The meaning of a field that only some kinds of question use begins with the names of these kinds.
    """
    text = (files(__package__) / "fields.toml").read_text(encoding="utf-8")
    names = list_plugin_names(QUESTION_GROUP, built_in=True)
    tables: dict[str, dict[str, tuple[str, str]]] = tomllib.loads(text.replace("{question_kinds}", _join_names(names)))
    item_fields = tables["questions.items"]
    question_kinds = {name: load_plugin(QUESTION_GROUP, name, ProtocolError, noun="question kind") for name in names}
    for field, (meaning, example) in item_fields.items():
        users = [name for name, kind in question_kinds.items() if field in (kind.item_fields or ())]
        if users:
            item_fields[field] = (f"of {_join_names(users)}: {meaning}", example)
    return tables


def _join_names(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def walk_tables(schema: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Yield the tables of a protocol's JSON schema, depth first, each followed by the tables in it.

    Each table is yielded as its path, its definition in the schema, and whether the file can contain it several times.
    """
    unvisited = [("", "Protocol", False)]
    while unvisited:
        path, name, is_repeated = unvisited.pop(0)
        definition = schema["$defs"][name]
        if path:
            yield path, definition, is_repeated
        inner_tables = []
        for field, field_schema in definition["properties"].items():
            table = _find_definition(field_schema)
            if table is not None:
                inner_tables.append((f"{path}.{field}".lstrip("."), table, "items" in field_schema))
        unvisited = [*inner_tables, *unvisited]


def _find_definition(field: dict[str, Any]) -> str | None:
    """Return the name of the struct in the type of a field, alone, in a list or as an alternative; None without one.

    ``field`` is the field's JSON schema.
    """
    schemas = [field, field.get("items") or {}]
    schemas += field.get("anyOf", ())
    for schema in schemas:
        if "$ref" in schema:
            return str(schema["$ref"]).rpartition("/")[2]
    return None


def _describe_type(field: dict[str, Any], schema: dict[str, Any]) -> str:
    """Return the type in a field's JSON schema in words: "integer or number", "list of strings"."""
    if "$ref" in field:
        return "table"
    if "enum" in field:
        return _join_alternatives([f'`"{word}"`' for word in field["enum"]])
    if "anyOf" in field:
        alternatives = [alternative for alternative in field["anyOf"] if alternative.get("type") != "null"]
        return " or ".join(dict.fromkeys(_describe_type(alternative, schema) for alternative in alternatives))
    if "prefixItems" in field:  # a tuple of fixed length, such as a size in pixels
        element_types = dict.fromkeys(_describe_type(element, schema) for element in field["prefixItems"])
        return "two " + " or ".join(_PLURALS[element_type] for element_type in element_types)
    if field.get("type") == "array":
        nouns = _describe_type(field["items"], schema).split(" or ")
        plurals = [_PLURALS.get(noun, noun.replace("list ", "lists ")) for noun in nouns]
        return "list of " + " or ".join(plurals)
    return _TYPES[field["type"]]


def _join_alternatives(words: list[str]) -> str:
    """Return words as "a, b or c"."""
    if len(words) == 1:
        return words[0]
    return ", ".join(words[:-1]) + f" or {words[-1]}"


def _describe_default(field: dict[str, Any]) -> str:
    """Return the default in a field's JSON schema as Markdown; "absent" without one, or if it is a table."""
    default = field.get("default")
    if default is None or "$ref" in field:
        return "absent"
    return f"`{msgspec.json.encode(default).decode()}`"
