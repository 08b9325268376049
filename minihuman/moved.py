"""Names that have moved: they still work where they were, with a warning that says where they are now.

A module that lost names, or a whole module that moved and left a file behind, has one line:
``__getattr__ = forward_moved_names(__name__)``. An entry stays for one version.
"""

import warnings
from collections.abc import Callable
from importlib import import_module
from typing import Any

MOVED_NAMES: dict[str, dict[str, str]] = {  # old module -> name -> new module
    "minihuman.operating_system": {
        "hash_file": "minihuman.storage.files",
        "replace_durably": "minihuman.storage.files",
        "write_atomically": "minihuman.storage.files",
    },
}


def forward_moved_names(old_module: str) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for a module that finds its moved names in their new modules."""
    new_modules = MOVED_NAMES[old_module]

    def find_moved_name(name: str) -> Any:
        if name not in new_modules:
            raise AttributeError(f"module {old_module!r} has no attribute {name!r}")
        moved = f"{old_module}.{name} has moved; import it from {new_modules[name]}"
        warnings.warn(moved, DeprecationWarning, stacklevel=2)
        return getattr(import_module(new_modules[name]), name)

    return find_moved_name
