"""A report of a selection, whose store is closed when it is written."""

from pathlib import Path

from minihuman.dataset.tables import Tables
from minihuman.reporting.build import build_report


def write_report(tables: Tables, out: Path) -> tuple[Path, ...]:
    """Write the report; return its files, the page first."""
    with tables:
        return build_report(tables, out)
