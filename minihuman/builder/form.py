"""Forms: each table of a protocol as fields with type, sentence, example, default and unit, from the schema.

What exists is asked of the registries, so that the kinds of a laboratory's own package are among the choices.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

import msgspec

from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.questions.question import find_question_kind
from minihuman.agents.agent import AGENT_GROUP
from minihuman.builder.consent_page import load_consent_pages
from minihuman.builder.messages import Choice, FieldForm, FormField, Kinds, PartKind
from minihuman.builder.shipped_studies import find_example, list_used_fields
from minihuman.errors import ProtocolError
from minihuman.experiment.keys import BUTTON_NAMES
from minihuman.experiment.machine.activity import GROUP as ACTIVITY_GROUP, find_installed_kind
from minihuman.experiment.protocol.protocol import build_json_schema, walk_tables
from minihuman.experiment.protocol.specs import SHIPPED_FORMS
from minihuman.experiment.words import ENGLISH, LANGUAGES
from minihuman.plugins import QUESTION_GROUP, list_plugin_names
from minihuman.worlds.catalogue import TEAM_WORLDS, WORLDS

Schema = Mapping[str, Any]

_LONG_TEXTS = frozenset(
    (
        *("study.consent", "study.closing", "blocks.instructions", "blocks.feedback", "blocks.rest_text", "pages.text"),
        *("questions.wrong_answer_text", "questions.items.ask", "about.description", "about.task_description"),
        *("about.how_to_acknowledge", "design.question"),
    )
)
_UNITS = {"ms": "ms", "s": "s", "px": "px", "min": "min", "rad": "rad", "deg": "°", "bytes": "bytes"}
_OTHER_UNITS = {"sessions.days_after_previous": "days", "model.temperature": ""}
_REFERENCES: dict[str, Any] = {
    "groups.blocks": "block",
    "groups.parts": "part",
    "groups.replace_parts": "part",
    "sessions.parts": "part",
    "orders.parts": "part",
    "questions.return_to": "part",
    "analysis.block": "block",
    "analysis.conditions": "block",
    "blocks.world": "world",
    "pages.example.world": "world",
    "blocks.actions": "action",
    "blocks.distractors": "action",
    "blocks.noop_action": "action",
    "blocks.fixed_keys": "action",
    "blocks.spot.action": "action",
    "keys.pool": "key",
    "study.logo": "file",
    "study.fonts": "file",
    "pages.images": "file",
    "blocks.stimuli.file": "file",
    "blocks.timeline.stimuli.image": "file",
    "blocks.agent.policy": "file",
}
_PLUGINS = {  # fields that name a plug-in, each with its group
    "blocks.design.name": "minihuman.designs",
    "allocation.design.name": "minihuman.designs",
    "allocation.stopping.name": "minihuman.designs",
    "devices.plugin": "minihuman.devices",
    "blocks.agent.learner": "minihuman.learners",
}
_OPTIONAL_TABLES = ("agent", "team", "timeline")  # of blocks: only some kinds have them
_NEED_A_FILE = frozenset({"policy"})  # agents
_NOT_PARTS = frozenset({"page", "questions", "keyboard_check", "debrief"})  # kinds with tables of their own, or none


def build_form(table: str, kind: str = "") -> FieldForm:
    """Build the form of a table.

    Args:
        table: the table's path without numbers: "blocks", "questions.items".
        kind: the kind of part or question; "" shows the fields of all kinds.

    Raises:
        KeyError: if a protocol has no such table.
    """
    if table == "questions.items.settings":
        return _build_settings_form(table, kind)
    heading, definition = _list_tables()[table]
    used = list_used_fields(table, kind if table in ("blocks", "questions.items", "activities") else "")
    if table == "questions.items" and kind:
        used |= frozenset(find_question_kind(kind).item_fields or ())
    fields = [
        _build_field(f"{table}.{name}", field, name in definition.get("required", ()), name in used)
        for name, field in definition["properties"].items()
        if not _is_inapplicable(table, name, kind)
    ]
    return FieldForm(table, heading, _first_paragraph(definition), fields)


def list_kinds() -> Kinds:
    """Return what can be added to a study: kinds of parts and questions, languages, worlds and consent pages."""
    consents = {language: dict(page) for language, page in load_consent_pages().items()}
    parts = [
        PartKind("page", "pages", "A text to read: instructions, a pause, the last words.", {"text": ""}),
        PartKind("consent", "pages", "Purpose, storage, rights and contact, to be agreed to.", consents[ENGLISH]),
        PartKind(
            "questions", "questions", "A questionnaire, or a quiz with right answers.", {"title": "", "items": []}
        ),
        PartKind(
            "order", "orders", "Parts in an order of the participant's own.", {"parts": [], "order": "latin-square"}
        ),
    ]
    for name in list_plugin_names(ACTIVITY_GROUP):
        installed = find_installed_kind(name)
        if installed is None or name in _NOT_PARTS:
            continue
        table = "blocks" if issubclass(installed.plan, PlayPlan) else "activities"
        parts.append(PartKind(name, table, _first_line(installed.plan), _build_new_part(table, name)))
    questions = [_describe_question_kind(name) for name in list_plugin_names(QUESTION_GROUP)]
    worlds = [Choice(world.id, world.summary) for world in (*WORLDS, *TEAM_WORLDS)]
    return Kinds(parts, questions, list(LANGUAGES), worlds, consents)


def _describe_question_kind(name: str) -> PartKind:
    kind = find_question_kind(name)
    summary = kind.prompt or _first_line(kind.draft)
    return PartKind(name, "questions.items", summary, {"kind": name, "ask": "", **kind.example})


def _build_new_part(table: str, kind: str) -> dict[str, Any]:
    """Return the fields of a new part of a kind: those of a shipped example, without its name, overrides and seeds.

    If no shipped protocol has this kind in the table, the kind is the only field.
    """
    new = find_example(table, kind) or {"kind": kind}
    for name in ("name", "group_overrides", "seeds"):
        new.pop(name, None)
    return new


@cache
def _list_tables() -> dict[str, tuple[str, Schema]]:
    """Return the TOML heading and the JSON schema of each table of a protocol, by its path without numbers."""
    tables: dict[str, tuple[str, Schema]] = {}
    for table, definition, is_repeated in walk_tables(build_json_schema()):
        tables[table] = (f"[[{table}]]" if is_repeated else f"[{table}]", definition)
    return tables


def _is_inapplicable(table: str, name: str, kind: str) -> bool:
    """Return whether a field is one of a block's optional tables that the block's kind does not use."""
    if table != "blocks" or name not in _OPTIONAL_TABLES or not kind:
        return False
    installed = find_installed_kind(kind)
    return installed is not None and name not in installed.plan_fields


def _build_field(path: str, schema: Schema, is_required: bool, is_common: bool) -> FormField:
    """Build the field of a form from its path without numbers ("blocks.world") and its JSON schema.

    A field that is required or common is shown before the others.
    """
    options = [option for option in schema.get("anyOf", [schema]) if option.get("type") != "null"]
    name = path.rpartition(".")[2]
    types = [_name_type(path, option) for option in options]
    default = schema.get("default")
    return FormField(
        name=name,
        type=types[0],
        item=_name_element_type(options[0]),
        alternatives=types[1:],
        required=is_required,
        default=default,
        sentence=schema.get("description", ""),
        example=next(iter(schema.get("examples", ())), None),
        unit=_find_unit(path),
        choices=_list_choices(path, options),
        references=_REFERENCES.get(path, ""),
        table=path if types[0] in ("table", "tables") and path in _list_tables() else "",
        common=is_required or is_common,
    )


def _find_unit(path: str) -> str:
    """Return the unit of a field, which the end of its name says ("rest_ms"); "" if it has none."""
    if path in _OTHER_UNITS:
        return _OTHER_UNITS[path]
    stem, _, suffix = path.rpartition(".")[2].rpartition("_")
    return _UNITS.get(suffix, "") if stem else ""


def _name_type(path: str, schema: Schema) -> Any:
    """Return the name of a field's type, by which the form chooses its input."""
    if "$ref" in schema:
        return "table"
    if "enum" in schema:
        return "choice"
    match schema.get("type"):
        case "array" if "prefixItems" in schema:
            return "pair"
        case "array" if "$ref" in schema.get("items", {}):
            return "tables"
        case "array":
            return "list"
        case "object":
            return "map"
        case "string" if path in _LONG_TEXTS:
            return "text"
        case "string" | "integer" | "number" | "boolean" as name:
            return name
    return "any"


def _name_element_type(schema: Schema) -> str:
    """Return the name of the type of the elements of a list, a pair or a map; "" for other types."""
    if "prefixItems" in schema:
        return str(schema["prefixItems"][0]["type"])
    inner = schema.get("items") or schema.get("additionalProperties") or {}
    if not isinstance(inner, Mapping) or "$ref" in schema:
        return ""
    first: Schema = next(iter(inner.get("anyOf", [inner])), {})
    if "enum" in first:
        return "string"
    names = {"array": "list", "object": "map"}
    name = str(first.get("type", ""))
    if not name and schema.get("type") in ("array", "object"):
        return "any"
    return names.get(name, name)


def _list_choices(path: str, options: list[Schema]) -> list[Choice]:
    """Return the values that a field accepts: its fixed words, and the names of what is installed; [] for any value.

    ``options`` has the JSON schema of each type that the field may have.
    """
    values: list[Any] = []
    for option in options:
        values += option.get("enum", ()) or (option.get("items") or {}).get("enum", ())
    if path in _PLUGINS:
        values += list_plugin_names(_PLUGINS[path])
    match path:
        case "study.language":
            values += LANGUAGES
        case "questions.form":
            values += SHIPPED_FORMS
        case "questions.items.kind":
            values += list_plugin_names(QUESTION_GROUP)
        case "keys.pool":
            values += BUTTON_NAMES
        case "blocks.team.seats":
            values += ["person", *_list_agents(), "planner"]
        case "blocks.team.stand_in":
            values += _list_agents()
        case "blocks.kind" | "activities.kind":
            table = path.partition(".")[0]
            values += [part.kind for part in list_kinds().parts if part.table == table]
    return [Choice(value, str(value)) for value in values]


def _list_agents() -> list[str]:
    """Return the scripted agents that can hold a seat without a file."""
    return [f"scripted:{name}" for name in list_plugin_names(AGENT_GROUP) if name not in _NEED_A_FILE]


def _build_settings_form(table: str, kind: str) -> FieldForm:
    """Build the form of the settings of a kind of question; without fields if the kind is unknown or has none."""
    try:
        settings = find_question_kind(kind).settings
    except ProtocolError:
        settings = None
    if settings is None:
        return FieldForm(table, f"[{table}]", "", [])
    schema = msgspec.json.schema(settings)
    definition = schema["$defs"][settings.__name__]
    fields = [
        # all settings are common, so that the form shows them at once
        _build_field(f"{table}.{name}", field, name in definition.get("required", ()), True)
        for name, field in definition["properties"].items()
    ]
    return FieldForm(table, f"[{table}]", _first_paragraph(definition), fields)


def _first_paragraph(definition: Schema) -> str:
    return str(definition.get("description", "")).partition("\n\n")[0].replace("\n", " ")


def _first_line(described: object) -> str:
    """Return the first line of the docstring of a class or function."""
    return (described.__doc__ or "").partition("\n")[0]
