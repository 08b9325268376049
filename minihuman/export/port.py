"""What every exporter is: one function in one file, found through the entry-point group ``minihuman.exporters``."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from minihuman.data.chosen import ChosenEpisodes
from minihuman.errors import ExportError
from minihuman.plugins import load, names

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


def exporters() -> tuple[str, ...]:
    """The names of the exporters that are installed."""
    return names(GROUP)


def find_exporter(name: str) -> Exporter:
    """The exporter of that name.

    Raises:
        ExportError: if there is none, or what it needs is not installed.
    """
    exporter: Exporter = load(GROUP, name, ExportError, what="export format")
    return exporter
