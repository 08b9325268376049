"""The metadata that archives require of a data set: a card for people, `CITATION.cff`, DataCite's and Zenodo's.

Sources: Citation File Format 1.2.0; DataCite Metadata Schema 4; Zenodo's REST API (developers.zenodo.org).
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from minihuman.experiment.protocol.specs import AboutSpec, AuthorSpec
from minihuman.exporters.study_metadata import get_doi_url

_DOI_IN_TEXT = re.compile(r"10\.\d{4,9}/[^\s,;]+[^\s,;.]")
_SPDX_URL = "https://spdx.org/licenses/"
_UNQUOTED = ("cff-version", "type")  # fields of CITATION.cff that have fixed words


def split_name(name: str) -> tuple[str, str]:
    """Split an author's name, "Given Family" or "Family, Given", into (family, given); given is "" for one word."""
    family, comma, given = name.partition(",")
    if comma:
        return family.strip(), given.strip()
    given, _, family = name.strip().rpartition(" ")
    return family, given


def build_card(facts: AboutSpec, study: str, year: str, data_dictionary: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the lines of a data set's card in Markdown: the facts about the study, and every column of the tables.

    Args:
        facts: the facts about the study.
        study: the study's name.
        year: the year of publication.
        data_dictionary: the facts about each column, by the names of the table and the column.
    """
    lines = [f"# {facts.title}", "", facts.description, "", "| | |", "|---|---|"]
    rows = {
        "Authors": "; ".join(_describe_author(author) for author in facts.authors),
        "Licence": facts.licence,
        "DOI": get_doi_url(facts),
        "Keywords": ", ".join(facts.keywords),
        "Institution": ", ".join(filter(None, (facts.department, facts.institution, facts.address))),
        "Ethics approvals": "; ".join(facts.ethics_approvals),
        "Funding": "; ".join(facts.funding),
        "Task": facts.task_description,
        "Study": study,
    }
    lines += [f"| {name} | {_escape_cell(text)} |" for name, text in rows.items() if text]
    lines += ["", "## How to cite", "", format_citation(facts, year)]
    if facts.how_to_acknowledge:
        lines += ["", facts.how_to_acknowledge]
    if facts.references:
        lines += ["", "## References", "", *(f"- {reference}" for reference in facts.references)]
    return [*lines, "", *_describe_columns(data_dictionary)]


def format_citation(facts: AboutSpec, year: str) -> str:
    """Return a reference to the data set in APA's form; the facts must name an author."""
    names = []
    for author in facts.authors:
        family, given = split_name(author.name)
        initials = " ".join(f"{word[0]}." for word in given.split())
        names.append(", ".join(filter(None, (family, initials))))
    joined = names[-1]
    if len(names) > 1:
        joined = f"{', '.join(names[:-1])}, & {names[-1]}"
    return f"{joined} ({year}). {facts.title} [Data set]. {get_doi_url(facts)}".strip()


def _describe_author(author: AuthorSpec) -> str:
    text = author.name
    if author.orcid:
        text += f" ([{author.orcid}](https://orcid.org/{author.orcid}))"
    if author.affiliation:
        text += f", {author.affiliation}"
    return text


def _escape_cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _describe_columns(data_dictionary: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield the lines of Markdown that describe the columns of each table of the data set; none without tables."""
    if data_dictionary:
        yield from ("## Columns", "")
    for table, columns in data_dictionary.items():
        yield from (f"### {table}", "", "| column | type | unit | meaning |", "|---|---|---|---|")
        for name, column in columns.items():
            meaning = _escape_cell(column["meaning"])
            if column.get("levels"):
                meaning += f" Levels: {_escape_cell(column['levels'])}."
            yield f"| `{name}` | {column['type']} | {column['unit']} | {meaning} |"
        yield ""


def format_citation_file(facts: AboutSpec, version: str, date: str) -> str:
    """Return the text of `CITATION.cff`.

    Args:
        facts: the facts about the study.
        version: the study's version.
        date: the date of release in ISO 8601, such as "2026-01-31".
    """
    content: dict[str, Any] = {
        "cff-version": "1.2.0",
        "message": facts.how_to_acknowledge or "If you use these data, please cite them.",
        "type": "dataset",
        "title": facts.title,
        "abstract": facts.description,
        "authors": [_describe_citation_author(author) for author in facts.authors],
        "version": version,
        "date-released": date,
        "doi": facts.doi,
        "keywords": list(facts.keywords),
    }
    if "://" in facts.licence:
        content["license-url"] = facts.licence
    else:
        content["license"] = facts.licence
    return "".join(f"{line}\n" for line in _format_yaml({name: part for name, part in content.items() if part}))


def _describe_citation_author(author: AuthorSpec) -> dict[str, str]:
    family, given = split_name(author.name)
    person = {"family-names": family, "given-names": given, "affiliation": author.affiliation, "email": author.email}
    if author.orcid:
        person["orcid"] = f"https://orcid.org/{author.orcid}"
    return {name: text for name, text in person.items() if text}


def _format_yaml(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a YAML mapping of texts, lists of texts and lists of mappings."""
    for name, part in content.items():
        if not isinstance(part, list):
            yield f"{name}: {_format_scalar(name, part)}"
            continue
        yield f"{name}:"
        for member in part:
            yield from _format_member(member)


def _format_member(member: str | Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of a member of a YAML list."""
    if isinstance(member, str):
        yield f"  - {_format_scalar('', member)}"
        return
    mark = "-"
    for name, text in member.items():
        yield f"  {mark} {name}: {_format_scalar(name, text)}"
        mark = " "


def _format_scalar(name: str, text: str) -> str:
    """Return a text as a JSON string, which is valid YAML, or unquoted in a field that has fixed words."""
    if name in _UNQUOTED:
        return text
    return json.dumps(text, ensure_ascii=False)


def build_datacite_metadata(facts: AboutSpec, version: str, year: str) -> dict[str, Any]:
    """Return the metadata of the data set in DataCite's JSON, schema version 4.

    Args:
        facts: the facts about the study.
        version: the study's version.
        year: the year of publication.
    """
    content: dict[str, Any] = {
        "schemaVersion": "http://datacite.org/schema/kernel-4",
        "types": {"resourceTypeGeneral": "Dataset", "resourceType": "Behavioural data"},
        "creators": [_describe_creator(author) for author in facts.authors],
        "titles": [{"title": facts.title}],
        "publisher": {"name": facts.institution or "(:unav)"},  # DataCite's code for what is not known
        "publicationYear": year,
        "version": version,
        "descriptions": [{"description": facts.description, "descriptionType": "Abstract"}],
        "subjects": [{"subject": keyword} for keyword in facts.keywords],
        "fundingReferences": [{"funderName": funding} for funding in facts.funding],
        "relatedIdentifiers": list(_list_related(facts.references)),
        "rightsList": [_describe_rights(facts.licence)],
    }
    if facts.task_description:
        content["descriptions"].append({"description": facts.task_description, "descriptionType": "Methods"})
    if facts.doi:
        content["doi"] = facts.doi
    return {name: part for name, part in content.items() if part}


def _describe_creator(author: AuthorSpec) -> dict[str, Any]:
    family, given = split_name(author.name)
    creator: dict[str, Any] = {"name": ", ".join(filter(None, (family, given))), "nameType": "Personal"}
    if given:
        creator |= {"familyName": family, "givenName": given}
    if author.orcid:
        identifier = f"https://orcid.org/{author.orcid}"
        scheme = {"nameIdentifierScheme": "ORCID", "schemeUri": "https://orcid.org"}
        creator["nameIdentifiers"] = [{"nameIdentifier": identifier, **scheme}]
    if author.affiliation:
        creator["affiliation"] = [{"name": author.affiliation}]
    return creator


def _describe_rights(licence: str) -> dict[str, str]:
    if "://" in licence:
        return {"rights": licence, "rightsUri": licence}
    return {
        "rights": licence,
        "rightsUri": f"{_SPDX_URL}{licence}.html",
        "rightsIdentifier": licence,
        "rightsIdentifierScheme": "SPDX",
        "schemeUri": _SPDX_URL,
    }


def _list_related(references: Sequence[str]) -> Iterator[dict[str, str]]:
    """Yield the DOI in each reference that has one, as a work that the data set refers to."""
    for reference in references:
        match = _DOI_IN_TEXT.search(reference)
        if match is not None:
            yield {
                "relatedIdentifier": match[0],
                "relatedIdentifierType": "DOI",
                "relationType": "References",
            }


def build_zenodo_metadata(facts: AboutSpec, version: str, date: str) -> dict[str, Any]:
    """Return the metadata of a data set in the form that Zenodo's API takes.

    Args:
        facts: the facts about the study.
        version: the study's version.
        date: the date of publication in ISO 8601.
    """
    creators = []
    for author in facts.authors:
        person = {
            "name": ", ".join(filter(None, split_name(author.name))),
            "affiliation": author.affiliation,
            "orcid": author.orcid,
        }
        creators.append({name: text for name, text in person.items() if text})
    notes = [*facts.ethics_approvals, *facts.funding, facts.how_to_acknowledge]
    metadata: dict[str, Any] = {
        "upload_type": "dataset",
        "publication_date": date,
        "title": facts.title,
        "creators": creators,
        "description": facts.description,
        "access_right": "open",
        "license": facts.licence.lower(),
        "doi": facts.doi,
        "keywords": list(facts.keywords),
        "notes": "; ".join(filter(None, notes)),
        "references": list(facts.references),
        "version": version,
    }
    return {"metadata": {name: part for name, part in metadata.items() if part}}
