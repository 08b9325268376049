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
from minihuman.study.plan import SessionPlan


def export_csv(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write the tables as CSV."""
    return _write(chosen, out, "csv")[0]


def export_parquet(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write the tables as Parquet."""
    return _write(chosen, out, "parquet")[0]


def export_tables(chosen: ChosenEpisodes, out: Path, kind: Kind) -> tuple[Written, SessionPlan | None]:
    """Write every table; rows that do not count are there too, with the reason in ``left_out``.

    Gives what was written, and the plan of the first session that is asked for, which says what the study is; None
    where there is none.

    Raises:
        LogError: if the source does not exist, or is a single log that cannot be read.
    """
    from minihuman.log.read.open_log import open_log  # not needed where nobody asks what the study is

    written, first = _write(chosen, out, kind)
    return written, open_log(first).plan if first else None


def _write(chosen: ChosenEpisodes, out: Path, kind: Kind) -> tuple[Written, Path | None]:
    """Write every table; give what was written, and the first session's log."""
    with chosen.store() as store:
        paths = write_tables(store.tables, out, kinds=(kind,), without=NEED_WORLD, kept=store.files)
        held = store.tables.table("episodes", ["left_out", "steps"])
        sessions = store.tables.count("participants")
        first = next((Path(kept.path) for kept in store.kept if kept.outline is not None), None)
    counts = pc.is_null(held["left_out"])
    steps = pc.sum(held.filter(counts)["steps"]).as_py() or 0
    episodes = pc.sum(counts).as_py() or 0
    return Written(paths, episodes, steps, marked=held.num_rows - episodes, sessions=sessions), first
