"""Modules and names that have moved: each old name still works, warns, and goes with the next version.

One finder makes an empty module for an old module's name; each attribute that is asked of it comes from the new place.
A module that is still there and lost a name has the line ``__getattr__ = forward_moved_names(__name__)``.
"""

import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

MOVED_MODULES: dict[str, tuple[str, ...]] = {  # an old name -> the modules among which its contents are now
    "minihuman.admin.lease": ("minihuman.storage.lease", "minihuman.log.record.session_leases"),
    "minihuman.admin.remote_store": (
        "minihuman.storage.remote_store",
        "minihuman.admin.remote_logs",
        "minihuman.dataset.remote_tables",
    ),
    "minihuman.dataset.journal": (
        "minihuman.storage.journal",
        "minihuman.storage.file_journal",
        "minihuman.storage.study_journals",
    ),
    "minihuman.dataset.journal_postgres": ("minihuman.storage.postgres_journal", "minihuman.storage.database"),
    "minihuman.log.system": ("minihuman.storage.system", "minihuman.storage.durable_files"),
}
MOVED_NAMES: dict[str, dict[str, str]] = {  # a module that is still there -> a name that it had -> where that is now
    "minihuman.agents.goal_search": {
        "build_kitchen_search": "minihuman.agents.search_choice",
        "build_search": "minihuman.agents.search_choice",
    },
    "minihuman.dataset.sessions": {
        "IncludedEpisode": "minihuman.dataset.included_episodes",
        "IncludedEpisodes": "minihuman.dataset.included_episodes",
    },
    "minihuman.operating_system": {
        "hash_file": "minihuman.storage.durable_files",
        "replace_durably": "minihuman.storage.durable_files",
        "write_atomically": "minihuman.storage.durable_files",
    },
}


def find_moved(old_module: str, name: str) -> tuple[str, Any]:
    """Find the module that a name of an old module is in now, and what it names.

    Raises:
        AttributeError: if no module has it.
    """
    for new_module in MOVED_MODULES[old_module]:
        module = import_module(new_module)
        if hasattr(module, name):
            return new_module, getattr(module, name)
    raise AttributeError(f"module {old_module!r} has no attribute {name!r}")


class _MovedModule(ModuleType):
    """A module without contents of its own."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # the import system looks for some
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        new_module, contents = find_moved(self.__name__, name)
        warnings.warn(
            f"{self.__name__}.{name} is now {new_module}.{name}; the old name goes with the next version",
            DeprecationWarning,
            stacklevel=2,
        )
        return contents


class _MovedLoader(Loader):
    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Make the empty module."""
        return _MovedModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing: it has no code."""


class MovedModuleFinder(MetaPathFinder):
    """Finds the old names, after every finder of files."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a module that has moved; None for every other name."""
        if fullname not in MOVED_MODULES:
            return None
        is_package = any(name.startswith(f"{fullname}.") for name in MOVED_MODULES)
        return ModuleSpec(fullname, _MovedLoader(), is_package=is_package)


def support_old_names() -> None:
    """Let the import system find the old names."""
    if not any(isinstance(finder, MovedModuleFinder) for finder in sys.meta_path):
        sys.meta_path.append(MovedModuleFinder())


def forward_moved_names(old_module: str) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for a module that finds the names that it lost."""
    new_modules = MOVED_NAMES[old_module]

    def find_moved_name(name: str) -> Any:
        if name not in new_modules:
            raise AttributeError(f"module {old_module!r} has no attribute {name!r}")
        new_name = f"{new_modules[name]}.{name}"
        warnings.warn(
            f"{old_module}.{name} is now {new_name}; the old name goes with the next version",
            DeprecationWarning,
            stacklevel=2,
        )
        return getattr(import_module(new_modules[name]), name)

    return find_moved_name
