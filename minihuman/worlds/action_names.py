"""Names of actions in messages."""

from collections.abc import Sequence

_MAX_NAMES = 24  # action names in a sentence; board games have thousands


def join_action_names(names: Sequence[str]) -> str:
    """Return action names separated by commas; of more than 24 names, the first 24 and the number of further names."""
    if len(names) <= _MAX_NAMES:
        return ", ".join(names)
    return f"{', '.join(names[:_MAX_NAMES])} and {len(names) - _MAX_NAMES:,} more"
