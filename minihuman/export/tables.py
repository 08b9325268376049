"""The report's tidy tables of the chosen episodes, as CSV or Parquet: steps, presses, keys, episodes and more.

They are made from the logs alone, no world is run: what only a world can tell, the fewest possible steps, is left to
the report. ``dictionary.json`` and ``datapackage.json`` beside the tables describe every column with its unit.
"""

from functools import partial
from pathlib import Path

from minihuman.data.chosen import Selection
from minihuman.data.columns import NEED_WORLD
from minihuman.data.study import Reading, read_session
from minihuman.data.writing import Kind, TableWriter
from minihuman.export.port import Written


def export_csv(chosen: Selection, out: Path) -> Written:
    """Write the tables as CSV."""
    return _export(chosen, out, "csv")


def export_parquet(chosen: Selection, out: Path) -> Written:
    """Write the tables as Parquet."""
    return _export(chosen, out, "parquet")


def _export(chosen: Selection, out: Path, kind: Kind) -> Written:
    """Rows that the protocol's exclusion rules leave out of the report are here, with the reason in ``left_out``."""
    episodes = steps = 0
    with TableWriter(out, kinds=(kind,), without=NEED_WORLD) as writer:
        for session in chosen.each_session(partial(read_session, reading=Reading(with_shortest=False))):
            writer.write(session.rows)
            episodes += session.rows.count("episodes")
            steps += session.rows.count("steps")
    return Written((*writer.paths, writer.dictionary, writer.package), episodes, steps)
