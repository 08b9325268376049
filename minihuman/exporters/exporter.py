"""The exporter interface, and an export from start to end.

An exporter is one function in one file, found through the entry-point group `minihuman.exporters`. An export is
written to a new folder that appears only when it is complete. It includes a card: a README that states what the export
holds, where the data came from and what was excluded.
"""

import shutil
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import minihuman
from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.selection import Selection, SelectionSummary
from minihuman.dataset.sessions import StudySessions
from minihuman.errors import ExportError
from minihuman.plugins import list_plugin_names, load_plugin

GROUP = "minihuman.exporters"


@dataclass(frozen=True, slots=True)
class ExportResult:
    """An exporter's output: its data files and folders, and the amount of data in them."""

    paths: tuple[Path, ...]
    episodes: int  # included episodes
    steps: int  # steps of the included episodes
    left_out: tuple[str, ...] = ()  # what the format cannot hold, and why; listed in the card
    marked: int = 0  # excluded episodes that are present with the reason
    sessions: int = 0  # for tables: sessions that have a row
    front_matter: str = ""  # of the card, for programs
    notes: tuple[str, ...] = ()  # what the format holds otherwise than the tables; listed in the card
    reading: tuple[str, ...] = ()  # lines of the card about how to read the files

    def with_files(self, paths: tuple[Path, ...], *, front_matter: str = "") -> "ExportResult":
        """Return a result with the same counts for other files, and the front matter of their card."""
        return replace(self, paths=paths, front_matter=front_matter)


Exporter = Callable[[IncludedEpisodes, Path], ExportResult]


def list_exporters() -> tuple[str, ...]:
    """Return the names of the installed exporters."""
    return list_plugin_names(GROUP)


def find_exporter(name: str) -> Exporter:
    """Return the exporter with a given name.

    Raises:
        ExportError: if there is none, or a package that it needs is not installed.
    """
    exporter: Exporter = load_plugin(GROUP, name, ExportError, noun="export format")
    return exporter


@dataclass(slots=True)
class ExportCard:
    """A counter of an export's episodes that writes the export's card."""

    format: str
    account: SelectionSummary
    stored_frames: bool = False  # observations were taken from the logs
    counts: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def count(self, facts: Mapping[str, Any]) -> None:
        """Count an episode in each of the card's tables, by its study, participant, group, world and so on."""
        for name in ("study", "participant", "group", "player", "block", "world", "outcome", "protocol_sha256"):
            self.counts[name][str(facts[name])] += 1

    def write(self, out: Path, export: ExportResult) -> Path:
        """Write the card into the export's folder and return its path."""
        path = out / "README.md"
        path.write_text(export.front_matter + self._format_card(out, export), encoding="utf-8", newline="\n")
        return path

    def _format_card(self, out: Path, export: ExportResult) -> str:
        """Return the card's text in Markdown."""
        if self.stored_frames:
            source = "stored in the logs"
        else:
            source = "played again from seed and actions"
        lines = [
            f"# {self.format} export",
            "",
            f"{export.episodes} episodes, {export.steps} steps, written by minihuman {minihuman.__version__}.",
            f"Observations, where the format holds them, were {source}, and each has the hash",
            "that was taken when it was made.",
            "",
            "What it is made of:",
            "",
            *(f"- {line}" for line in (*self.account.lines(), *export.left_out, *export.notes)),
            "",
            *export.reading,
            "| file or folder |",
            "|---|",
            *(f"| `{path.relative_to(out)}` |" for path in export.paths),
        ]
        for name, counter in self.counts.items():
            lines += ["", f"| {name} | episodes |", "|---|---|"]
            lines += [f"| {value} | {count} |" for value, count in sorted(counter.items())]
        return "\n".join(lines) + "\n"


def _require_new_folder(out: Path) -> None:
    """Raise ExportError if a path is a file, a folder that is not empty, or the program's working directory."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ExportError(f"{out} already exists; choose another folder, or move that one away")
    if _is_current_folder(out):
        raise ExportError(f"{out} is the current folder; choose a new folder")


@contextmanager
def _create_atomically(out: Path) -> Iterator[Path]:
    """Yield a temporary folder beside ``out`` that is renamed to ``out`` on success and removed on an error.

    Raises:
        ExportError: if the temporary folder exists, as another export is running or was interrupted.
    """
    unfinished = out.resolve().with_name(out.name + ".unfinished")  # Minari joins a relative path to itself
    if unfinished.exists():
        raise ExportError(
            f"{unfinished} belongs to an export that is running or was interrupted; if none is running, remove it and "
            "export again"
        )
    unfinished.mkdir(parents=True)
    try:
        yield unfinished
        if out.exists():
            out.rmdir()
        unfinished.rename(out)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise


def _is_current_folder(path: Path) -> bool:
    """Return whether a path is the working directory; a path that does not exist is it if it has no name."""
    if not path.exists():
        return not path.name
    return path.resolve().samefile(".")


def _make_counter(card: ExportCard, progress: Callable[[Path], None]) -> Callable[[Path, Mapping[str, Any]], None]:
    """Return a function that takes an episode's log and facts, and counts the episode in the card.

    The function calls ``progress`` with the log when it differs from that of the episode before.
    """
    latest_log: Path | None = None

    def count_episode(log: Path, facts: Mapping[str, Any]) -> None:
        nonlocal latest_log
        card.count(facts)
        if log != latest_log:  # a line on the screen for every episode of a thousand sessions takes half a second
            progress(log)
        latest_log = log

    return count_episode


def export_study(
    format_name: str,
    source: Path,
    out: Path,
    selection: Selection,
    *,
    stored_frames: bool = False,
    with_messages: bool = False,
    engine: str = "local",
    progress: Callable[[Path], None] = lambda _: None,
    finish: Callable[[Path, ExportResult], ExportResult] = lambda _, export: export,
) -> tuple[ExportResult, ExportCard]:
    """Write the selected episodes of a log or study to ``out``, calling ``progress`` once for each log.

    ``finish`` can add files before the folder appears. Return the result, with paths in ``out``, and the card.

    Logs with messages between participants are excluded unless ``with_messages`` is set. Observations are replayed, or
    read from the logs with ``stored_frames``, and checked by their hashes. ``engine`` reads logs: "local" or "ray".

    Raises:
        ExportError: if the format is unknown, ``out`` is not empty, no episode is included, or an episode does not
            replay or holds no observations.
        LogError: if the source cannot be read.
    """
    exporter = find_exporter(format_name)
    _require_new_folder(out)
    sessions = StudySessions(source, selection, engine=engine)
    card = ExportCard(format_name, sessions.account, stored_frames=stored_frames)
    count_episode = _make_counter(card, progress)
    with _create_atomically(out) as unfinished:
        episodes = IncludedEpisodes(
            sessions, on_included=count_episode, stored_frames=stored_frames, with_messages=with_messages
        )
        export = exporter(episodes, unfinished)
        if not export.episodes + export.marked + export.sessions:
            why = "; ".join((*export.left_out, *sessions.account.lines()))
            raise ExportError(f"{source} has nothing to export: {why}; select other episodes")
        card.write(unfinished, export)
        export = finish(unfinished, export)
    moved = tuple(out / path.relative_to(unfinished) for path in export.paths)
    return replace(export, paths=moved), card
