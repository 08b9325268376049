"""Plans of keyboard checks."""

import msgspec


class KeyboardCheckPlan(msgspec.Struct, frozen=True):
    """The keys that are asked for."""

    keys: tuple[str, ...]
