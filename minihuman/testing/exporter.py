"""What every exporter promises: it takes the episodes that it is given, writes where it may, and says what it wrote."""

import hashlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from minihuman.data.caches import is_cache
from minihuman.data.chosen import ChosenEpisodes
from minihuman.data.selection import Selection
from minihuman.data.study import Sessions
from minihuman.export.port import Exporter, Written, find_exporter
from minihuman.seats.simulate import simulate
from minihuman.testing.kept import promise
from minihuman.testing.player import WORLD
from minihuman.testing.session import short_study

PARTICIPANTS, EPISODES = 2, 2


def check_exporter(exporter: str | Exporter, world: str = WORLD, options: dict[str, Any] | None = None) -> None:
    """Record a small study and export it.

    Args:
        exporter: its name in ``minihuman export``, or the function itself.
        world: what is played, an id.
        options: of the world.

    Raises:
        ContractError: if a promise is not kept; it says which.
        ExportError: if it cannot export this world.
    """
    write = find_exporter(exporter) if isinstance(exporter, str) else exporter
    with TemporaryDirectory() as name:
        folder = Path(name).resolve()
        protocol = short_study(world, options or {}, episodes=EPISODES, max_steps=40)
        list(simulate(protocol, folder / "data", participants=PARTICIPANTS, seed=1, player="random"))
        before = _files(folder / "data")
        (folder / "out").mkdir()
        study = folder / "data" / protocol.study.name
        played = [episode for counted in Sessions(study, Selection()) for episode in counted.episodes]
        written = write(ChosenEpisodes(Sessions(study, Selection())), folder / "out")
        _look_at(written, folder / "out", len(played), sum(len(episode.actions) for episode in played))
        promise(_files(folder / "data") == before, "the exporter changed what is beside the logs")
        others = {path.name for path in folder.iterdir()} - {"data", "out"}
        promise(not others, f"the exporter wrote beside its folder: {', '.join(sorted(others))}")
        (folder / "again").mkdir()
        write(ChosenEpisodes(Sessions(study, Selection())), folder / "again")
        promise(
            set(_files(folder / "again")) == set(_files(folder / "out")), "a second export of the same has other files"
        )


def _look_at(written: Written, out: Path, episodes: int, steps: int) -> None:
    promise(isinstance(written, Written), f"the exporter gave a {type(written).__name__}, not a Written")
    promise(bool(written.paths), "the exporter says that it wrote no file")
    for path in written.paths:
        promise(path.exists(), f"the exporter says that it wrote {path}, which is not there")
        promise(path.resolve().is_relative_to(out), f"the exporter wrote {path}, outside the folder it was given")
    promise(
        written.episodes == episodes,
        f"{episodes} episodes count, and it says that it wrote {written.episodes}",
    )
    promise(written.steps == steps, f"they have {steps} steps, and it says that it wrote {written.steps}")


def _files(folder: Path) -> dict[str, str]:
    """Every file but the caches, with its hash."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not is_cache(Path(*path.relative_to(folder).parts[1:]))  # which is a study's name
    }
