"""Export the tables as Parquet with a Croissant description, which dataset search engines read.

Source: Croissant 1.0, https://docs.mlcommons.org/croissant/docs/croissant-spec.html. `mlcroissant validate --jsonld
croissant.json` checks it, and `mlcroissant.Dataset` reads the records.
"""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from minihuman.dataset.episode_stream import IncludedEpisodes
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD, PRIMARY_KEYS, TABLES, TableColumn
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import get_plan_study_facts
from minihuman.exporters.tables import export_tables

_TYPES = {"text": "sc:Text", "key": "sc:Text", "integer": "cr:Int64", "number": "cr:Float64", "boolean": "sc:Boolean"}
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


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table and ``croissant.json``."""
    written, first = export_tables(chosen, out, "parquet")
    if first is None:
        return replace(written, paths=())
    path = out / "croissant.json"
    described = _description(first, sorted(out.glob("*.parquet")))
    path.write_text(json.dumps(described, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")
    return replace(written, paths=(*written.paths, path))


def _description(plan: SessionPlan, tables: list[Path]) -> dict[str, Any]:
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
    key = {"key": [{"@id": f"{table}/{name}"} for name in PRIMARY_KEYS[table]]} if table in PRIMARY_KEYS else {}
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
                "dataType": _TYPES[column.kind],
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
