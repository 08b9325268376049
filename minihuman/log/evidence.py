"""The evidence behind a session's log: whether its steps were verified as they arrived, or only afterwards."""

from collections.abc import Mapping
from typing import Literal

COLLECTED = "collected"  # the fact that names where a session's steps were computed first
PAGE = "page"  # in a page without a server
Evidence = Literal["witnessed", "consistent"]


def find_evidence(facts: Mapping[str, str]) -> Evidence:
    """Return "consistent" for a session that was imported from a page, and "witnessed" for one that was run here.

    Args:
        facts: the facts that the session's log states about the station.
    """
    if facts.get(COLLECTED) == PAGE:
        return "consistent"
    return "witnessed"
