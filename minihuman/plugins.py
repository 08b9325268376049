"""Plug-ins: objects such as simulated participants, windows and exporters that are found by name.

A package registers them as entry points of a group, such as `[project.entry-points."minihuman.exporters"]`. The module
also limits the time that their code may take, and describes their failures without content that a log must not hold.
"""

import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, wraps
from importlib.metadata import EntryPoint, EntryPoints, distributions, entry_points
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from minihuman.errors import MinihumanError
from minihuman.operating_system import interrupt_after

Port = TypeVar("Port")
DISTRIBUTION = "minihuman-lab"  # this package, as pip knows it: the name in pyproject.toml
GROUP_PREFIX = "minihuman."
QUESTION_GROUP = f"{GROUP_PREFIX}questions"  # kinds of question, whose words are loaded beneath the kinds
EXTRA_OF_PACKAGE = {
    "torch": "learn",
    "stable_baselines3": "learn",
    "minari": "export",
    "pyarrow": "export",
    "datasets": "export",
    "pylsl": "lsl",
}


@dataclass(frozen=True, slots=True)
class Plugin:
    """An object that is found by name, and the package that provides it."""

    group: str  # "players"
    name: str
    where: str  # "module:attribute"
    package: str  # "minihuman-lab 0.1.0"


def list_plugins() -> tuple[Plugin, ...]:
    """Return every installed plug-in, sorted by group and name."""
    installed = {
        Plugin(entry.group.removeprefix(GROUP_PREFIX), entry.name, entry.value, f"{package.name} {package.version}")
        for package in distributions()
        for entry in package.entry_points
        if entry.group.startswith(GROUP_PREFIX)
    }
    return tuple(sorted(installed, key=lambda plugin: (plugin.group, plugin.name, plugin.package)))


def list_plugin_names(group: str, *, built_in: bool = False) -> tuple[str, ...]:
    """Return the sorted names in a group ("minihuman.players"); with ``built_in``, only those of this package."""
    return _list_names(group, GROUP_PREFIX if built_in else "", tuple(sys.path))


@cache
def _list_names(group: str, module: str, path: tuple[str, ...]) -> tuple[str, ...]:
    """Return the sorted names of a group's entries whose modules begin with ``module``; ``path`` is ``sys.path``.

    The result is cached for each ``sys.path``, because one command calls this function hundreds of times.
    """
    return tuple(sorted({entry.name for entry in _load_group(group, path) if entry.value.startswith(module)}))


def _find_entry_points(group: str, name: str = "") -> tuple[EntryPoint, ...]:
    """Return the entry points of a group that have a name; all of the group if the name is ""."""
    return tuple(entry for entry in _load_group(group, tuple(sys.path)) if not name or entry.name == name)


@cache
def _load_group(group: str, path: tuple[str, ...]) -> EntryPoints:
    """Return the entry points of a group; cached for each ``path`` (``sys.path``), because reading takes 5 ms."""
    return entry_points(group=group)


def load_plugin(group: str, name: str, error: Callable[[str], MinihumanError], *, noun: str) -> Any:
    """Load the object that is registered under a name.

    Args:
        group: the entry-point group, such as "minihuman.players".
        name: the plug-in's name.
        error: the function that creates the error to raise from its message.
        noun: the kind of plug-in as the message names it, such as "player".

    Raises:
        MinihumanError: as created by ``error``, if no object or several have the name, or it cannot be imported.
    """
    candidates = sorted(set(_find_entry_points(group, name=name)), key=lambda entry: entry.value)
    if not candidates:
        raise error(f"{noun} {name!r} is unknown; it is one of {', '.join(list_plugin_names(group))}")
    if len(candidates) > 1:
        owners = " and ".join(f"{entry.value} ({_format_package(entry)})" for entry in candidates)
        raise error(f"{noun} {name!r} is registered twice, by {owners}; uninstall or rename one")
    (entry_point,) = candidates
    try:
        return entry_point.load()
    except ImportError as failed:
        remedy = _find_remedy(failed) or f"repair {_format_package(entry_point)}"
        raise error(f"{noun} {name!r} ({entry_point.value}) cannot be imported: {failed}; {remedy}") from failed
    except AttributeError as failed:
        package = _format_package(entry_point)
        raise error(f"{noun} {name!r}: {entry_point.value} does not exist; repair {package}") from failed


def _find_remedy(error: ImportError) -> str:
    """Return the advice to install the extra of minihuman that has a missing package; "" if no extra has it."""
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return ""
    extra = EXTRA_OF_PACKAGE.get(error.name.partition(".")[0])
    return f"install minihuman with its extra {extra!r}" if extra else ""


def read_plugin_file(group: str, name: str, file: str) -> str | None:
    """Read a text file that lies beside the module of a plug-in, without loading the module.

    Returns:
        The text; None if there is no such file, if the module is in no package, or if no plug-in or more than one has
        the name. `load_plugin` raises an error that explains the last two cases.
    """
    candidates = set(_find_entry_points(group, name=name))
    if len(candidates) != 1:
        return None
    package, _, _ = candidates.pop().module.rpartition(".")
    if not package:  # a top-level module has no folder that only its own files are in
        return None
    try:
        path = files(package) / file
    except ImportError:
        return None
    if not path.is_file():
        return None
    return path.read_text(encoding="utf-8")


def remember_by_name(find: Callable[[str], Port]) -> Callable[[str], Port]:
    """Return a function that does the same as ``find``, but caches what it returns for each name and ``sys.path``."""

    @cache
    def find_cached(name: str, path: tuple[str, ...]) -> Port:  # the path is only part of the cache's key
        return find(name)

    @wraps(find)
    def find_for_current_path(name: str) -> Port:
        return find_cached(name, tuple(sys.path))

    return find_for_current_path


def make_plugin(
    group: str, name: str, port: type[Port], error: Callable[[str], MinihumanError], *arguments: Any, noun: str
) -> Port:
    """Create the plug-in ``KIND:TEXT`` by calling the registered object ``KIND`` with ``TEXT`` and ``arguments``.

    Args:
        group: the entry-point group, such as "minihuman.players".
        name: the plug-in's name, which a colon and a text can follow; without them, the text is "".
        port: the class of which the plug-in must be an instance.
        error: the function that creates the error to raise from its message.
        *arguments: the arguments after the text.
        noun: the kind of plug-in as the message names it, such as "player".

    Raises:
        MinihumanError: as created by ``error``, under the conditions of `call_plugin`.
    """
    kind, _, argument = name.partition(":")
    return call_plugin(group, kind, port, error, argument, *arguments, noun=noun)


def call_plugin(
    group: str,
    name: str,
    port: type[Port],
    error: Callable[[str], MinihumanError],
    *arguments: Any,
    noun: str,
    **settings: Any,
) -> Port:
    """Create a plug-in by calling the object that is registered under a name.

    Args:
        group: the entry-point group, such as "minihuman.players".
        name: the plug-in's name.
        port: the class of which the plug-in must be an instance.
        error: the function that creates the error to raise from its message.
        *arguments: the positional arguments of the call.
        noun: the kind of plug-in as the message names it, such as "player".
        **settings: the keyword arguments of the call.

    Raises:
        MinihumanError: as created by ``error``, under the conditions of `load_plugin`, or if the object is not a
            ``port``.
    """
    plugin = load_plugin(group, name, error, noun=noun)(*arguments, **settings)
    if isinstance(plugin, port):
        return plugin
    (entry, *_) = _find_entry_points(group, name=name)
    raise error(
        f"{entry.value} ({_format_package(entry)}) makes a {type(plugin).__name__}; "
        f"a plug-in of {group!r} must make a {port.__module__}.{port.__qualname__}"
    )


def _format_package(entry: EntryPoint) -> str:
    """Return the name and version of the package that registers a plug-in."""
    if entry.dist is None:
        return "an unknown package"
    return f"{entry.dist.name} {entry.dist.version}"


def read_settings(
    text: str,
    defaults: Mapping[str, Any],
    error: Callable[[str], MinihumanError],
    *,
    owner: str,
    aliases: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Read the settings after a plug-in's colon, such as ``updates=400,batch_size=32``.

    Args:
        text: the text after the colon.
        defaults: every setting with its default, which determines the value's type; a boolean is given as 0 or 1.
        error: the function that creates the error to raise from its message.
        owner: the plug-in's name, for the message.
        aliases: the earlier names of settings, with their current names.

    Returns:
        The settings that the text contains.

    Raises:
        MinihumanError: as created by ``error``, if there is no such setting, or a value is not a number.
    """
    values: dict[str, Any] = {}
    for part in filter(None, text.split(",")):
        setting, _, number = part.partition("=")
        name = (aliases or {}).get(setting, setting)
        if name not in defaults:
            raise error(f"{owner} has no setting {setting!r}; use {', '.join(defaults)}")
        kind = type(defaults[name])
        try:
            values[name] = bool(int(number)) if kind is bool else kind(number)
        except ValueError:
            raise error(f"{owner}: setting {setting} is {number!r}; use a number") from None
    return values


ANSWER_TIMEOUT_S = 60.0


@contextmanager
def limit_answer_time() -> Iterator[None]:
    """Interrupt Python code that takes longer than ``ANSWER_TIMEOUT_S``.

    This works only in the main thread and on systems with interval timers (not on Windows); elsewhere there is no
    limit.

    Raises:
        TimeoutError: in the enclosed code, if it takes longer.
    """
    with interrupt_after(ANSWER_TIMEOUT_S):
        yield


def locate_error(error: BaseException) -> str:
    """Return the file name and line where an error was raised, without the folder; "" if it has no traceback."""
    frames = traceback.extract_tb(error.__traceback__)
    if frames:
        return f"{Path(frames[-1].filename).name}:{frames[-1].lineno}"
    return ""


_PATHS = re.compile(r"\S*[/\\](.*[/\\])?\S*")


def describe_failure(error: BaseException) -> str:
    """Describe an error for a log: its type and, for the package's own errors, the message with paths removed."""
    kind = type(error).__name__
    if not isinstance(error, MinihumanError):
        return kind
    first_line = str(error).partition("\n")[0]
    return f"{kind}: {_PATHS.sub('...', first_line)}"
