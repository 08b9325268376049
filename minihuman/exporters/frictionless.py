"""Export the tables as CSV in a Data Package that names its authors and licence.

Source: https://specs.frictionlessdata.io. `frictionless validate datapackage.json` checks types and keys.
"""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from minihuman.dataset.episode_stream import IncludedEpisodes
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import get_plan_study_facts
from minihuman.exporters.tables import export_tables


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
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
