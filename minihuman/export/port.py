"""What every exporter is: one function in one file, found through the entry-point group ``minihuman.exporters``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from minihuman.data.chosen import ChosenEpisodes
from minihuman.errors import ExportError

GROUP = "minihuman.exporters"


@dataclass(frozen=True, slots=True)
class Written:
    """What an exporter wrote: its data files and folders, and how much is in them."""

    paths: tuple[Path, ...]
    episodes: int  # that count
    steps: int  # of those
    left_out: tuple[str, ...] = ()  # what the format cannot hold, and why; in the card
    marked: int = 0  # further episodes, that do not count and are there all the same, with the reason
    sessions: int = 0  # of tables: those that have a row, with an episode or without


Exporter = Callable[[ChosenEpisodes, Path], Written]


def exporters() -> dict[str, str]:
    """The names of the exporters installed, with where each one is."""
    return {entry.name: entry.value for entry in entry_points(group=GROUP)}


def find_exporter(name: str) -> Exporter:
    """The exporter of that name.

    Raises:
        ExportError: if there is none, or what it needs is not installed.
    """
    found: Sequence[Any] = [entry for entry in entry_points(group=GROUP) if entry.name == name]
    if not found:
        raise ExportError(f"no export format {name!r}; there are {', '.join(sorted(exporters()))}")
    try:
        exporter: Exporter = found[0].load()
    except ModuleNotFoundError as error:
        raise ExportError(f"export to {name} needs {error.name}; pip install 'minihuman[export]'") from error
    return exporter
