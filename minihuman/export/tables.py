"""The report's tidy tables of the chosen episodes, as CSV or Parquet: steps, presses, keys, episodes and more.

They are made from the logs alone, no world is run: what only a world can tell, the fewest possible steps, is left to
the report. ``dictionary.json`` and ``datapackage.json`` beside the tables describe every column with its unit.
"""

from pathlib import Path

from minihuman.data.chosen import ChosenEpisodes
from minihuman.data.columns import NEED_WORLD
from minihuman.data.writing import Kind, TableWriter
from minihuman.export.port import Written


def export_csv(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write the tables as CSV."""
    return _export(chosen, out, "csv")


def export_parquet(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write the tables as Parquet."""
    return _export(chosen, out, "parquet")


def _export(chosen: ChosenEpisodes, out: Path, kind: Kind) -> Written:
    """Rows that do not count are here too, with the reason in ``left_out``."""
    episodes = steps = marked = sessions = 0
    with TableWriter(out, kinds=(kind,), without=NEED_WORLD) as writer:
        for session in chosen.rows():
            writer.write(session.rows)
            sessions += 1
            rows = session.rows.parts["episodes"].columns
            for reason, count in zip(rows.get("left_out", ()), rows.get("steps", ()), strict=True):
                marked += bool(reason)
                episodes += not reason
                steps += 0 if reason else count
    return Written(
        (*writer.paths, writer.dictionary, writer.package), episodes, steps, marked=marked, sessions=sessions
    )
