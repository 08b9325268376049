"""Names of actions in messages."""

from collections.abc import Sequence

_MOST_NAMES = 24  # of actions in a sentence: board games have thousands


def join_action_names(names: Sequence[str]) -> str:
    """Return the names of actions for a sentence; of very many the first, and the number of the others."""
    if len(names) <= _MOST_NAMES:
        return ", ".join(names)
    return f"{', '.join(names[:_MOST_NAMES])} and {len(names) - _MOST_NAMES:,} more"
