"""Export the report's tables of the selected episodes as CSV or Parquet, for SPSS (`.sav`) and Stata (`.dta`), and as a
Hugging Face data set.
"""

import json
from pathlib import Path
from textwrap import shorten
from typing import Any, Literal

import pyarrow.compute as pc

from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import EVERY_MOMENT, TABLES, build_data_dictionary
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.table_files import TableFormat, list_partitions, write_partitions, write_tables
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import get_plan_study_facts


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
                column.name: text if kind == "sav" else shorten(text, _LABEL_CHARACTERS, placeholder=" ...")
                for column in described
                for text in [f"{column.meaning}{f' ({column.unit})' if column.unit else ''}"]
            }
            answers = {flag: {0.0: "no", 1.0: "yes"} for flag in flags}
            paths.append(out / f"{name}.{kind}")
            write = pyreadstat.write_sav if kind == "sav" else pyreadstat.write_dta
            write(frame, str(paths[-1]), column_labels=labels, variable_value_labels=answers)
        return count_included(store).with_files(tuple(paths))


def export_hugging_face(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows; those that do not count are there too, with the reason."""
    from minihuman.log.read.session_reader import read_log

    with chosen.store() as store:
        names = list(dict.fromkeys(one.table for one, _ in write_partitions(store, list_partitions(store), out)))
        result, first = count_included(store), find_first_log(store)
    meanings = build_data_dictionary(without=COLUMNS_NEEDING_WORLD)
    described = out / "dictionary.json"
    described.write_text(
        json.dumps({name: meanings[name] for name in names}, indent=1) + "\n", encoding="utf-8", newline="\n"
    )
    about = get_plan_study_facts(read_log(first).plan) if first else None
    front = {
        "license": about.licence.lower() if about and about.licence and "://" not in about.licence else "unknown",
        "pretty_name": about.title if about else "",
        "tags": ["minihuman", *(about.keywords if about else ())],
        "configs": [{"config_name": name, "data_files": f"{name}/*/*/*.parquet"} for name in names],
    }
    card = "".join(f"{name}: {json.dumps(value)}\n" for name, value in front.items() if value)  # JSON is YAML
    return result.with_files((*(out / name for name in names), described), front_matter=f"---\n{card}---\n\n")
