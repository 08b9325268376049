"""Contract test of exporters.

An exporter exports exactly the given episodes, writes only to the output folder, and reports the files that it wrote.
"""

import hashlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from minihuman.dataset.caches import is_cache
from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.exporters.exporter import Exporter, ExportResult, find_exporter
from minihuman.runtime.simulated_session import simulate
from minihuman.testing.checks import build_short_study, require
from minihuman.testing.participant_contract import WORLD

PARTICIPANTS = 2
EPISODES = 2


def check_exporter(exporter: str | Exporter, world: str = WORLD, options: dict[str, Any] | None = None) -> None:
    """Record a small study, export it, and check the export.

    Args:
        exporter: the exporter's name in ``minihuman export``, or the function itself.
        world: the id of the world that is played.
        options: the options of the world.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        ExportError: if the exporter cannot export this world.
    """
    write = find_exporter(exporter) if isinstance(exporter, str) else exporter
    with TemporaryDirectory() as name:
        folder = Path(name).resolve()
        protocol = build_short_study(world, options or {}, episodes=EPISODES, max_steps=40)
        list(simulate(protocol, folder / "data", participants=PARTICIPANTS, seed=1, player="random"))
        digests_before = _digest_files(folder / "data")
        (folder / "out").mkdir()
        study = folder / "data" / protocol.study.name
        played = [episode for session in StudySessions(study, Selection()) for episode in session.episodes]
        export = write(IncludedEpisodes(StudySessions(study, Selection())), folder / "out")
        _check_export(export, folder / "out", len(played), sum(len(episode.actions) for episode in played))
        require(_digest_files(folder / "data") == digests_before, "the exporter changed what is beside the logs")
        stray_names = {path.name for path in folder.iterdir()} - {"data", "out"}
        require(not stray_names, f"the exporter wrote beside its folder: {', '.join(sorted(stray_names))}")
        (folder / "again").mkdir()
        write(IncludedEpisodes(StudySessions(study, Selection())), folder / "again")
        require(
            set(_digest_files(folder / "again")) == set(_digest_files(folder / "out")),
            "a second export of the same has other files",
        )


def _check_export(export: ExportResult, out: Path, episodes: int, steps: int) -> None:
    """Check that an exporter reports existing files in ``out``, and that it reports all ``episodes`` and ``steps``."""
    require(isinstance(export, ExportResult), f"the exporter gave a {type(export).__name__}, not an ExportResult")
    require(bool(export.paths), "the exporter says that it wrote no file")
    for path in export.paths:
        require(path.exists(), f"the exporter says that it wrote {path}, which does not exist")
        require(path.resolve().is_relative_to(out), f"the exporter wrote {path}, outside the folder it was given")
    require(
        export.episodes == episodes,
        f"{episodes} episodes count, and it says that it wrote {export.episodes}",
    )
    require(export.steps == steps, f"they have {steps} steps, and it says that it wrote {export.steps}")


def _digest_files(folder: Path) -> dict[str, str]:
    """Return the SHA-256 digest of every file in a folder except the caches of its studies, by its relative path."""
    digests = {}
    for path in sorted(folder.rglob("*")):
        relative_path = path.relative_to(folder)
        path_in_study = Path(*relative_path.parts[1:])
        if path.is_file() and not is_cache(path_in_study):
            digests[str(relative_path)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return digests
