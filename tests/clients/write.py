"""Demonstrations of frozen studies for the clients beside this file: ``python -m tests.clients.write FOLDER``."""

import shutil
import sys
from pathlib import Path

from minihuman.dataset.selection import Selection
from minihuman.exporters.exporter import export_study

GOLDEN = Path(__file__).parents[1] / "golden/v1"
STUDIES = ("plain", "mixed", "resumed", "real-time", "foreign", "taught")


def write(out: Path) -> None:
    """One folder a format, in it one a study; unfinished episodes too."""
    for study in STUDIES:
        shutil.copytree(GOLDEN / study, out / "studies" / study)
        for kind in ("minari", "lerobot", "imitation", "robomimic", "rlds"):
            export_study(kind, out / "studies" / study, out / kind / study, Selection(with_=("unfinished",)))


if __name__ == "__main__":
    write(Path(sys.argv[1]))
