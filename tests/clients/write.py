"""Demonstrations and partitioned tables of frozen studies for the clients beside this file:
``python -m tests.clients.write FOLDER``.
"""

import json
import shutil
import sys
from pathlib import Path

from minihuman.dataset.remote_tables import store_tables
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import TABLES
from minihuman.exporters.exporter import export_study
from minihuman.storage.remote_store import TABLES_URL_FILE_NAME

GOLDEN = Path(__file__).parents[1] / "golden/v1"
STUDIES = ("plain", "mixed", "resumed", "real-time", "foreign", "taught")


def write(out: Path) -> None:
    """One folder a format, in it one a study; unfinished episodes too."""
    for study in STUDIES:
        shutil.copytree(GOLDEN / study, out / "studies" / study)
        for kind in ("minari", "lerobot", "imitation", "robomimic", "rlds"):
            export_study(kind, out / "studies" / study, out / kind / study, Selection(with_=("unfinished",)))
    write_partitions(out / "studies", out / "partitions")


def write_partitions(studies: Path, out: Path) -> None:
    """All studies' tables in one place, and beside it what `minihuman query` says of each study's."""
    out.mkdir()
    (studies / TABLES_URL_FILE_NAME).write_text(f"{out}\n")
    medians = "SELECT participant, median(t_s) AS t_s FROM steps GROUP BY participant"
    expected = {}
    for study in STUDIES:
        store_tables(studies / study)
        with StudyStore(StudySessions(studies / study), with_shortest=False) as store:
            counts = {name: store.tables.count(name) for name in TABLES if store.tables.count(name)}
            expected[study] = {"rows": counts, "medians": store.tables.query(medians).to_pylist()}
    out.with_suffix(".json").write_text(json.dumps(expected))


if __name__ == "__main__":
    write(Path(sys.argv[1]))
