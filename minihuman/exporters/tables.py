"""Export the tables of the selected episodes as CSV, Parquet, SPSS, Stata or a Hugging Face dataset.

SPSS files end in `.sav`, and Stata files in `.dta`.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow.compute as pc
import pyarrow.parquet

from minihuman.dataset.activity_tables import PERSON_TABLE
from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.info_columns import list_info_columns
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.study_facts import decode_plan_protocol, read_study_facts
from minihuman.dataset.table_catalogue import TABLES, build_data_dictionary, describe_columns
from minihuman.dataset.table_columns import TableColumn
from minihuman.dataset.table_files import TableFormat
from minihuman.dataset.tables import Tables
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.labelled_tables import LabelledFormat, write_labelled_tables
from minihuman.exporters.reading import describe_reading
from minihuman.exporters.study_metadata import get_licence_id


def export_csv(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write the tables as CSV."""
    with chosen.tables() as tables:
        return replace(_write_tables(tables, out, "csv"), reading=describe_reading("episodes", "episodes.csv"))


def export_parquet(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write the tables as Parquet."""
    with chosen.tables() as tables:
        return _write_tables(tables, out, "parquet")


@dataclass(frozen=True, slots=True)
class ExportedTables:
    """The written tables: the export's result, and what describes them."""

    export: ExportResult
    plan: SessionPlan | None  # of the first selected session, which describes the study; None if there is none
    study_facts: AboutSpec
    further_columns: Mapping[str, tuple[TableColumn, ...]]  # by table: of labels and recorded info, and of people

    def find_columns(self, table: str) -> list[TableColumn]:
        """Return the columns of a written table, by the table's name; [] if no table has this name."""
        columns = [column for column in TABLES.get(table, ()) if column.name not in COLUMNS_NEEDING_WORLD]
        return [*columns, *self.further_columns.get(table, ())]


def export_tables(chosen: IncludedEpisodes, out: Path, kind: TableFormat) -> ExportedTables:
    """Write every table that has rows; excluded rows are present, with the reason in ``exclusion_reason``.

    Raises:
        LogError: if the source does not exist, or is a single log that cannot be read.
        ParticipantsFileError: if `participants.csv` cannot be read, or does not fit the protocol.
    """
    with chosen.tables() as tables:
        connection = tables.store.tables.connection
        further_columns = {name: tuple(list_info_columns(connection, name).values()) for name in TABLES}
        if tables.people is not None:
            further_columns[PERSON_TABLE] = tables.people.columns
        plan = read_first_plan(tables)
        return ExportedTables(_write_tables(tables, out, kind), plan, _read_facts(tables, plan), further_columns)


def _read_facts(tables: Tables, plan: SessionPlan | None) -> AboutSpec:
    """Read the facts about the study of a session's plan; return empty facts if the plan is None."""
    if plan is None:
        return AboutSpec()
    return read_study_facts(tables.source, plan.protocol_toml)


def _write_tables(tables: Tables, out: Path, kind: TableFormat) -> ExportResult:
    """Write every table that has rows, without the columns that need the worlds; return the counts and files."""
    paths = tables.write(out, kinds=(kind,), without=COLUMNS_NEEDING_WORLD)
    return replace(count_included(tables).with_files(paths), notes=tuple(_describe_missing_measures(tables)))


def _describe_missing_measures(tables: Tables) -> Iterator[str]:
    """Yield a note on the measures of the protocol's analysis that the files lack, if any, as they need the worlds."""
    plan = read_first_plan(tables)
    protocol = decode_plan_protocol(plan.protocol_toml) if plan is not None else None
    if protocol is None:
        return
    measures = (protocol.analysis.primary_measure, *protocol.analysis.secondary_measures)
    missing = [measure for measure in measures if measure in COLUMNS_NEEDING_WORLD]
    if missing:
        yield (
            f"the protocol's measures {', '.join(missing)} are not in these files, as they need the worlds; "
            "`minihuman report STUDY --out FOLDER` writes them into FOLDER/tables"
        )


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
    session = next((session for session in tables.sessions if session.outline is not None), None)
    if session is None:
        return None
    return tables.read_log(session).plan


def export_spss(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows as SPSS data."""
    return _write_labelled(chosen, out, "sav")


def export_stata(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows as Stata data."""
    return _write_labelled(chosen, out, "dta")


def _write_labelled(chosen: IncludedEpisodes, out: Path, kind: LabelledFormat) -> ExportResult:
    with chosen.tables() as tables:
        paths, notes = write_labelled_tables(tables, out, kind)
        return replace(count_included(tables).with_files(paths), notes=notes)


def export_hugging_face(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows as Parquet in a folder of its name, and ``dictionary.json`` about the columns."""
    with chosen.tables() as tables:
        names = list(dict.fromkeys(partition.table for partition, _ in tables.write_partitions(out)))
        people = tables.people
        result = count_included(tables)
        study_facts = _read_facts(tables, read_first_plan(tables))
    meanings = build_data_dictionary(without=COLUMNS_NEEDING_WORLD)
    if people is not None:
        names.append(PERSON_TABLE)
        meanings[PERSON_TABLE] = describe_columns(people.columns)
        (out / PERSON_TABLE).mkdir()
        pyarrow.parquet.write_table(people.rows, out / PERSON_TABLE / f"{PERSON_TABLE}.parquet")
    dictionary_json = json.dumps({name: meanings[name] for name in names}, indent=1)
    dictionary_path = out / "dictionary.json"
    dictionary_path.write_text(f"{dictionary_json}\n", encoding="utf-8", newline="\n")
    front_matter = {
        "license": get_licence_id(study_facts),
        "pretty_name": study_facts.title,
        "tags": ["minihuman", *study_facts.keywords],
        "configs": [{"config_name": name, "data_files": f"{name}/**/*.parquet"} for name in names],
    }
    card = "".join(f"{name}: {json.dumps(fact)}\n" for name, fact in front_matter.items() if fact)  # JSON is YAML
    return result.with_files((*(out / name for name in names), dictionary_path), front_matter=f"---\n{card}---\n\n")
