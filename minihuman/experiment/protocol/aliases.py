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
        """Return the path in the file of a path in present names."""
        tail = ""
        while path not in self.file_paths and (step := LAST_STEP.search(path)):
            path = path[: step.start()]
            tail = step[0] + tail
        return self.file_paths.get(path, path) + tail


def use_current_names(tree: dict[str, Any]) -> CurrentNames:
    """Return a protocol file's tree with present names of fields and values; the given tree is not changed."""
    names = CurrentNames()
    names.tree = _rename_fields(tree, "", "$", "$", names)
    return names


def _rename_fields(value: Any, table: str, path: str, file_path: str, names: CurrentNames) -> Any:
    """Return a part of a protocol's tree under current names, noting in ``names`` what was renamed.

    ``path`` has the current names, and ``file_path`` those in the file.
    """
    if path != file_path:
        names.file_paths[path] = file_path
    if isinstance(value, list):
        return [
            _rename_fields(element, table, f"{path}[{place}]", f"{file_path}[{place}]", names)
            for place, element in enumerate(value)
        ]
    if isinstance(value, str):
        current_value = VALUE_ALIASES.get(table, {}).get(value)
        if current_value:
            names.renamed.append((file_path, f"is {value!r}, which is now called {current_value!r}"))
            return current_value
    if not isinstance(value, dict):
        return value
    if table.endswith(".group_overrides"):  # group -> fields of the table itself
        table = table.removesuffix(".group_overrides")
        return {
            group: _rename_fields(fields, table, f"{path}.{group}", f"{file_path}.{group}", names)
            for group, fields in value.items()
        }
    return _rename_table(value, table, path, file_path, names)


def _rename_table(fields: dict[str, Any], table: str, path: str, file_path: str, names: CurrentNames) -> dict[str, Any]:
    """Return a table under current names, noting in ``names`` what was renamed or given under both names."""
    aliases = FIELD_ALIASES.get(table, {})
    renamed = {}
    for name, inner in fields.items():
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
        renamed[current_name] = _rename_fields(inner, inner_table, inner_path, f"{file_path}.{name}", names)
    return renamed
