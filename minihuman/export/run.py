"""An export from start to end: into a new folder that appears only when it is whole, with a card."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from minihuman.errors import ExportError
from minihuman.export.card import Card
from minihuman.export.choose import Filters, chosen
from minihuman.export.port import Chosen, Written, find_exporter


def export(
    format_name: str,
    source: Path,
    out: Path,
    filters: Filters,
    *,
    progress: Callable[[Chosen], None] = lambda _: None,
) -> tuple[Written, Card]:
    """Write the chosen episodes of a log or study to ``out``; ``progress`` hears of each as it begins.

    Raises:
        ExportError: if the format is unknown, ``out`` has something in it, nothing passes the filters,
            or an episode does not replay.
        LogError: if the source cannot be read.
    """
    exporter = find_exporter(format_name)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ExportError(f"{out} already exists; choose another folder or move it")
    card = Card(format_name, str(filters))
    unfinished = out.resolve().with_name(out.name + ".unfinished")  # Minari joins a relative path to itself
    if unfinished.exists():
        raise ExportError(f"{unfinished} is another export's, running or broken off; remove it to go on")
    unfinished.mkdir(parents=True)
    try:
        written = exporter(_counted(chosen(source, filters, card.skipped.append), card, progress), unfinished)
        if not written.episodes:
            raise ExportError(f"no episode in {source} passes the filters ({filters or 'none'}); nothing was written")
        card.write(unfinished, written)
        if out.exists():
            out.rmdir()
        unfinished.rename(out)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    moved = tuple(out / path.relative_to(unfinished) for path in written.paths)
    return Written(moved, written.episodes, written.steps), card


def _counted(items: Iterator[Chosen], card: Card, progress: Callable[[Chosen], None]) -> Iterator[Chosen]:
    for item in items:
        card.count(item)
        progress(item)
        yield item
