"""What stands behind a session's log: whether its steps were proved as they came, or only afterwards."""

from collections.abc import Mapping
from typing import Literal

COLLECTED = "collected"  # the fact that says where a session's steps were made first
PAGE = "page"  # in a page without a server
Evidence = Literal["witnessed", "consistent"]


def find_evidence(facts: Mapping[str, str]) -> Evidence:
    """Return ``consistent`` for a page's own data, which were imported, ``witnessed`` for a session that was run."""
    if facts.get(COLLECTED) == PAGE:
        return "consistent"
    return "witnessed"
