"""Plug-ins: players, windows, exporters and what else is found by name, whoever installed it.

A package registers them as entry points of a group: ``[project.entry-points."minihuman.players"]``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, distributions, entry_points
from typing import Any

from minihuman.errors import MinihumanError

PREFIX = "minihuman."
EXTRAS = {
    "torch": "learn",
    "stable_baselines3": "learn",
    "minari": "export",
    "pyarrow": "export",
    "datasets": "export",
    "pylsl": "lsl",
}


@dataclass(frozen=True, slots=True)
class Plugin:
    """Something that is found by name, and the package that brought it."""

    group: str  # "players"
    name: str
    where: str  # "module:attribute"
    package: str  # "minihuman 0.1.0"


def plugins() -> tuple[Plugin, ...]:
    """Everything that is installed, by group and name."""
    found = {
        Plugin(entry.group.removeprefix(PREFIX), entry.name, entry.value, f"{package.name} {package.version}")
        for package in distributions()
        for entry in package.entry_points
        if entry.group.startswith(PREFIX)
    }
    return tuple(sorted(found, key=lambda one: (one.group, one.name, one.package)))


def names(group: str) -> tuple[str, ...]:
    """The names in a group ("minihuman.players"), sorted."""
    return tuple(sorted({entry.name for entry in entry_points(group=group)}))


def load(group: str, name: str, error: Callable[[str], MinihumanError], *, what: str) -> Any:
    """What is registered under a name.

    Args:
        group: "minihuman.players".
        name: the name.
        error: makes the error that is raised, from its line.
        what: what it is, for that line: "player".

    Raises:
        MinihumanError: ``error``'s: nothing or several things have the name, or it cannot be imported.
    """
    found = sorted(set(entry_points(group=group, name=name)), key=lambda entry: entry.value)
    if not found:
        raise error(f"{what} {name!r} is unknown; it is one of {', '.join(names(group))}")
    if len(found) > 1:
        both = " and ".join(f"{entry.value} ({_package(entry)})" for entry in found)
        raise error(f"{what} {name!r} is registered twice, {both}; uninstall one, or rename it")
    try:
        return found[0].load()
    except ImportError as failed:
        missing = failed.name if isinstance(failed, ModuleNotFoundError) else None
        extra = EXTRAS.get((missing or "").partition(".")[0])
        cure = f"pip install 'minihuman[{extra}]'" if extra else f"see to {_package(found[0])}"
        raise error(f"{what} {name!r} ({found[0].value}) cannot be imported: {failed}; {cure}") from failed
    except AttributeError as failed:
        raise error(f"{what} {name!r}: there is no {found[0].value}; see to {_package(found[0])}") from failed


def check_made(made: Any, port: type, error: Callable[[str], MinihumanError], *, group: str, name: str) -> None:
    """Raise ``error`` if what a plug-in made is not what its group asks for."""
    if not isinstance(made, port):
        (entry, *_) = entry_points(group=group, name=name)
        raise error(
            f"{entry.value} ({_package(entry)}) makes a {type(made).__name__}; "
            f"what {group!r} names makes a {port.__module__}.{port.__qualname__}"
        )


def _package(entry: EntryPoint) -> str:
    return "an unknown package" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
