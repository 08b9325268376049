"""Names from earlier versions of protocols: fields and values that are read under their present names."""

from dataclasses import dataclass, field
from typing import Any

from minihuman.experiment.protocol.validation_errors import LAST_STEP

_PART = {"for_group": "group_overrides"}
_KEY_MAPS = {"fresh": "new", "carry": "carry_over", "kept": "constant"}
_COLUMN_TYPES = {"whole": "integer", "yes_no": "boolean"}
_MEASURES = {"in_vain_share": "ineffective_share", "found_all_s": "all_keys_discovered_s"}

FIELD_ALIASES: dict[str, dict[str, str]] = {  # table -> old name of a field -> its name now
    "study": {"break_s": "min_rest_s"},
    "keys": {"spare": "spare_keys", "check": "keyboard_check"},
    "groups": {"ratio": "allocation_ratio", "instead": "replace_parts"},
    "blocks": {
        **_PART,
        "noop": "noop_action",
        "instruction": "instructions",
        "rest": "rest_text",
        "fixed": "fixed_keys",
        "until": "stop_criterion",
        "max_s": "max_episode_s",
        "block_max_s": "max_block_s",
        "interval_ms": "inter_trial_interval_ms",
        "hold_ms": "final_frame_ms",
        "marks": "show_outcome",
    },
    "pages": {**_PART, "agree": "asks_consent", "pictures": "images"},
    "questions": {
        **_PART,
        "tries": "max_attempts",
        "wrong": "wrong_answer_text",
        "back_to": "return_to",
        "failed": "on_failure",
    },
    "activities": {"plan": "settings"},
    "sessions": {"days_after": "days_after_previous"},
    "about": {
        "ethics": "ethics_approvals",
        "acknowledge": "how_to_acknowledge",
        "task": "task_description",
        "participants": "participant_columns",
    },
    "about.participant_columns": {"meaning": "description", "kind": "type"},
    "analysis": {
        "primary": "primary_measure",
        "secondary": "secondary_measures",
        "equivalence": "equivalence_margin",
    },
    "allocation": {"stratify": "stratify_by", "cuts": "cut_points"},
    "devices": {"source": "plugin"},
    "web": {
        "picture_px": "image_size_px",
        "encoding": "image_encoding",
        "grace_s": "reconnect_timeout_s",
        "idle_s": "idle_timeout_s",
        "browsers": "allowed_browsers",
        "min_window_px": "min_window_size_px",
        "keyboard": "require_keyboard",
        "anyone": "open_access",
        "platforms": "recruitment_platforms",
        "most_at_once": "max_concurrent_sessions",
        "codes": "completion_codes",
    },
}
VALUE_ALIASES: dict[str, dict[str, str]] = {  # field -> old value -> its name now
    "blocks.key_map": _KEY_MAPS,
    "about.participant_columns.type": _COLUMN_TYPES,
    "analysis.primary_measure": _MEASURES,
    "analysis.secondary_measures": _MEASURES,
    "exclusions.measure": {
        **_MEASURES,
        "in_vain": "ineffective_steps",
        "keys_found": "keys_discovered",
        "keys_to_find": "keys_total",
    },
}


@dataclass
class CurrentNames:
    """A protocol's tree with present names, and how they relate to the names in the file.

    Attributes:
        tree: the decoded TOML with present names.
        file_paths: the path in the file by the path in present names, where the two differ.
        renamed: the path in the file and a note for each old name.
        conflicts: the path in the file and an error for each field that is given under both names.
    """

    tree: dict[str, Any] = field(default_factory=dict)
    file_paths: dict[str, str] = field(default_factory=dict)
    renamed: list[tuple[str, str]] = field(default_factory=list)
    conflicts: list[tuple[str, str]] = field(default_factory=list)

    def written_path(self, path: str) -> str:
        """Return the path with the names that the file uses, from a path in present names."""
        inner_path = ""  # the last steps of the path, whose names are the same in the file
        while path not in self.file_paths and (step := LAST_STEP.search(path)):
            path = path[: step.start()]
            inner_path = step[0] + inner_path
        return self.file_paths.get(path, path) + inner_path


def use_current_names(tree: dict[str, Any]) -> CurrentNames:
    """Return a copy of a protocol file's tree with present names of fields and values, and what was renamed."""
    names = CurrentNames()
    names.tree = _rename_fields(tree, "", "$", "$", names)
    return names


def _rename_fields(node: Any, table: str, path: str, file_path: str, names: CurrentNames) -> Any:
    """Return a node of a protocol's tree with present names.

    Args:
        node: a table, a list or a plain value.
        table: the path of the table or field in `FIELD_ALIASES` or `VALUE_ALIASES`; "" for the whole file.
        path: the node's path in present names.
        file_path: the node's path in the names of the file.
        names: receives what was renamed, and conflicts.
    """
    if path != file_path:
        names.file_paths[path] = file_path
    if isinstance(node, list):
        return [
            _rename_fields(element, table, f"{path}[{index}]", f"{file_path}[{index}]", names)
            for index, element in enumerate(node)
        ]
    if isinstance(node, str):
        current_value = VALUE_ALIASES.get(table, {}).get(node)
        if current_value:
            names.renamed.append((file_path, f"is {node!r}, which is now called {current_value!r}"))
            return current_value
    if not isinstance(node, dict):
        return node
    if table.endswith(".group_overrides"):  # group -> fields of the table itself
        table = table.removesuffix(".group_overrides")
        return {
            group: _rename_fields(fields, table, f"{path}.{group}", f"{file_path}.{group}", names)
            for group, fields in node.items()
        }
    return _rename_table(node, table, path, file_path, names)


def _rename_table(fields: dict[str, Any], table: str, path: str, file_path: str, names: CurrentNames) -> dict[str, Any]:
    """Return the fields of a table under present names, and add to ``names`` what was renamed, and conflicts.

    The arguments are those of `_rename_fields`.
    """
    aliases = FIELD_ALIASES.get(table, {})
    renamed = {}
    for name, inner_node in fields.items():
        current_name = aliases.get(name, name)
        if current_name != name and current_name in fields:
            names.conflicts.append(
                (f"{file_path}.{name}", f"is the old name of {current_name!r}, which is given too; remove it")
            )
            continue
        if current_name != name:
            names.renamed.append((f"{file_path}.{name}", f"is now called {current_name!r}"))
        inner_table = f"{table}.{current_name}".lstrip(".")
        inner_path = f"{path}.{current_name}"
        renamed[current_name] = _rename_fields(inner_node, inner_table, inner_path, f"{file_path}.{name}", names)
    return renamed
