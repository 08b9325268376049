"""Export the tables as Psych-DS 1: CSV files named by keywords, and a description of every column.

Source: https://psych-ds.github.io. Every table is one file, `data/study-demo_description-steps_data.csv`.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from minihuman.dataset.episode_stream import IncludedEpisodes
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD, TABLES
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.exporters.bids.files import make_label
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import get_plan_study_facts
from minihuman.exporters.tables import export_tables

_TYPES = {"text": "Text", "key": "Text", "integer": "Integer", "number": "Float", "boolean": "Boolean"}


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table and ``dataset_description.json``."""
    written, first = export_tables(chosen, out / "data", "csv")
    if first is None:
        return replace(written, paths=())
    (out / "data/datapackage.json").unlink()  # its paths are not these
    (out / "data/dictionary.json").rename(out / "dictionary.json")
    files, tables = [], [table for table in TABLES if (out / "data" / f"{table}.csv").exists()]
    for table in tables:
        name = f"study-{make_label(first.study)}_description-{make_label(table)}_data.csv"
        files.append((out / "data" / f"{table}.csv").rename(out / "data" / name))
    described = out / "dataset_description.json"
    described.write_text(
        json.dumps(_description(first, tables), indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n"
    )
    return replace(written, paths=(*files, described, out / "dictionary.json"))


def _description(plan: SessionPlan, tables: list[str]) -> dict[str, Any]:
    about = get_plan_study_facts(plan)
    facts = {
        "author": [
            {"@type": "Person", "name": author.name}
            | ({"@id": f"https://orcid.org/{author.orcid}"} if author.orcid else {})
            for author in about.authors
        ],
        "license": about.licence,
        "keywords": list(about.keywords),
        "funder": list(about.funding),
        "identifier": f"https://doi.org/{about.doi}" if about.doi else "",
        "citation": list(about.references),
    }
    return {
        "@context": "http://schema.org",
        "@type": "Dataset",
        "name": about.title or plan.study,
        "description": about.description or f"Sessions of the study {plan.study}, as tidy tables.",
        "schemaVersion": "Psych-DS 1.0.0",
        "version": plan.study_version,
        **{name: value for name, value in facts.items() if value},
        "variableMeasured": list(_variables(tables)),
    }


def _variables(tables: list[str]) -> Iterator[dict[str, Any]]:
    """Every column once, whichever tables have it; where it means several things, each with its table."""
    meanings: dict[str, dict[str, list[str]]] = {}
    units: dict[str, str] = {}
    kinds: dict[str, str] = {}
    for table in tables:
        for column in TABLES[table]:
            if column.name not in COLUMNS_NEEDING_WORLD:
                meanings.setdefault(column.name, {}).setdefault(column.meaning, []).append(table)
                units.setdefault(column.name, column.unit)
                kinds.setdefault(column.name, column.kind)
    for name, said in meanings.items():
        alone = len(said) == 1
        text = " ".join(meaning if alone else f"{meaning} ({', '.join(theirs)})" for meaning, theirs in said.items())
        variable = {"@type": "PropertyValue", "name": name, "description": text}
        yield variable | {"additionalType": _TYPES[kinds[name]]} | ({"unitText": units[name]} if units[name] else {})
