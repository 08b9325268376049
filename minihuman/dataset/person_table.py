"""The person table: a row per participant, with the columns that the protocol declares of `participants.csv`.

It is the one table that does not come from the logs. Its columns keep the names that the laboratory gave them, and
share the table with nothing but the study and the participant's code, so that they cannot collide with others.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from minihuman.dataset.activity_tables import PERSON_TABLE as PERSON_TABLE
from minihuman.dataset.participants_file import (
    CODE_COLUMN,
    FILE_NAME,
    ParticipantsFileError,
    PersonValue,
    find_participants_file,
    read_participants_file,
)
from minihuman.dataset.study_facts import read_study_facts
from minihuman.dataset.table_columns import TableColumn
from minihuman.experiment.protocol.about_spec import name_person_column
from minihuman.experiment.protocol.specs import ParticipantColumnSpec

_KEY_COLUMNS = (
    TableColumn("study", "text", "", "The study's name in the protocol."),
    TableColumn(CODE_COLUMN, "text", "", "The participant's code."),
)
_MAX_NAMED = 5  # participants whom a note names
_ARROW_TYPES = {"text": pa.string(), "integer": pa.int64(), "number": pa.float64(), "boolean": pa.bool_()}


@dataclass(frozen=True, slots=True)
class PersonTable:
    """The person table of some participants, and notes about the file that it comes from."""

    columns: tuple[TableColumn, ...]
    rows: pa.Table
    notes: tuple[str, ...] = ()


def build_person_table(
    source: Path, people: Sequence[tuple[str, str]], protocols: Iterable[bytes]
) -> PersonTable | None:
    """Build the person table of some participants; None if no protocol declares a column.

    Args:
        source: the study's folder, or a log in it.
        people: the study and the code of each participant, who have a row even if the file does not list them.
        protocols: the TOML of the protocols under which they played; columns of the same name must be equal.

    Raises:
        ParticipantsFileError: if `participants.csv` cannot be read or does not fit the protocol, or if two protocols
            declare the same column differently.
    """
    declared = _merge_columns(source, protocols)
    if not declared:
        return None
    file = read_participants_file(source, declared)
    columns = (*_KEY_COLUMNS, *map(_describe_column, declared))
    fields = [
        pa.field(column.name, _ARROW_TYPES[column.kind], metadata={"unit": column.unit, "meaning": column.meaning})
        for column in columns
    ]
    texts = [[study for study, _ in people], [code for _, code in people]]
    file_cells = [[file.rows.get(code, {}).get(column.name) for _, code in people] for column in declared]
    arrays = [pa.array(cells, field.type) for cells, field in zip([*texts, *file_cells], fields, strict=True)]
    rows = pa.Table.from_arrays(arrays, schema=pa.schema(fields))
    return PersonTable(columns, rows, (*file.notes, *_describe_gaps(source, people, file.rows)))


def _merge_columns(source: Path, protocols: Iterable[bytes]) -> tuple[ParticipantColumnSpec, ...]:
    """Return the columns that the protocols declare; raise ParticipantsFileError if two protocols differ in one."""
    merged: dict[str, ParticipantColumnSpec] = {}
    for toml in protocols:
        for column in read_study_facts(source, toml).participant_columns:
            if merged.setdefault(column.name, column) != column:
                raise ParticipantsFileError(
                    f"the versions of the protocol declare the column {column.name!r} of {FILE_NAME} differently; "
                    "choose one version with --version"
                )
    return tuple(merged.values())


def _describe_column(column: ParticipantColumnSpec) -> TableColumn:
    return TableColumn(
        name_person_column(column.name),
        column.type,
        column.unit,
        column.description,
        levels=tuple(column.levels.items()),
    )


def _describe_gaps(
    source: Path, people: Sequence[tuple[str, str]], rows: Mapping[str, Mapping[str, PersonValue]]
) -> list[str]:
    """Return a note that the file is missing or which participants it does not list; [] if it lists all of them."""
    if not find_participants_file(source).is_file():
        return [f"the columns of {FILE_NAME} are empty, as the study's folder has no such file"]
    missing = [code for _, code in dict.fromkeys(people) if code not in rows]
    if not missing:
        return []
    note = f"{FILE_NAME} has no line for {', '.join(missing[:_MAX_NAMED])}"
    if len(missing) > _MAX_NAMED:
        note += f" and {len(missing) - _MAX_NAMED} more"
    return [note]
