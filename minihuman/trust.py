"""The study folders and modules that the user trusts: worlds run Python and read files only from these.

A protocol or a log can name any module and, in a world's options, any file. Modules of known packages are always
imported, others only if the user trusts them or the folder that contains them; links are followed first. The record is
a file in the user's configuration, never in a study's folder, which may come from a stranger. It has one JSON object
per line.
"""

import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import invalidate_caches
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from minihuman.errors import MinihumanError, WorldError

KNOWN_PACKAGES = frozenset({"minihuman", "gymnasium", "minigrid", "miniworld", "ale_py"})
TRUST_VARIABLE = "MINIHUMAN_TRUST"  # modules that are trusted in this environment, with commas between
CONFIG_VARIABLE = "MINIHUMAN_CONFIG"  # the folder of the user's configuration, instead of the platform's
SOURCE_FACT = "world_sha256_"  # prefix of a session's facts: a module's name follows, and the fact is its SHA-256
_FOLDER_OPTIONS = frozenset({"assets", "patterns"})  # options of minihuman's worlds that always name a folder

Permission = bool | Callable[[str], bool]  # whether to trust, or a function that asks the user this question
NamedWorld = tuple[str, Mapping[str, Any]]  # id and options


def find_config_folder() -> Path:
    """Return the path of the user's configuration folder for minihuman, whether or not it exists."""
    if chosen := os.environ.get(CONFIG_VARIABLE):
        return Path(chosen)
    if sys.platform == "win32":
        parent = Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming")
    elif sys.platform == "darwin":
        parent = Path.home() / "Library" / "Application Support"
    else:
        parent = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    return parent / "minihuman"


@dataclass(frozen=True, slots=True)
class Trust:
    """A set of folders and modules: those that are trusted, or those that a protocol still needs to be trusted.

    Attributes:
        folders: absolute paths without links.
        modules: full names of installed modules.
    """

    folders: frozenset[Path] = frozenset()
    modules: frozenset[str] = frozenset()

    @classmethod
    def read(cls) -> "Trust":
        """Read what the user trusts, from the record and the environment.

        Raises:
            MinihumanError: if a line of the record is not valid.
            OSError: if the record cannot be read.
        """
        path = find_trust_record()
        if path.is_file():
            lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        else:
            lines = []
        entries = [_parse_entry(path, number, line) for number, line in enumerate(lines, 1) if line.strip()]
        modules = filter(None, os.environ.get(TRUST_VARIABLE, "").split(","))
        return cls(
            frozenset(Path(name) for kind, name in entries if kind == "folder"),
            frozenset({*modules, *(name for kind, name in entries if kind == "module")}),
        )

    def record(self) -> None:
        """Add these folders and modules to those that the user trusts.

        Raises:
            OSError: if the record cannot be written.
        """
        path = find_trust_record()
        recorded = Trust.read()
        new: list[dict[str, str]] = [{"folder": str(folder)} for folder in sorted(self.folders - recorded.folders)]
        new += [{"module": module} for module in sorted(self.modules - recorded.modules)]
        if new:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with path.open("a", encoding="utf-8", newline="\n") as file:  # appended, so that two programs lose nothing
                file.write("".join(f"{json.dumps(line)}\n" for line in new))

    def holds(self, path: Path) -> bool:
        """Return whether a file or folder lies in one of these folders after following its links."""
        return any(path.resolve().is_relative_to(folder) for folder in self.folders)

    def allows(self, module: str, spec: ModuleSpec) -> bool:
        """Return whether a module may be imported; ``spec`` is the specification of its outermost package."""
        return _is_known(module) or module in self.modules or any(map(self.holds, _list_module_paths(spec)))

    def __bool__(self) -> bool:
        return bool(self.folders or self.modules)

    def __str__(self) -> str:
        return " and ".join((*map(str, sorted(self.folders)), *(f"the module {name}" for name in sorted(self.modules))))


def find_trust_record() -> Path:
    """Return the path of the file that records what the user trusts, whether or not it exists."""
    return find_config_folder() / "trust.jsonl"


def _parse_entry(path: Path, number: int, line: str) -> tuple[str, str]:
    """Return the kind ("folder" or "module") and the name in a line of the record, whose number is for the error.

    Raises:
        MinihumanError: if the line is not a JSON object with one key.
    """
    try:
        ((kind, name),) = json.loads(line).items()
    except (ValueError, AttributeError):
        raise MinihumanError(
            f"{path}:{number}: {line[:60]!r} does not name a folder or module; delete this line"
        ) from None
    return str(kind), str(name)


def admit_worlds(worlds: Iterable[NamedWorld], folder: Path, permission: Permission) -> str:
    """Allow a protocol's worlds to run code and read files from its folder, if the user trusts it.

    Args:
        worlds: the worlds that the protocol names.
        folder: the protocol's folder as a path without links.
        permission: whether to trust what is not trusted yet, or a function that asks the user.

    Returns:
        The folders and modules to which the user refused trust, in words; "" if nothing was refused.

    Raises:
        OSError: if the record cannot be read or written.
    """
    worlds = list(worlds)
    untrusted = _find_untrusted(worlds, folder, Trust.read())
    if untrusted:
        question = f"This protocol runs Python or reads files from {untrusted}. Trust it?"
        is_permitted = permission(question) if callable(permission) else permission
        if not is_permitted:
            return str(untrusted)
        untrusted.record()
    if any(_find_module_file(_get_module(world), folder) for world, _ in worlds):
        _append_to_module_path(folder)
    return ""


def _find_untrusted(worlds: Iterable[NamedWorld], folder: Path, trusted: Trust) -> Trust:
    """Return what is not trusted yet: the folders of worlds' modules and files, and installed modules by name.

    Args:
        worlds: the worlds that a protocol names.
        folder: the protocol's folder as a path without links.
        trusted: what the user trusts.
    """
    folders = set[Path]()
    modules = set[str]()
    for world, options in worlds:
        module = _get_module(world)
        if module and not _is_known(module) and module not in trusted.modules:
            spec = _find_outermost_spec(module)
            local_file = _find_module_file(module, folder)
            if spec is not None:
                paths = _list_module_paths(spec)
            elif local_file is not None:
                folders.add(folder)
                paths = [local_file]
            else:
                paths = []
            for path in paths:
                if path.resolve().is_relative_to(folder):
                    folders.add(folder)
                elif spec is None:  # a link in the protocol's folder leads to another folder
                    folders.add(path.resolve().parent)
                elif not trusted.holds(path):
                    modules.add(module)
        if any(_list_path_options(options)) and _is_known(module):
            folders.add(folder)
    return Trust(frozenset(folder for folder in folders if not trusted.holds(folder)), frozenset(modules))


def locate_world(world: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return a world's options with full paths of the files in them, and make the world's module importable.

    If the module lies in a trusted folder, the folder is added to Python's module search path. A module that has
    already been imported is not checked, because its code has run.

    Raises:
        WorldError: if the module's name is not valid, or the module or a file is not trusted.
    """
    module = _get_module(world)
    if module and not _is_known(module) and module not in sys.modules:
        _locate_module(world, module)
    if not _is_known(module):
        return dict(options)  # its own code decides what it reads
    return dict(options) | {name: str(_locate_file(world, name, path)) for name, path in _list_path_options(options)}


def _locate_module(world: str, module: str) -> None:
    """Make a world's module importable, from a trusted folder if it is not installed.

    Raises:
        WorldError: if its name is not valid, it is not trusted, or trusted folders have different modules of the name.
    """
    if not all(part.isidentifier() and not part.startswith("_") for part in module.split(".")):
        raise WorldError(
            f"{world}: {module!r} is not a valid module name; "
            "write the world as module:ID, for example my_worlds:My-World-v0"
        )
    trusted = Trust.read()
    spec = _find_outermost_spec(module)
    if spec is None and module not in trusted.modules:
        folder_of_code = {path.read_bytes(): folder for folder, path in _find_folders_with_module(module, trusted)}
        if len(folder_of_code) > 1:
            folders = " and ".join(map(str, sorted(folder_of_code.values())))
            raise WorldError(
                f"{world}: {folders} both have a module {module!r}; rename one of them, or trust only one folder"
            )
        for folder in folder_of_code.values():
            _append_to_module_path(folder)
        spec = _find_outermost_spec(module)
    if spec is not None and not trusted.allows(module, spec):
        raise WorldError(
            f"{world}: the module {module!r} is not trusted; read its code, then pass --trust to `minihuman check` or "
            f"`minihuman verify`, or set {TRUST_VARIABLE}={module}"
        )


def _locate_file(world: str, name: str, path: str) -> Path:
    """Return the path of the file or folder that a world's option names, in the first trusted folder that has it.

    Raises:
        WorldError: if no trusted folder has it.
    """
    trusted = Trust.read()
    for file in (folder / path for folder in sorted(trusted.folders)):
        if file.exists() and trusted.holds(file):
            return file
    raise WorldError(
        f"{world}: {name} is {path!r}, which is not in a trusted folder; copy it to the protocol's folder, use a "
        "relative path, and pass --trust to `minihuman check`"
    )


def find_logged_sources(facts: Mapping[str, str]) -> None:
    """Make the modules of a recorded session importable from the first trusted folder that has the recorded files.

    Args:
        facts: the session's facts, which include the SHA-256 digest of each module's file.
    """
    for fact, digest in facts.items():
        module = fact.removeprefix(SOURCE_FACT)
        if module == fact or module in sys.modules or _find_outermost_spec(module) is not None:
            continue
        for folder, path in _find_folders_with_module(module, Trust.read()):
            if hashlib.sha256(path.read_bytes()).hexdigest() == digest:
                _append_to_module_path(folder)
                break


def list_world_sources(worlds: Iterable[str]) -> dict[str, Path]:
    """Return the source file of each module that provides these worlds, or that these imported from a trusted folder.

    The files are sorted by the modules' names. Installed packages are omitted, because their versions identify them.
    """
    modules = {module for module in map(_get_module, worlds) if module}
    paths = {module: _find_source_file(find_spec(module)) for module in modules}
    sources = {module: path for module, path in paths.items() if path is not None}
    if not sources:
        return {}
    trusted = Trust.read()
    roots = {_get_search_folder(name, path) for name, path in sources.items()}
    trusted_roots = {root for root in roots if trusted.holds(root)}
    for name, module in list(sys.modules.items()):
        path = _find_source_file(getattr(module, "__spec__", None))
        if path is not None and any(path.is_relative_to(root) for root in trusted_roots):
            sources[name] = path
    return dict(sorted(sources.items()))


def _get_search_folder(module: str, path: Path) -> Path:
    """Return the folder of Python's search path under which a module with a full name was imported from a file."""
    n_packages = module.count(".")
    if path.name == "__init__.py":
        n_packages += 1
    return path.parents[n_packages]


def find_changed_sources(facts: Mapping[str, str]) -> list[str]:
    """Return the names of the imported modules whose files differ from those with which a session was played.

    Args:
        facts: the session's facts, which include the SHA-256 digest of each module's file.
    """
    changed = []
    for fact, digest in facts.items():
        if not fact.startswith(SOURCE_FACT):
            continue
        module = fact.removeprefix(SOURCE_FACT)
        path = _find_source_file(getattr(sys.modules.get(module), "__spec__", None))
        if path is not None and hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            changed.append(module)
    return changed


def _find_source_file(spec: ModuleSpec | None) -> Path | None:
    """Return the path of a module's file; None if it has no file or belongs to an installed package."""
    if spec is None or not spec.origin or not spec.has_location:
        return None
    path = Path(spec.origin)
    if {"site-packages", "dist-packages"}.intersection(path.parts):
        return None
    return path


def list_foreign_modules(worlds: Iterable[str]) -> frozenset[str]:
    """Return the modules that provide these worlds, except those of known packages."""
    return frozenset(module for module in map(_get_module, worlds) if not _is_known(module))


def _get_module(world: str) -> str:
    """Return the module in a world's id ("my_worlds:My-World-v0"); "" if the id names no module."""
    module, colon, _ = world.partition(":")
    if not colon:
        return ""
    return module


def _is_known(module: str) -> bool:
    """Return whether a module belongs to a known package.

    True also for "", which means a world that is registered already, but not for ``minihuman.__main__``.
    """
    return not module or (module.partition(".")[0] in KNOWN_PACKAGES and "__" not in module)


def _list_path_options(options: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the names and values of the options that name a file or a folder."""
    for name, value in options.items():
        if isinstance(value, str) and (name in _FOLDER_OPTIONS or "/" in value or "\\" in value):
            yield name, value


def _find_outermost_spec(module: str) -> ModuleSpec | None:
    """Return the specification of a module's outermost package without running it; None if it cannot be found."""
    try:
        return find_spec(module.partition(".")[0])
    except (ImportError, ValueError):
        return None


def _list_module_paths(spec: ModuleSpec) -> list[Path]:
    """Return the paths of a module's file or a package's folders; none if the module is part of Python itself."""
    if spec.has_location and spec.origin:
        return [Path(spec.origin)]
    return [Path(location) for location in spec.submodule_search_locations or ()]


def _find_module_file(module: str, folder: Path) -> Path | None:
    """Return the path of a module's file in a folder; None if it is not there."""
    if not all(part.isidentifier() for part in module.split(".")):
        return None
    base = folder.joinpath(*module.split("."))
    return next((path for path in (base / "__init__.py", base.with_suffix(".py")) if path.is_file()), None)


def _find_folders_with_module(module: str, trusted: Trust) -> list[tuple[Path, Path]]:
    """Return the trusted folders that have a module, each with the path of the module's file, in alphabetical order."""
    candidates = [(folder, _find_module_file(module, folder)) for folder in sorted(trusted.folders)]
    return [(folder, path) for folder, path in candidates if path is not None and trusted.holds(path)]


def _append_to_module_path(folder: Path) -> None:
    """Add a folder to the end of Python's module search path, where nothing in it can replace a library."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    invalidate_caches()
