"""Write a study as the folder that an archive takes: the export in its format, a card and the archive's metadata."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from minihuman.dataset.log_files import list_readable_logs
from minihuman.dataset.selection import Selection
from minihuman.dataset.study_facts import ABOUT_FILE_NAME, find_study_folder, read_study_facts
from minihuman.errors import ExportError
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.dataset_card import (
    build_card,
    build_datacite_metadata,
    build_zenodo_metadata,
    format_citation_file,
)
from minihuman.exporters.exporter import ExportResult, export_study
from minihuman.exporters.recorded_exports import write_recorded_export
from minihuman.log.read.session_reader import read_log
from minihuman.storage.system import now_text

_REQUIRED = ("title", "description", "authors", "licence")  # by every archive
_RECOMMENDED = ("keywords", "ethics_approvals", "funding", "doi", "how_to_acknowledge")
_PUBLIC_DOMAIN = ("CC0", "CC0-1.0", "PDDL", "PDDL-1.0")
_DATE_CHARACTERS = len("2026-01-31")
_YEAR_CHARACTERS = len("2026")


@dataclass(frozen=True, slots=True)
class Archive:
    """An archive of data sets: the format that it takes, and how a folder is uploaded."""

    title: str
    format: str
    upload: str  # the command of the archive's own client, with the folder as {out}


ARCHIVES = {
    "osf": Archive("OSF", "psych-ds", "osf --project PROJECT upload --recursive {out} osfstorage"),
    "zenodo": Archive("Zenodo", "frictionless", "see docs/exports.md, as Zenodo has no client of its own"),
    "hugging-face": Archive("Hugging Face", "hugging-face", "hf upload NAME {out} --repo-type dataset"),
    "openneuro": Archive("OpenNeuro", "bids", "deno run -A jsr:@openneuro/cli upload --affirmDefaced {out}"),
}


def find_archive(name: str) -> Archive:
    """Return the archive with a given name, such as "zenodo".

    Raises:
        ExportError: if there is none.
    """
    archive = ARCHIVES.get(name)
    if archive is None:
        raise ExportError(f"the archive {name!r} is unknown; use one of {', '.join(ARCHIVES)}")
    return archive


@dataclass(frozen=True, slots=True)
class Publication:
    """A study that is published in an archive: what is stated about it, and the plan of one of its sessions."""

    archive: str
    facts: AboutSpec
    plan: SessionPlan

    @property
    def notes(self) -> tuple[str, ...]:
        """Return notes on recommended facts that are not stated, and on facts that contradict the archive's rules."""
        notes = []
        missing = [name for name in _RECOMMENDED if not getattr(self.facts, name)]
        if missing:
            notes.append(f"not stated: {', '.join(missing)}; {ABOUT_FILE_NAME} in the study's folder can state them")
        without_orcid = [author.name for author in self.facts.authors if not author.orcid]
        if without_orcid:
            notes.append(f"without an ORCID: {', '.join(without_orcid)}")
        if self.archive == "openneuro" and self.facts.licence.upper() not in _PUBLIC_DOMAIN:
            notes.append(f"OpenNeuro publishes data under CC0; the licence is {self.facts.licence}")
        return tuple(notes)

    def add_files(self, out: Path, export: ExportResult) -> ExportResult:
        """Add the card, the citation and the archive's metadata to an export's folder; return the export with them."""
        date = now_text()[:_DATE_CHARACTERS]
        year = date[:_YEAR_CHARACTERS]
        version = self.plan.study_version
        self._write_card(out, year)
        files = {"datacite.json": _format_json(build_datacite_metadata(self.facts, version, year))}
        if self.archive == "zenodo":
            files["zenodo.json"] = _format_json(build_zenodo_metadata(self.facts, version, date))
        if self.archive == "openneuro":
            files[".bidsignore"] = "datacite.json\n"
            files["CHANGES"] = f"{version} {date}\n  - First release.\n"
        else:  # BIDS names the authors in dataset_description.json, which may not do so beside CITATION.cff
            files["CITATION.cff"] = format_citation_file(self.facts, version, date)
        for name, text in files.items():
            (out / name).write_text(text, encoding="utf-8", newline="\n")
        return replace(export, paths=(*export.paths, *(out / name for name in files)))

    def _write_card(self, out: Path, year: str) -> None:
        """Insert the card into the export's README, between its YAML front matter and its text about the files."""
        path = out / "README.md"
        front_matter, files = _split_front_matter(path.read_text(encoding="utf-8"))
        data_dictionary: dict[str, Any] = {}
        dictionary_paths = sorted(out.rglob("dictionary.json"))
        if dictionary_paths:
            data_dictionary = json.loads(dictionary_paths[0].read_text(encoding="utf-8"))
        card = "\n".join(build_card(self.facts, self.plan.study, year, data_dictionary))
        files = files.replace("# ", "## The files: ", 1)
        path.write_text(f"{front_matter}{card}\n{files}", encoding="utf-8", newline="\n")


def _split_front_matter(text: str) -> tuple[str, str]:
    """Split a README into its YAML front matter, "" if it has none, and its text."""
    fence = "\n---\n"
    if not text.startswith("---\n"):
        return "", text
    end = text.index(fence) + len(fence)
    return f"{text[:end]}\n", text[end:].lstrip("\n")


def _format_json(content: dict[str, Any]) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def prepare_publication(study: Path, archive: str) -> Publication:
    """Read the facts about a study, and check that they include all that an archive requires.

    Raises:
        ExportError: if the archive is unknown, the study has no session, or a required fact is missing.
        ProtocolError: if the study's `about.toml` is not valid.
    """
    title = find_archive(archive).title
    paths, _ = list_readable_logs(study)
    if not paths:
        raise ExportError(f"{study} has no session to publish; name a study's folder")
    plan = read_log(paths[0]).plan
    facts = read_study_facts(study, plan.protocol_toml)
    missing = [name for name in _REQUIRED if not getattr(facts, name)]
    if missing:
        file = find_study_folder(study) / ABOUT_FILE_NAME
        raise ExportError(
            f"{title} requires {', '.join(missing)}, which the protocol's [about] does not state; state them under "
            f"[about] in {file}"
        )
    return Publication(archive, facts, plan)


def write_publication(
    study: Path, archive: str, out: Path, selection: Selection, *, progress: Callable[[Path], None]
) -> tuple[ExportResult, tuple[str, ...]]:
    """Write the folder that an archive takes; return the export, and the lines that say what it holds and lacks.

    Raises:
        ExportError: as for ``prepare_publication`` and ``export_study``.
        LogError: if the study cannot be read.
    """
    publication = prepare_publication(study, archive)
    write = partial(export_study, find_archive(archive).format, finish=publication.add_files)
    export, notes = write_recorded_export(write, f"publish {archive}", study, out, selection, progress=progress)
    return export, (*notes, *publication.notes)
