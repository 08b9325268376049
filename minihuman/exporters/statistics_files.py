"""Export the tables for SPSS (`.sav`) and Stata (`.dta`), each column labelled with its meaning and unit.

A flag is 0 or 1 with the labels "no" and "yes"; what is missing is missing. The tables of every step, key and picture
are left to other formats: both programs hold a table in memory and read long ones slowly.
"""

from pathlib import Path
from textwrap import shorten
from typing import Any, Literal

import pyreadstat

from minihuman.dataset.episode_stream import IncludedEpisodes
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD, EVERY_MOMENT, TABLES
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.tables import count_included

_LABEL_CHARACTERS = 80  # Stata's limit for a column's label


def export_spss(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows as SPSS data."""
    return _write(chosen, out, "sav")


def export_stata(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows as Stata data."""
    return _write(chosen, out, "dta")


def _write(chosen: IncludedEpisodes, out: Path, kind: Literal["sav", "dta"]) -> ExportResult:
    paths: list[Path] = []
    with chosen.store() as store:
        for name, columns in TABLES.items():
            if name in EVERY_MOMENT or not store.tables.count(name):
                continue
            described = [column for column in columns if column.name not in COLUMNS_NEEDING_WORLD]
            frame = store.tables.table(name, [column.name for column in described]).to_pandas()
            flags = [column.name for column in described if column.kind == "boolean"]
            frame[flags] = frame[flags].astype("float64")
            for column in described:
                if column.kind in ("text", "key"):
                    frame[column.name] = frame[column.name].fillna("").astype(object)
            labels: dict[str, Any] = {
                column.name: _label(f"{column.meaning}{f' ({column.unit})' if column.unit else ''}", kind)
                for column in described
            }
            answers = {flag: {0.0: "no", 1.0: "yes"} for flag in flags}
            paths.append(out / f"{name}.{kind}")
            if kind == "sav":
                pyreadstat.write_sav(frame, str(paths[-1]), column_labels=labels, variable_value_labels=answers)
            else:
                pyreadstat.write_dta(frame, str(paths[-1]), column_labels=labels, variable_value_labels=answers)
        return count_included(store).with_files(tuple(paths))


def _label(text: str, kind: str) -> str:
    return text if kind == "sav" else shorten(text, _LABEL_CHARACTERS, placeholder=" ...")
