"""``export psych-ds``: the tables as Psych-DS 1, CSV files named by keywords and a description of every column.

Source: https://psych-ds.github.io. Every table is one file, ``data/study-demo_description-steps_data.csv``.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from minihuman.data.chosen import ChosenEpisodes
from minihuman.data.columns import NEED_WORLD, TABLES
from minihuman.export.asked import about_of_plan
from minihuman.export.bids.files import label
from minihuman.export.port import Written
from minihuman.export.tables import export_tables
from minihuman.study.plan import SessionPlan

_TYPES = {"text": "Text", "key": "Text", "whole": "Integer", "number": "Float", "yes_no": "Boolean"}


def export(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write every table and ``dataset_description.json``."""
    written, first = export_tables(chosen, out / "data", "csv")
    if first is None:
        return replace(written, paths=())
    (out / "data/datapackage.json").unlink()  # its paths are not these
    (out / "data/dictionary.json").rename(out / "dictionary.json")
    files = []
    for table in TABLES:
        name = f"study-{label(first.study)}_description-{label(table)}_data.csv"
        files.append((out / "data" / f"{table}.csv").rename(out / "data" / name))
    described = out / "dataset_description.json"
    described.write_text(json.dumps(_description(first), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return replace(written, paths=(*files, described, out / "dictionary.json"))


def _description(plan: SessionPlan) -> dict[str, Any]:
    about = about_of_plan(plan)
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
        "variableMeasured": list(_variables()),
    }


def _variables() -> Iterator[dict[str, Any]]:
    """Every column once, whichever tables have it; where it means several things, each with its table."""
    meanings: dict[str, dict[str, list[str]]] = {}
    units: dict[str, str] = {}
    kinds: dict[str, str] = {}
    for table, columns in TABLES.items():
        for column in columns:
            if column.name not in NEED_WORLD:
                meanings.setdefault(column.name, {}).setdefault(column.meaning, []).append(table)
                units.setdefault(column.name, column.unit)
                kinds.setdefault(column.name, column.kind)
    for name, said in meanings.items():
        alone = len(said) == 1
        text = " ".join(meaning if alone else f"{meaning} ({', '.join(tables)})" for meaning, tables in said.items())
        variable = {"@type": "PropertyValue", "name": name, "description": text}
        yield variable | {"additionalType": _TYPES[kinds[name]]} | ({"unitText": units[name]} if units[name] else {})
