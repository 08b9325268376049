"""Decode a protocol file strictly into a `Protocol`, and build its JSON schema. Knows no participants and no file
system.

The schema's tables are there field by field, with type, default, meaning and an example.
"""

import difflib
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Any

import msgspec

from minihuman.activities.trials.plan import StimuliSpec
from minihuman.errors import ProtocolError
from minihuman.experiment.keys import BUTTON_NAMES, KEY_NAMES_TEXT, PAD_AXES, RESERVED_KEYS
from minihuman.experiment.protocol import specs, strata
from minihuman.experiment.protocol.aliases import use_current_names
from minihuman.experiment.protocol.consistency import (
    check_carried_key_maps,
    check_design,
    check_newer_design_rules,
    is_played_alone,
)
from minihuman.experiment.protocol.design_spec import check_study_design
from minihuman.experiment.protocol.model import (
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
    select_errors,
)

MAX_SEED = 2**63 - 1  # TOML's integers are 64-bit signed


MAX_ALLOCATED_BLOCKS = 1_000_000  # of all participants: the allocation list draws keys for each


_FORMAT = re.compile(r"[<>^=+\- ,]{0,3}\d{0,3}(\.\d{1,2})?[a-z%]?")  # of a number or word in a text


_Rules = Callable[[Protocol], Iterable[FieldError]]


def decode_protocol(toml: bytes, source: str = "protocol", files: Mapping[str, bytes] | None = None) -> Protocol:
    """Read a protocol file's bytes; ``source`` names the file in errors, ``files`` are those it names beside itself.

    Raises:
        ProtocolError: of every mistake, a line each with file, line, path, value and the way out.
    """
    return _decode(toml, source, files or {}, (_check_values, _check_newer_rules))


def decode_logged_protocol(toml: bytes, source: str = "the protocol in a log") -> Protocol:
    """Read the protocol that a session was played by; it need not keep rules that came after it.

    Raises:
        ProtocolError: as ``decode``.
    """
    return _decode(toml, source, {}, (_check_values,))


def _decode(toml: bytes, source: str, files: Mapping[str, bytes], rules: Sequence[_Rules]) -> Protocol:
    try:
        return _decoded(toml, source, files, rules)
    except ProtocolError:
        raise
    except Exception as error:  # a file can be written to make a parser raise anything: nesting, huge numbers
        said = str(error).splitlines()[0] if str(error) else ""
        raise ProtocolError(f"{source}: cannot be read: {type(error).__name__}: {said[:200]}") from error


def _decoded(toml: bytes, source: str, files: Mapping[str, bytes], rules: Sequence[_Rules]) -> Protocol:
    try:
        text = toml.decode("utf-8-sig")  # an editor may begin the file with a byte-order mark
        tree = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise ProtocolError(f"{source}: byte {error.start} is not valid UTF-8; save the file as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise ProtocolError(f"{source}: this is not valid TOML: {error}") from None
    names = use_current_names(tree)
    wrong = [*names.conflicts, *find_structural_errors(names.tree, Protocol)]
    if not wrong:
        protocol = msgspec.convert(names.tree, Protocol)
        wrong = [complaint for rule in rules for complaint in rule(protocol)]
    written = [(names.written_path(path), what) for path, what in wrong]
    if mistakes := build_protocol_error(written, source=source, text=text, tree=tree):
        raise mistakes
    return msgspec.structs.replace(protocol, toml=toml, files=dict(files))


def _check_values(protocol: Protocol) -> list[FieldError]:
    """Every (path, complaint) about values that have the right type but make no study."""
    return [
        *_check_study(protocol.study),
        *_check_keys(protocol.keys),
        *_check_groups(protocol),
        *check_each("blocks", protocol.blocks, lambda block: _check_block(block, protocol)),
        *(
            (f"$.blocks[{number}].{field}", complaint)
            for number, block in enumerate(protocol.blocks)
            for field, complaint in _check_unused_block_fields(block, protocol.keys)
        ),
        *check_design(protocol),
        *specs.check_about(protocol.about),
        *specs.check_analysis(
            protocol.analysis,
            tuple(block.name for block in protocol.blocks),
            practice=tuple(block.name for block in protocol.blocks if not block.analysed),
        ),
        *_check_study_design(protocol),
        *strata.check_allocation(protocol),
        *specs.check_devices(protocol.devices),
        *specs.check_web(protocol.web),
        *specs.check_model(protocol.model),
        *(
            (f"$.exclusions[{number}]", "has neither below nor above; give one of them")
            for number, rule in enumerate(protocol.exclusions)
            if rule.below is None and rule.above is None
        ),
    ]


def _check_newer_rules(protocol: Protocol) -> list[FieldError]:
    """The same, by rules without which studies were run before there were any."""
    return [
        *check_each_override("blocks", protocol.blocks, lambda block: _check_block(block, protocol)),
        *check_carried_key_maps(protocol),
        *_check_allocation_size(protocol),
        *check_newer_design_rules(protocol),
    ]


def _check_study_design(protocol: Protocol) -> list[FieldError]:
    return list(
        check_study_design(
            protocol.design,
            compared_blocks=() if protocol.analysis.condition_label else protocol.analysis.conditions,
            options_by_block={block.name: block.options for block in protocol.blocks},
            has_groups=len(protocol.groups) > 1,
        )
    )


def _check_study(study: StudySpec) -> list[FieldError]:
    return select_errors(
        [
            (not specs.NAME_PATTERN.fullmatch(study.name), "$.study.name", f"is {study.name!r}; {specs.NAME_RULE}"),
            (not 0 <= study.seed <= MAX_SEED, "$.study.seed", f"is {study.seed}; a seed is 0 or more"),
            (
                not 1 <= study.participants <= 100_000,
                "$.study.participants",
                f"is {study.participants}; use 1 to 100000",
            ),
            (
                not 0 <= study.min_rest_s <= 86_400,
                "$.study.min_rest_s",
                f"is {study.min_rest_s}; a rest is 0 to 86400 s",
            ),
        ]
    )


def _check_allocation_size(protocol: Protocol) -> list[FieldError]:
    count = protocol.study.participants
    blocks = max(len(protocol.blocks), *(len(one.blocks) for one in protocol.groups))
    if count * blocks <= MAX_ALLOCATED_BLOCKS:
        return []
    return [("$.study.participants", f"is {count} with {blocks} blocks each; ask for {MAX_ALLOCATED_BLOCKS // blocks}")]


def _check_keys(keys: KeysSpec) -> list[FieldError]:
    found = []
    for number, key in enumerate(keys.pool):
        if key not in BUTTON_NAMES:
            close = difflib.get_close_matches(key, BUTTON_NAMES, n=1)
            if close:
                hint = f"did you mean {close[0]!r}?"
            else:
                hint = f"keys are called {KEY_NAMES_TEXT}"
            found.append((f"$.keys.pool[{number}]", f"is {key!r}, which is not a key; {hint}"))
        elif key in RESERVED_KEYS:
            found.append((f"$.keys.pool[{number}]", f"is {key!r}, which the session itself uses; choose another"))
        elif key in keys.pool[:number]:
            found.append((f"$.keys.pool[{number}]", f"is {key!r} again; name each key once"))
    return found


def _check_groups(protocol: Protocol) -> list[FieldError]:
    if not protocol.groups:
        return [("$.groups", "is empty; a study has one group or more")]
    if not protocol.blocks and not protocol.lists_parts:
        return [("$.blocks", "is empty; a study has one block or more, or parts that are not played")]
    found = [*specs.check_names("groups", protocol.groups), *specs.check_names("blocks", protocol.blocks)]
    names = [block.name for block in protocol.blocks]
    for number, group in enumerate(protocol.groups):
        if not group.blocks and not protocol.lists_parts:
            found.append((f"$.groups[{number}].blocks", "is empty; a group plays one block or more"))
        for place, name in enumerate(group.blocks):
            if name not in names:
                path = f"$.groups[{number}].blocks[{place}]"
                found.append((path, f"is {name!r}, which is not a block; blocks: {', '.join(names)}"))
    return found


def _check_block(block: BlockSpec, protocol: Protocol) -> list[FieldError]:
    pool = len(protocol.keys.pool)
    twice = [name for name, count in Counter(block.actions + block.distractors).items() if count > 1]
    deals_out = protocol.keys.spare_keys == "distractor"
    stimuli = block.stimuli
    found = select_errors(
        [
            (not block.world, "world", "is empty; `minihuman worlds` lists ours"),
            (not 1 <= block.episodes <= 10_000, "episodes", f"is {block.episodes}; an episode count is 1 to 10000"),
            (not 1 <= block.max_steps <= 1_000_000, "max_steps", f"is {block.max_steps}; use 1 to 1000000"),
            (not block.actions, "actions", "is empty; name the actions that get a key"),
            (twice, "actions", f"and distractors name {', '.join(map(repr, twice))} twice; name each once"),
            (
                len(block.actions) > pool,
                "actions",
                f"has {len(block.actions)} for {pool} keys in $.keys.pool; add keys",
            ),
            (
                deals_out and not block.distractors,
                "distractors",
                "is empty, but $.keys.spare_keys is 'distractor'; name the actions to deal out",
            ),
            (
                block.pace == "real_time" and not 5 <= block.step_period_ms <= 60_000,
                "step_period_ms",
                f"is {block.step_period_ms}; real_time needs 5 to 60000 ms",
            ),
            (
                not 0 <= block.response_deadline_ms <= 3_600_000,
                "response_deadline_ms",
                f"is {block.response_deadline_ms:g}; use 0 to 3600000 ms",
            ),
            (
                stimuli is not None and bool(stimuli.file) == bool(stimuli.rows),
                "stimuli",
                "needs a file or rows, and not both",
            ),
            *_check_order(stimuli),
        ]
    )
    if isinstance(block.seeds, tuple):
        if len(block.seeds) != block.episodes:
            found.append(("seeds", f"has {len(block.seeds)} seeds for {block.episodes} episodes; give one an episode"))
        if any(not 0 <= seed <= MAX_SEED for seed in block.seeds):
            found.append(("seeds", "has a negative seed; a seed is 0 or more"))
    for text in [block.feedback] if isinstance(block.feedback, str) else block.feedback.values():
        try:
            _check_placeholders(text)
            text.format(outcome="", reward=0.0, steps=0, episode=0, episodes=0, points=0.0, total=0.0)
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            fields = "outcome, reward, steps, episode, episodes, points, total"
            found.append(("feedback", f"has a bad placeholder ({error}); use {fields}"))
    return found


def _check_unused_block_fields(block: BlockSpec, keys: KeysSpec) -> list[FieldError]:
    """What is given and does nothing."""
    on_key = block.pace == "on_key"
    real_time = block.pace == "real_time"
    deadline = block.response_deadline_ms
    kind = f"is for blocks that are played, not for kind {block.kind!r}; remove it"
    binds_devices = bool(block.axes or block.spot)
    is_for_agents = binds_devices and not is_played_alone(block.kind)
    return select_errors(
        [
            (
                keys.spare_keys == "ignore" and block.distractors,
                "distractors",
                "has actions, but $.keys.spare_keys is 'ignore'; set it to 'distractor'",
            ),
            (
                on_key and (block.step_period_ms or (block.noop_action and not deadline)),
                "pace",
                "is 'on_key', which has no step_period_ms and no noop_action; remove them or use 'real_time'",
            ),
            (
                on_key and block.hold != "once",
                "hold",
                "is for 'real_time'; in 'on_key' each press is a step: remove it, or see auto_repeat",
            ),
            (
                real_time and deadline,
                "response_deadline_ms",
                "is for 'on_key'; in 'real_time' a tick decides: remove it",
            ),
            (
                deadline and block.noop_action is None,
                "response_deadline_ms",
                "needs noop_action, which is done at the deadline; name one",
            ),
            (
                on_key and block.stimulus_onset != "world",
                "stimulus_onset",
                "is for 'real_time'; in 'on_key' every picture is an onset; remove it",
            ),
            (block.axes and is_for_agents, "axes", kind),
            (block.spot and is_for_agents, "spot", kind),
            (
                block.axes and block.hold != "repeat",
                "axes",
                "are read at each tick; use pace = 'real_time' and hold = 'repeat'",
            ),
            (
                block.spot and block.hold == "repeat",
                "spot",
                "is an action of its own, but held keys combine; use hold = 'once'",
            ),
            *(
                (axis not in PAD_AXES, "axes", f"has {axis!r}, which is no axis; axes: {', '.join(PAD_AXES)}")
                for axis in block.axes
            ),
            (real_time and block.auto_repeat, "auto_repeat", "is for 'on_key'; in 'real_time' a tick decides"),
        ]
    )


def _check_order(stimuli: StimuliSpec | None) -> list[tuple[object, str, str]]:
    """The rules of the order of a table of stimuli."""
    if stimuli is None:
        return []
    is_ordered = bool(stimuli.balanced_by or stimuli.max_run)
    return [
        (
            is_ordered and stimuli.order == "fixed",
            "stimuli.order",
            "is 'fixed', but balanced_by and max_run draw one; use 'shuffled'",
        ),
        *(
            (most < 1, "stimuli.max_run", f"has {column} = {most}; use 1 or more")
            for column, most in stimuli.max_run.items()
        ),
    ]


def _check_placeholders(text: str) -> None:
    """Refuse placeholders that are more than a field and a short format: they could ask for a text of any size.

    Raises:
        ValueError: if there is one.
    """
    for _, field, format_spec, conversion in Formatter().parse(text):
        if field is not None and (not field.isidentifier() or conversion or not _FORMAT.fullmatch(format_spec or "")):
            raise ValueError(f"{{{field}{':' if format_spec else ''}{format_spec}}}")


def list_old_names(protocol: Protocol, source: str) -> list[str]:
    """A line per old name of a field or value that a protocol's file uses, with its name now; none in a new file."""
    text = protocol.toml.decode("utf-8-sig")
    tree = tomllib.loads(text)
    return format_field_errors(use_current_names(tree).renamed, source=source, text=text, tree=tree)


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
