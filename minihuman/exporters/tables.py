"""Export the tables of the selected episodes as CSV, Parquet, SPSS, Stata or a Hugging Face dataset.

SPSS files end in `.sav`, and Stata files in `.dta`.
"""

import json
from pathlib import Path
from textwrap import shorten
from typing import Any, Literal

import pyarrow.compute as pc

from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.info_columns import LABELLED_TABLES, add_info_columns, list_info_columns
from minihuman.dataset.table_catalogue import EVERY_MOMENT, TABLES, build_data_dictionary
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD, TableColumn
from minihuman.dataset.table_files import TableFormat
from minihuman.dataset.tables import Tables
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import get_licence_id, get_plan_study_facts


def export_csv(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write the tables as CSV."""
    with chosen.tables() as tables:
        return _write(tables, out, "csv")


def export_parquet(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write the tables as Parquet."""
    with chosen.tables() as tables:
        return _write(tables, out, "parquet")


def export_tables(chosen: IncludedEpisodes, out: Path, kind: TableFormat) -> tuple[ExportResult, SessionPlan | None]:
    """Write every table; excluded rows are present, with the reason in ``exclusion_reason``.

    Returns:
        The export's result, and the plan of the first selected session, which describes the study; the plan is None if
        no
        session is selected.

    Raises:
        LogError: if the source does not exist, or is a single log that cannot be read.
    """
    with chosen.tables() as tables:
        return _write(tables, out, kind), read_first_plan(tables)


def _write(tables: Tables, out: Path, kind: TableFormat) -> ExportResult:
    """Write every table that has rows."""
    paths = tables.write(out, kinds=(kind,), without=COLUMNS_NEEDING_WORLD)
    return count_included(tables).with_files(paths)


def count_included(tables: Tables) -> ExportResult:
    """Count the included episodes and steps in the tables; the result names no files yet."""
    rows = tables.arrow("episodes", ["exclusion_reason", "steps"])
    is_included = pc.is_null(rows["exclusion_reason"])
    steps = pc.sum(rows.filter(is_included)["steps"]).as_py() or 0
    episodes = pc.sum(is_included).as_py() or 0
    sessions = tables.count("participants")
    return ExportResult((), episodes, steps, marked=rows.num_rows - episodes, sessions=sessions)


def read_first_plan(tables: Tables) -> SessionPlan | None:
    """Read the plan of the first selected session, which describes the study; None if no session is selected."""
    first = next((session for session in tables.sessions if session.outline is not None), None)
    if first is None:
        return None
    return tables.read_log(first).plan


_LABEL_CHARACTERS = 80  # Stata's limit for a column's label


def export_spss(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows as SPSS data."""
    return _write_labelled(chosen, out, "sav")


def export_stata(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows as Stata data."""
    return _write_labelled(chosen, out, "dta")


def _write_labelled(chosen: IncludedEpisodes, out: Path, kind: Literal["sav", "dta"]) -> ExportResult:
    import pyreadstat  # in no other format

    paths: list[Path] = []
    with chosen.tables() as tables:
        for name, columns in TABLES.items():
            if name in EVERY_MOMENT or not tables.count(name):
                continue
            described = [column for column in columns if column.name not in COLUMNS_NEEDING_WORLD]
            rows = tables.arrow(name, [column.name for column in described])
            is_labelled = name in LABELLED_TABLES
            if is_labelled:
                label_columns = list_info_columns(tables.store.tables.connection, name)
            else:
                label_columns = {}
            frame = add_info_columns(rows, name, label_columns).to_pandas()
            described += label_columns.values()
            flags = [column.name for column in described if column.kind == "boolean"]
            frame[flags] = frame[flags].astype("float64")
            for column in described:
                if column.kind in ("text", "key"):
                    frame[column.name] = frame[column.name].fillna("").astype(object)
            labels = {column.name: _label(column, kind) for column in described}
            answers = {flag: {0.0: "no", 1.0: "yes"} for flag in flags}
            paths.append(out / f"{name}.{kind}")
            options: dict[str, Any] = {"column_labels": labels, "variable_value_labels": answers}
            if kind == "sav":
                pyreadstat.write_sav(frame, str(paths[-1]), **options)
            else:
                pyreadstat.write_dta(frame, str(paths[-1]), **options)
        return count_included(tables).with_files(tuple(paths))


def _label(column: TableColumn, kind: Literal["sav", "dta"]) -> str:
    """Return a column's label: its meaning and unit, shortened if the format limits the length."""
    text = column.meaning
    if column.unit:
        text = f"{column.meaning} ({column.unit})"
    if kind == "sav":
        return text
    return shorten(text, _LABEL_CHARACTERS, placeholder=" ...")


def export_hugging_face(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows; excluded rows are present, with the reason."""
    with chosen.tables() as tables:
        names = list(dict.fromkeys(partition.table for partition, _ in tables.write_partitions(out)))
        result = count_included(tables)
        plan = read_first_plan(tables)
    meanings = build_data_dictionary(without=COLUMNS_NEEDING_WORLD)
    dictionary_json = json.dumps({name: meanings[name] for name in names}, indent=1)
    described = out / "dictionary.json"
    described.write_text(f"{dictionary_json}\n", encoding="utf-8", newline="\n")
    study_facts = AboutSpec()
    if plan is not None:
        study_facts = get_plan_study_facts(plan)
    front = {
        "license": get_licence_id(study_facts),
        "pretty_name": study_facts.title,
        "tags": ["minihuman", *study_facts.keywords],
        "configs": [{"config_name": name, "data_files": f"{name}/*/*/*.parquet"} for name in names],
    }
    card = "".join(f"{name}: {json.dumps(value)}\n" for name, value in front.items() if value)  # JSON is YAML
    return result.with_files((*(out / name for name in names), described), front_matter=f"---\n{card}---\n\n")
