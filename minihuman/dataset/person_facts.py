"""What the laboratory says of each participant, as facts of the episodes that they played.

It does not import Arrow, because exports of demonstrations do without tables.
"""

from pathlib import Path

from minihuman.dataset.participants_file import PersonValue, read_participants_file
from minihuman.dataset.study_facts import read_study_facts
from minihuman.experiment.protocol.about_spec import name_person_column


def read_person_facts(source: Path, protocol_toml: bytes) -> dict[str, dict[str, PersonValue]]:
    """Read the declared columns of a study's `participants.csv`; return each participant's values by code and column.

    Missing values are omitted.

    Raises:
        ParticipantsFileError: if `participants.csv` cannot be read, or does not fit the protocol.
    """
    rows = read_participants_file(source, read_study_facts(source, protocol_toml).participant_columns).rows
    facts: dict[str, dict[str, PersonValue]] = {}
    for code, row in rows.items():
        facts[code] = {name_person_column(name): cell for name, cell in row.items() if cell is not None}
    return facts
