"""The report's tidy tables of the chosen episodes, as CSV or Parquet: steps, presses, keys, episodes and more.

They are made from the logs alone, no world is run: what only a world can tell, the fewest possible steps, is left to
the report. ``dictionary.json`` and ``datapackage.json`` beside the tables describe every column with its unit.
"""

from pathlib import Path

import pyarrow.compute as pc

from minihuman.data.chosen import ChosenEpisodes
from minihuman.data.columns import NEED_WORLD
from minihuman.data.writing import Kind, write_tables
from minihuman.export.port import Written


def export_csv(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write the tables as CSV."""
    return _export(chosen, out, "csv")


def export_parquet(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write the tables as Parquet."""
    return _export(chosen, out, "parquet")


def _export(chosen: ChosenEpisodes, out: Path, kind: Kind) -> Written:
    """Rows that do not count are here too, with the reason in ``left_out``."""
    with chosen.store() as store:
        paths = write_tables(store.tables, out, kinds=(kind,), without=NEED_WORLD)
        held = store.tables.table("episodes", ["left_out", "steps"])
        sessions = store.tables.count("participants")
    counts = pc.is_null(held["left_out"])
    steps = pc.sum(held.filter(counts)["steps"]).as_py() or 0
    episodes = pc.sum(counts).as_py() or 0
    return Written(paths, episodes, steps, marked=held.num_rows - episodes, sessions=sessions)
