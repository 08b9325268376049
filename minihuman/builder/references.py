"""Where a protocol names parts, groups and sessions, so that a new name reaches every mention."""

from collections.abc import Iterator
from typing import Any, Literal

from minihuman.builder.document import TomlDocument
from minihuman.builder.toml_spans import Steps

Named = Literal["part", "group"]

TABLES: dict[str, Named] = {  # arrays of tables with names
    "blocks": "part",
    "pages": "part",
    "questions": "part",
    "activities": "part",
    "orders": "part",
    "groups": "group",
}
_VALUES: dict[Named, tuple[str, ...]] = {  # fields whose value is a name; * is any key or number
    "part": (
        *("groups.*.blocks.*", "groups.*.parts.*", "groups.*.replace_parts.*", "sessions.*.parts.*"),
        *("orders.*.parts.*", "orders.*.parts.*.*", "activities.*.settings.source", "questions.*.return_to"),
        *("questions.*.group_overrides.*.return_to", "analysis.block", "analysis.conditions.*"),
        *("allocation.design.settings.block", "allocation.stopping.settings.block"),
    ),
    "group": (),
}
_KEYS: dict[Named, tuple[str, ...]] = {  # tables whose keys are names
    "part": ("groups.*.replace_parts", "design.contrasts.*.weights"),
    "group": (
        *("blocks.*.group_overrides", "pages.*.group_overrides", "questions.*.group_overrides"),
        "design.contrasts.*.weights",
    ),
}
_MEASURES = ("exclusions.*.measure", "allocation.stratify_by", "analysis.covariates.*", "analysis.secondary_measures.*")


def rename(document: TomlDocument, path: Steps, name: str) -> TomlDocument:
    """Return the document with a part or group renamed at every mention, or with a session renamed in its table only.

    Args:
        document: the protocol's file.
        path: the path of the table with the name, such as ("blocks", 0).
        name: the new name.

    Raises:
        NotEditableError: if a mention cannot be edited.
    """
    old = document.find((*path, "name"))
    document = document.set((*path, "name"), name)
    named = TABLES.get(str(path[0]))
    if named is None or len(path) != 2 or not isinstance(old, str):
        return document
    for place, mention in _list_matches(document.tree, _VALUES[named]):
        if mention == old:
            document = document.set(place, name)
    for place, table in _list_matches(document.tree, _KEYS[named]):
        if isinstance(table, dict) and old in table:
            document = document.set((*place, name), table[old]).remove((*place, old))
    if named == "part":
        document = _rename_in_measures(document, old, name)
    return document


def _rename_in_measures(document: TomlDocument, old: str, name: str) -> TomlDocument:
    """Return the document with a questionnaire renamed where a measure or a stratum names it.

    A measure is "answer:QUESTIONS.ITEM"; a stratum is "QUESTIONS.ITEM" or "QUESTIONS".
    """
    for place, measure in _list_matches(document.tree, _MEASURES):
        kind, colon, question = str(measure).rpartition(":")
        questions, point, item_name = question.partition(".")
        if questions == old and (point or place == ("allocation", "stratify_by")):
            document = document.set(place, f"{kind}{colon}{name}{point}{item_name}")
    return document


def _list_matches(tree: Any, patterns: tuple[str, ...]) -> Iterator[tuple[Steps, Any]]:
    """Yield the path and the value of each match of each pattern ("groups.*.parts.*") in a protocol's values."""
    for pattern in patterns:
        yield from list_values(tree, tuple(pattern.split(".")))


def list_values(tree: Any, pattern: tuple[str, ...], path: Steps = ()) -> Iterator[tuple[Steps, Any]]:
    """Yield the paths that match a pattern, with their values.

    Args:
        tree: the values, such as a protocol's.
        pattern: the steps of a path, of which "*" matches any key or number.
        path: the path of the tree itself, with which the yielded paths begin.
    """
    if not pattern:
        yield path, tree
        return
    step = pattern[0]
    further_steps = pattern[1:]
    if isinstance(tree, dict):
        for key, member in tree.items():
            if step in ("*", key):
                yield from list_values(member, further_steps, (*path, key))
    elif isinstance(tree, list) and step == "*":
        for number, element in enumerate(tree):
            yield from list_values(element, further_steps, (*path, number))
