"""Export the report's tidy tables of the selected episodes as CSV or Parquet: steps, presses, keys, episodes and more.

The tables come from the logs alone and no world is run: the shortest path, which only a world can tell, is left to
the report. `dictionary.json` and `datapackage.json` beside the tables describe every column with its unit.
"""

from pathlib import Path

import pyarrow.compute as pc

from minihuman.dataset.episode_stream import IncludedEpisodes
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.table_files import TableFormat, write_tables
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.exporters.exporter import ExportResult


def export_csv(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write the tables as CSV."""
    return _write(chosen, out, "csv")[0]


def export_parquet(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write the tables as Parquet."""
    return _write(chosen, out, "parquet")[0]


def export_tables(chosen: IncludedEpisodes, out: Path, kind: TableFormat) -> tuple[ExportResult, SessionPlan | None]:
    """Write every table; rows that do not count are there too, with the reason in ``exclusion_reason``.

    Gives what was written, and the plan of the first session that is asked for, which says what the study is; None
    where there is none.

    Raises:
        LogError: if the source does not exist, or is a single log that cannot be read.
    """
    from minihuman.log.read.session_reader import read_log  # not needed unless the study is asked for

    written, first = _write(chosen, out, kind)
    return written, read_log(first).plan if first else None


def _write(chosen: IncludedEpisodes, out: Path, kind: TableFormat) -> tuple[ExportResult, Path | None]:
    """Write every table that has rows; give what was written, and the first session's log."""
    with chosen.store() as store:
        paths = write_tables(store.tables, out, kinds=(kind,), without=COLUMNS_NEEDING_WORLD)
        return count_included(store).with_files(paths), find_first_log(store)


def count_included(store: StudyStore) -> ExportResult:
    """What the tables hold, of no files yet."""
    held = store.tables.table("episodes", ["exclusion_reason", "steps"])
    counts = pc.is_null(held["exclusion_reason"])
    steps = pc.sum(held.filter(counts)["steps"]).as_py() or 0
    episodes = pc.sum(counts).as_py() or 0
    sessions = store.tables.count("participants")
    return ExportResult((), episodes, steps, marked=held.num_rows - episodes, sessions=sessions)


def find_first_log(store: StudyStore) -> Path | None:
    """The log of the first session that is asked for; None where there is none."""
    return next((Path(kept.path) for kept in store.kept if kept.outline is not None), None)
