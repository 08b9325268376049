"""An export from start to end: into a new folder that appears only when it is whole, with a card."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from minihuman.data.selection import Filters, SelectionOf
from minihuman.errors import ExportError
from minihuman.export.card import Card
from minihuman.export.port import Written, find_exporter


def export(
    format_name: str,
    source: Path,
    out: Path,
    filters: Filters,
    *,
    stored_frames: bool = False,
    progress: Callable[[Path], None] = lambda _: None,
) -> tuple[Written, Card]:
    """Write the chosen episodes of a log or study to ``out``; ``progress`` hears of each one's log.

    Observations are played again, or with ``stored_frames`` those that the logs hold; each is checked against its hash.

    Raises:
        ExportError: if the format is unknown, ``out`` has something in it, nothing passes the filters,
            or an episode does not replay or holds no observations.
        LogError: if the source cannot be read.
    """
    exporter = find_exporter(format_name)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ExportError(f"{out} already exists; choose another folder or move it")
    card = Card(format_name, str(filters), stored_frames=stored_frames)

    def taken(log: Path, facts: Mapping[str, Any]) -> None:
        card.count(facts)
        progress(log)

    unfinished = out.resolve().with_name(out.name + ".unfinished")  # Minari joins a relative path to itself
    if unfinished.exists():
        raise ExportError(f"{unfinished} is another export's, running or broken off; remove it to go on")
    unfinished.mkdir(parents=True)
    try:
        selection = SelectionOf(source, filters, skipped=card.skipped.append, taken=taken, stored_frames=stored_frames)
        written = exporter(selection, unfinished)
        card.skipped.extend(written.left_out)
        if not written.episodes:
            why = f"; {written.left_out[0]}" if written.left_out else ""
            raise ExportError(
                f"no episode in {source} passes the filters ({filters or 'none'}){why}; nothing was written"
            )
        card.write(unfinished, written)
        if out.exists():
            out.rmdir()
        unfinished.rename(out)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    moved = tuple(out / path.relative_to(unfinished) for path in written.paths)
    return Written(moved, written.episodes, written.steps, written.left_out), card
