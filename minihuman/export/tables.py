"""The report's tidy tables of the chosen episodes, as CSV or Parquet: steps, presses, keys, episodes and more.

``dictionary.json`` beside them describes every column with its unit.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
from operator import attrgetter
from pathlib import Path

from minihuman.export.port import Chosen, Written
from minihuman.marks import read_marks, tags
from minihuman.measures.shortest import shortest
from minihuman.report.exclusions import Rules
from minihuman.report.tables import session_tables
from minihuman.report.writing import Kind, TableWriter


def export_csv(chosen: Iterator[Chosen], out: Path) -> Written:
    """Write the tables as CSV."""
    return _export(chosen, out, "csv")


def export_parquet(chosen: Iterator[Chosen], out: Path) -> Written:
    """Write the tables as Parquet."""
    return _export(chosen, out, "parquet")


def _export(chosen: Iterator[Chosen], out: Path, kind: Kind) -> Written:
    """Rows that the protocol's exclusion rules leave out of the report are here, with the reason in ``left_out``."""
    episodes = steps = 0
    with TableWriter(out, kinds=(kind,)) as writer:
        for log, items in groupby(chosen, key=attrgetter("log")):
            taken = replace(log, episodes=tuple(item.episode for item in items))
            in_force = tags(read_marks(log.path))
            writer.write(session_tables(taken, tags=in_force, rules=Rules.of(log.plan), shortest=shortest))
            episodes += len(taken.episodes)
            steps += sum(len(episode.actions) for episode in taken.episodes)
    return Written((*writer.paths, writer.dictionary), episodes, steps)
