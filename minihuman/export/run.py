"""An export from start to end: into a new folder that appears only when it is whole, with a card."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from minihuman.data.chosen import ChosenEpisodes
from minihuman.data.selection import Selection
from minihuman.data.study import Sessions
from minihuman.errors import ExportError
from minihuman.export.card import Card
from minihuman.export.port import Written, find_exporter


def export(
    format_name: str,
    source: Path,
    out: Path,
    selection: Selection,
    *,
    stored_frames: bool = False,
    progress: Callable[[Path], None] = lambda _: None,
) -> tuple[Written, Card]:
    """Write the chosen episodes of a log or study to ``out``; ``progress`` hears of each log once.

    Observations are played again, or with ``stored_frames`` those that the logs hold; each is checked against its hash.

    Raises:
        ExportError: if the format is unknown, ``out`` has something in it, no episode counts,
            or an episode does not replay or holds no observations.
        LogError: if the source cannot be read.
    """
    exporter = find_exporter(format_name)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ExportError(f"{out} already exists; choose another folder or move it")
    sessions = Sessions(source, selection)
    card = Card(format_name, sessions.account, stored_frames=stored_frames)

    heard: Path | None = None

    def taken(log: Path, facts: Mapping[str, Any]) -> None:
        nonlocal heard
        card.count(facts)
        if log != heard:  # a line on the screen for every episode of a thousand sessions takes half a second
            progress(log)
        heard = log

    unfinished = out.resolve().with_name(out.name + ".unfinished")  # Minari joins a relative path to itself
    if unfinished.exists():
        raise ExportError(f"{unfinished} is another export's, running or broken off; remove it to go on")
    unfinished.mkdir(parents=True)
    try:
        written = exporter(ChosenEpisodes(sessions, taken=taken, stored_frames=stored_frames), unfinished)
        if not written.episodes + written.marked + written.sessions:
            why = "; ".join((*written.left_out, *sessions.account.lines()))
            raise ExportError(f"nothing of {source} was written: {why}")
        card.write(unfinished, written)
        if out.exists():
            out.rmdir()
        unfinished.rename(out)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    moved = tuple(out / path.relative_to(unfinished) for path in written.paths)
    return replace(written, paths=moved), card
