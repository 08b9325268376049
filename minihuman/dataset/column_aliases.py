"""The names that table columns had in earlier versions, and their translation in queries that still use them."""

import re

COLUMN_ALIASES: dict[str, str] = {  # a column's name in earlier versions -> its name now, in every table that has it
    "left_out": "exclusion_reason",
    "in_vain": "ineffective_steps",
    "in_vain_share": "ineffective_share",
    "found_s": "discovered_s",
    "found_steps": "discovered_steps",
    "keys_found": "keys_discovered",
    "keys_to_find": "keys_total",
    "found_all_s": "all_keys_discovered_s",
}
_SQL_NAMES = re.compile(
    r"(?P<text>'(?:[^']|'')*'|(?P<quote>\$\w*\$).*?(?P=quote)|--[^\n]*|/\*.*?\*/)"  # literals, comments
    rf"|\b(?P<column>{'|'.join(COLUMN_ALIASES)})\b",
    re.DOTALL | re.IGNORECASE,
)


def use_current_columns(sql: str) -> str:
    """Replace earlier column names in a query by the current ones, leaving literals and comments unchanged."""
    return _SQL_NAMES.sub(lambda match: match["text"] or COLUMN_ALIASES[match["column"].lower()], sql)
