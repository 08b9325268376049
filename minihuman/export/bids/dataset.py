"""What describes a BIDS dataset as a whole: who made it, by which rules, and who took part."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from minihuman import __version__
from minihuman.export.bids.files import write_json, write_tsv
from minihuman.export.participants import read_participants
from minihuman.study.about import About

BIDS_VERSION = "1.11.0"
HED_VERSION = "8.3.0"
GENERATED_BY = {"Name": "minihuman", "Version": __version__}


def describe(out: Path, about: About, study: str) -> Path:
    """Write ``dataset_description.json``."""
    return write_json(
        out / "dataset_description.json",
        {
            "Name": about.title or study,
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "raw",
            "HEDVersion": HED_VERSION,
            "License": about.licence,
            "Authors": [author.name for author in about.authors],
            "Keywords": list(about.keywords),
            "HowToAcknowledge": about.acknowledge,
            "Funding": list(about.funding),
            "EthicsApprovals": list(about.ethics),
            "ReferencesAndLinks": list(about.references),
            "DatasetDOI": f"doi:{about.doi}" if about.doi else "",
            "GeneratedBy": [GENERATED_BY],
        },
    )


def describe_derivatives(folder: Path, about: About, study: str) -> Path:
    """Write the description of the tables and figures that were made from the data."""
    return write_json(
        folder / "dataset_description.json",
        {
            "Name": f"{about.title or study}: tables and figures",
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "derivative",
            "GeneratedBy": [GENERATED_BY],
            "License": about.licence,
        },
    )


def task_facts(about: About, study: str) -> dict[str, Any]:
    """What every recording's sidecar says of the task and the place."""
    facts = {
        "TaskName": about.title or study,
        "TaskDescription": about.task or about.description,
        "InstitutionName": about.institution,
        "InstitutionAddress": about.address,
        "InstitutionalDepartmentName": about.department,
    }
    return {name: value for name, value in facts.items() if value}


def write_participants(out: Path, source: Path, about: About, people: Sequence[Mapping[str, Any]]) -> Path:
    """Write ``participants.tsv`` and what its columns mean; the laboratory's own columns behind ours.

    Raises:
        ExportError: as ``read_participants``.
    """
    known = read_participants(source, about)
    own = [column.name for column in about.participants]
    rows = [{**person, **known.get(person["code"], {})} for person in people]
    described: dict[str, Any] = {
        "group": {"Description": "The group that the participant was allocated to."},
        "player": {"Description": "Whoever pressed the keys: human, or a simulated player's name."},
    }
    for column in about.participants:
        described[column.name] = {"Description": column.meaning}
        described[column.name] |= {"Units": column.unit} if column.unit else {}
        described[column.name] |= {"Levels": column.levels} if column.levels else {}
    write_json(out / "participants.json", described)
    return write_tsv(out / "participants.tsv", ["participant_id", "group", "player", *own], rows)
