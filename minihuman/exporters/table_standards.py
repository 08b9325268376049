"""Export the tables under standards that describe datasets: Croissant, Psych-DS 1 and Frictionless Data Packages."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from minihuman.dataset.activity_tables import PERSON_TABLE
from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.table_catalogue import TABLE_VERSION, TABLES, find_primary_key
from minihuman.dataset.table_columns import TableColumn, is_time
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.specs import AboutSpec, AuthorSpec
from minihuman.exporters.bids.files import make_label
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.reading import describe_reading
from minihuman.exporters.study_metadata import get_doi_url
from minihuman.exporters.tables import ExportedTables, export_tables

_CROISSANT_TYPES = {
    "text": "sc:Text",
    "key": "sc:Text",
    "integer": "cr:Int64",
    "number": "cr:Float64",
    "boolean": "sc:Boolean",
}
_JSON_TERMS = ("data", "examples")  # whose content is JSON
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
    **{term: {"@id": f"cr:{term}", "@type": "@json"} for term in _JSON_TERMS},
    **{term: f"cr:{term}" for term in _TERMS.split()},
}


def export_croissant(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table as Parquet, and ``croissant.json``, which describes them.

    Without a session, the result names no files.
    """
    exported = export_tables(chosen, out, "parquet")
    if exported.plan is None:
        return replace(exported.export, paths=())
    path = out / "croissant.json"
    description = _describe_as_croissant(exported.plan, exported, sorted(out.glob("*.parquet")))
    path.write_text(json.dumps(description, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")
    return replace(exported.export, paths=(*exported.export.paths, path))


def _describe_as_croissant(plan: SessionPlan, exported: ExportedTables, tables: list[Path]) -> dict[str, Any]:
    """Return the content of ``croissant.json``; ``tables`` are the paths of the tables' files."""
    study_facts = exported.study_facts
    facts = {
        "license": study_facts.licence,
        "keywords": list(study_facts.keywords),
        "citeAs": get_doi_url(study_facts) or study_facts.how_to_acknowledge,
        "url": get_doi_url(study_facts),
        "creator": [_describe_author(author, "sc:Person") for author in study_facts.authors],
    }
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": study_facts.title or plan.study,
        "description": study_facts.description or f"Sessions of the study {plan.study}, as tidy tables.",
        "version": _format_version(plan.study_version),
        **{name: fact for name, fact in facts.items() if fact},
        "distribution": [_describe_file(path) for path in tables],
        "recordSet": [_describe_record_set(path.stem, exported.find_columns(path.stem)) for path in tables],
    }


def _describe_file(path: Path) -> dict[str, Any]:
    """Describe a Parquet file as Croissant's file object."""
    return {
        "@type": "cr:FileObject",
        "@id": path.name,
        "name": path.name,
        "contentUrl": path.name,
        "encodingFormat": "application/x-parquet",
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }


def _describe_record_set(table: str, columns: list[TableColumn]) -> dict[str, Any]:
    """Describe a table as Croissant's record set."""
    record_set: dict[str, Any] = {"@type": "cr:RecordSet", "@id": table, "name": table}
    key_columns = find_primary_key(table)
    if key_columns:
        record_set["key"] = [{"@id": f"{table}/{name}"} for name in key_columns]
    return record_set | {"field": [_describe_field(table, column) for column in columns]}


def _describe_field(table: str, column: TableColumn) -> dict[str, Any]:
    description = column.meaning
    if column.unit:
        description += f" Unit: {column.unit}."
    return {
        "@type": "cr:Field",
        "@id": f"{table}/{column.name}",
        "name": f"{table}/{column.name}",
        "description": description,
        "dataType": "sc:DateTime" if is_time(column) else _CROISSANT_TYPES[column.kind],
        "source": {"fileObject": {"@id": f"{table}.parquet"}, "extract": {"column": column.name}},
    }


def _describe_author(author: AuthorSpec, kind: str) -> dict[str, str]:
    """Describe an author as a person; ``kind`` is the name that the vocabulary has for a person: "sc:Person"."""
    person = {"@type": kind, "name": author.name}
    if author.orcid:
        person["@id"] = _build_orcid_url(author)
    return person


def _build_orcid_url(author: AuthorSpec) -> str:
    return f"https://orcid.org/{author.orcid}"


def _format_version(version: str) -> str:
    """Format a version as three numbers, as Croissant requires; other parts are dropped, and missing ones are zeros."""
    numbers = [part for part in version.split(".") if part.isdigit()]
    return ".".join([*numbers, "0", "0", "0"][:3])


_PSYCH_DS_TYPES = {"text": "Text", "key": "Text", "integer": "Integer", "number": "Float", "boolean": "Boolean"}


def export_psych_ds(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table as CSV, and ``dataset_description.json``; without a session, the result names no files."""
    exported = export_tables(chosen, out / "data", "csv")
    plan = exported.plan
    if plan is None:
        return replace(exported.export, paths=())
    (out / "data/datapackage.json").unlink()  # its paths are those before the files are renamed
    (out / "data/dictionary.json").rename(out / "dictionary.json")
    files = []
    tables = [table for table in (*TABLES, PERSON_TABLE) if (out / "data" / f"{table}.csv").exists()]
    for table in tables:
        name = f"study-{make_label(plan.study)}_description-{make_label(table)}_data.csv"
        files.append((out / "data" / f"{table}.csv").rename(out / "data" / name))
    description_path = out / "dataset_description.json"
    description_path.write_text(
        json.dumps(_describe_as_psych_ds(plan, exported, tables), indent=1, ensure_ascii=False) + "\n",
        encoding="utf-8",
        newline="\n",
    )
    reading = describe_reading("episodes", f"data/study-{make_label(plan.study)}_description-episodes_data.csv")
    return replace(exported.export, paths=(*files, description_path, out / "dictionary.json"), reading=reading)


def _describe_as_psych_ds(plan: SessionPlan, exported: ExportedTables, tables: list[str]) -> dict[str, Any]:
    """Return the content of ``dataset_description.json``; ``tables`` are the names of the tables."""
    study_facts = exported.study_facts
    facts = {
        "author": [_describe_author(author, "Person") for author in study_facts.authors],
        "license": study_facts.licence,
        "keywords": list(study_facts.keywords),
        "funder": list(study_facts.funding),
        "identifier": get_doi_url(study_facts),
        "citation": list(study_facts.references),
    }
    return {
        "@context": "http://schema.org",
        "@type": "Dataset",
        "name": study_facts.title or plan.study,
        "description": study_facts.description or f"Sessions of the study {plan.study}, as tidy tables.",
        "schemaVersion": "Psych-DS 1.0.0",
        "version": plan.study_version,
        "tableVersion": TABLE_VERSION,
        **{name: fact for name, fact in facts.items() if fact},
        "variableMeasured": list(_describe_variables(exported, tables)),
    }


def _describe_variables(exported: ExportedTables, tables: list[str]) -> Iterator[dict[str, Any]]:
    """Yield the description of each distinct column name of the tables.

    If a name has several meanings, the description has each of them with its tables.
    """
    meanings: dict[str, dict[str, list[str]]] = {}
    units: dict[str, str] = {}
    kinds: dict[str, str] = {}
    for table in tables:
        for column in exported.find_columns(table):
            meanings.setdefault(column.name, {}).setdefault(column.meaning, []).append(table)
            units.setdefault(column.name, column.unit)
            kinds.setdefault(column.name, column.kind)
    for name, tables_by_meaning in meanings.items():
        texts = list(tables_by_meaning)
        if len(texts) > 1:
            texts = [f"{meaning} ({', '.join(owners)})" for meaning, owners in tables_by_meaning.items()]
        variable = {"@type": "PropertyValue", "name": name, "description": " ".join(texts)}
        variable["additionalType"] = _PSYCH_DS_TYPES[kinds[name]]
        if units[name]:
            variable["unitText"] = units[name]
        yield variable


def export_frictionless(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table as CSV, and ``datapackage.json`` with the meaning of the columns and facts about the study.

    Without a session, the result names no files.
    """
    exported = export_tables(chosen, out, "csv")
    plan = exported.plan
    if plan is None:
        return replace(exported.export, paths=())
    path = out / "datapackage.json"
    package = json.loads(path.read_text(encoding="utf-8"))
    for resource in package["resources"]:
        content = (out / resource["path"]).read_bytes()
        resource |= {"bytes": len(content), "hash": f"sha256:{hashlib.sha256(content).hexdigest()}"}
    package |= {"name": plan.study, **get_package_properties(exported.study_facts)}
    path.write_text(json.dumps(package, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")
    return replace(exported.export, reading=describe_reading("episodes", "episodes.csv"))


def get_package_properties(study_facts: AboutSpec) -> dict[str, Any]:
    """Return the protocol's facts about the study as properties of a data package."""
    licence = {"path" if "://" in study_facts.licence else "name": study_facts.licence}
    properties = {
        "title": study_facts.title,
        "description": study_facts.description,
        "homepage": get_doi_url(study_facts),
        "licenses": [licence] if study_facts.licence else [],
        "contributors": [_describe_contributor(author) for author in study_facts.authors],
        "keywords": list(study_facts.keywords),
        "sources": [{"title": reference} for reference in study_facts.references],
    }
    return {name: content for name, content in properties.items() if content}


def _describe_contributor(author: AuthorSpec) -> dict[str, str]:
    """Describe an author as a contributor to a data package."""
    contributor = {"title": author.name, "role": "author"}
    if author.email:
        contributor["email"] = author.email
    if author.orcid:
        contributor["path"] = _build_orcid_url(author)
    if author.affiliation:
        contributor["organization"] = author.affiliation
    return contributor
