"""What has another name now than in the frozen tables; a value that changed is no name, and stands nowhere here."""

from minihuman.dataset.column_aliases import COLUMN_ALIASES

TABLES: dict[str, str] = {}  # a table's name then: now
COLUMNS: dict[str, str] = dict(
    COLUMN_ALIASES
)  # a column's name then, "reward" of every table or "steps.reward" of one: now
WORLDS: dict[str, str] = {}  # a world's id then, which its logs still say: the catalogue's now
