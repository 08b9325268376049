"""Export the tables by standards that describe them: Croissant, Psych-DS 1 and Frictionless Data Packages."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.table_catalogue import TABLES, find_primary_key
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD, TableColumn
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.bids.files import make_label
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import get_plan_study_facts
from minihuman.exporters.tables import export_tables

_CROISSANT_TYPES = {
    "text": "sc:Text",
    "key": "sc:Text",
    "integer": "cr:Int64",
    "number": "cr:Float64",
    "boolean": "sc:Boolean",
}
_JSON = ("data", "examples")  # what the vocabulary takes as it is
_TERMS = (
    "citeAs column extract field fileObject fileProperty fileSet format includes isLiveDataset jsonPath key md5 "
    "parentField path recordSet references regex repeated replace separator source subField transform"
)
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "sc": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    **{term: {"@id": f"cr:{term}", "@type": "@json"} for term in _JSON},
    **{term: f"cr:{term}" for term in _TERMS.split()},
}


def export_croissant(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table and ``croissant.json``."""
    written, first = export_tables(chosen, out, "parquet")
    if first is None:
        return replace(written, paths=())
    path = out / "croissant.json"
    described = _describe_as_croissant(first, sorted(out.glob("*.parquet")))
    path.write_text(json.dumps(described, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")
    return replace(written, paths=(*written.paths, path))


def _describe_as_croissant(plan: SessionPlan, tables: list[Path]) -> dict[str, Any]:
    about = get_plan_study_facts(plan)
    facts = {
        "license": about.licence,
        "keywords": list(about.keywords),
        "citeAs": f"https://doi.org/{about.doi}" if about.doi else about.how_to_acknowledge,
        "url": f"https://doi.org/{about.doi}" if about.doi else "",
        "creator": [
            {"@type": "sc:Person", "name": author.name}
            | ({"@id": f"https://orcid.org/{author.orcid}"} if author.orcid else {})
            for author in about.authors
        ],
    }
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": about.title or plan.study,
        "description": about.description or f"Sessions of the study {plan.study}, as tidy tables.",
        "version": _version(plan.study_version),
        **{name: value for name, value in facts.items() if value},
        "distribution": [_file(path) for path in tables],
        "recordSet": [_records(path.stem, TABLES[path.stem]) for path in tables],
    }


def _file(path: Path) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": path.name,
        "name": path.name,
        "contentUrl": path.name,
        "encodingFormat": "application/x-parquet",
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }


def _records(table: str, columns: tuple[TableColumn, ...]) -> dict[str, Any]:
    names = find_primary_key(table)
    key = {"key": [{"@id": f"{table}/{name}"} for name in names]} if names else {}
    return {
        "@type": "cr:RecordSet",
        "@id": table,
        "name": table,
        **key,
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{table}/{column.name}",
                "name": f"{table}/{column.name}",
                "description": column.meaning + (f" Unit: {column.unit}." if column.unit else ""),
                "dataType": _CROISSANT_TYPES[column.kind],
                "source": {"fileObject": {"@id": f"{table}.parquet"}, "extract": {"column": column.name}},
            }
            for column in columns
            if column.name not in COLUMNS_NEEDING_WORLD
        ],
    }


def _version(said: str) -> str:
    """Three numbers, as Croissant asks; zeros where the protocol says fewer or something else."""
    numbers = [part for part in said.split(".") if part.isdigit()]
    return ".".join([*numbers, "0", "0", "0"][:3])


_PSYCH_DS_TYPES = {"text": "Text", "key": "Text", "integer": "Integer", "number": "Float", "boolean": "Boolean"}


def export_psych_ds(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table and ``dataset_description.json``."""
    written, first = export_tables(chosen, out / "data", "csv")
    if first is None:
        return replace(written, paths=())
    (out / "data/datapackage.json").unlink()  # its paths are not these
    (out / "data/dictionary.json").rename(out / "dictionary.json")
    files = []
    tables = [table for table in TABLES if (out / "data" / f"{table}.csv").exists()]
    for table in tables:
        name = f"study-{make_label(first.study)}_description-{make_label(table)}_data.csv"
        files.append((out / "data" / f"{table}.csv").rename(out / "data" / name))
    described = out / "dataset_description.json"
    described.write_text(
        json.dumps(_describe_as_psych_ds(first, tables), indent=1, ensure_ascii=False) + "\n",
        encoding="utf-8",
        newline="\n",
    )
    return replace(written, paths=(*files, described, out / "dictionary.json"))


def _describe_as_psych_ds(plan: SessionPlan, tables: list[str]) -> dict[str, Any]:
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
        yield (
            variable
            | {"additionalType": _PSYCH_DS_TYPES[kinds[name]]}
            | ({"unitText": units[name]} if units[name] else {})
        )


def export_frictionless(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table, what its columns mean and the facts about the study."""
    written, first = export_tables(chosen, out, "csv")
    if first is None:
        return replace(written, paths=())
    path = out / "datapackage.json"
    package = json.loads(path.read_text(encoding="utf-8"))
    for resource in package["resources"]:
        content = (out / resource["path"]).read_bytes()
        resource |= {"bytes": len(content), "hash": f"sha256:{hashlib.sha256(content).hexdigest()}"}
    package |= {"name": first.study, **get_package_properties(get_plan_study_facts(first))}
    path.write_text(json.dumps(package, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")
    return written


def get_package_properties(about: AboutSpec) -> dict[str, Any]:
    """What the protocol says of the study, as a package's properties."""
    licence = {"path" if "://" in about.licence else "name": about.licence}
    people = [
        {"title": author.name, "role": "author"}
        | ({"email": author.email} if author.email else {})
        | ({"path": f"https://orcid.org/{author.orcid}"} if author.orcid else {})
        | ({"organization": author.affiliation} if author.affiliation else {})
        for author in about.authors
    ]
    found = {
        "title": about.title,
        "description": about.description,
        "homepage": f"https://doi.org/{about.doi}" if about.doi else "",
        "licenses": [licence] if about.licence else [],
        "contributors": people,
        "keywords": list(about.keywords),
        "sources": [{"title": reference} for reference in about.references],
    }
    return {name: value for name, value in found.items() if value}
