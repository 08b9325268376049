"""Compare a study's caches, tables and reports with those recomputed from its logs."""

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from minihuman.admin.session_index import compare_index
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_files import compare_cache, compare_pages, compare_table_files
from minihuman.dataset.tables import Tables, select
from minihuman.log.paths import require_folder
from minihuman.reporting.build import build_report


def verify_tables(study: Path, outputs: Iterable[Path]) -> Iterator[tuple[str, bool]]:
    """Recompute a study's tables from its logs, and yield how its caches and outputs differ.

    Each difference is a line with False; if there is none, a single line with True says how much was compared.

    Args:
        study: the study's folder.
        outputs: the folders of reports and of CSV and Parquet exports.

    Raises:
        LogError: if the study's folder or an output's folder does not exist.
    """
    require_folder(study, instead="a study's folder")
    with (
        tempfile.TemporaryDirectory(prefix="minihuman-") as temporary,
        select(study, from_logs=True) as tables,
    ):
        tables.require(shortest_paths=True)
        rows = sum(map(tables.count, TABLES))
        differences = [
            f"{session.path} cannot be read: {session.problem}" for session in tables.sessions if session.problem
        ]
        differences += [*compare_cache(tables.store, study), *compare_index(study)]
        for number, folder in enumerate(outputs):
            differences += _compare_output(tables, folder, Path(temporary) / str(number))
    yield from ((line, False) for line in differences)
    if not differences:
        yield f"{rows} rows of {len(TABLES)} tables recomputed from the logs, all as cached and written", True


def _compare_output(tables: Tables, folder: Path, recomputed: Path) -> Iterator[str]:
    """Write a report or tables anew into the folder ``recomputed``, and yield how the given folder differs from it."""
    if (folder / "report.html").is_file():
        build_report(tables, recomputed)
        yield from compare_table_files(folder / "tables", recomputed / "tables")
        yield from compare_pages(folder / "report.html", recomputed / "report.html")
    else:
        require_folder(folder, instead="a report's folder, or that of a CSV or Parquet export")
        tables.write(recomputed, without=COLUMNS_NEEDING_WORLD)
        yield from compare_table_files(folder, recomputed)
