"""A study as the folder that an archive takes: its card, citation and metadata, and what is missing for it."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

import minihuman
from minihuman.api import publish
from minihuman.errors import ExportError, ProtocolError
from minihuman.exporters.dataset_card import split_name
from minihuman.exporters.publishing import ARCHIVES
from tests.export.odd import record_odd_study
from tests.export.study import recorded
from tests.machine import need, needs

pytestmark = pytest.mark.program
DATACITE_CHECK = """
import json, sys
from datacite import schema45
schema45.validate(json.load(open(sys.argv[1])))
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return record_odd_study(tmp_path_factory.mktemp("odd"))


@pytest.fixture(scope="module")
def published(study, tmp_path_factory):
    out = tmp_path_factory.mktemp("published")
    for archive in ARCHIVES:
        publish(study, archive, out / archive)
    return out


@pytest.mark.parametrize("archive", ARCHIVES)
def test_the_card_has_every_fact_and_column(published, archive):
    card = (published / archive / "README.md").read_text()
    for text in (
        '# A study: of "007" & others',
        "People find keys, = and doors.",
        "Ada Lovelace ([0000-0002-1825-0097](https://orcid.org/0000-0002-1825-0097)), University of Nowhere; Plato",
        "| Licence | CC-BY-4.0 |",
        "| DOI | https://doi.org/10.1234/abcd |",
        "| Keywords | navigation, transfer |",
        "| Ethics approvals | Board of the faculty, 2026-17 |",
        "| Funding | Grant 7 |",
        "Please cite: the study.",
        "- Doe, J. (2024). A work. https://doi.org/10.1000/182",
        "| `hand` | text |  | The hand at the keys. Levels: left: left-handed; right: right-handed. |",
        "4 episodes",
    ):
        assert text in card
    assert re.search(r"Lovelace, A\., & Plato \(\d{4}\)\. A study: of \"007\" & others \[Data set\]", card)
    assert card.startswith("---\n") == (archive == "hugging-face")


@pytest.mark.parametrize("archive", ["osf", "zenodo", "hugging-face"])
def test_the_citation_is_yaml_of_the_citation_file_format(published, archive):
    cited = yaml.safe_load((published / archive / "CITATION.cff").read_text())
    assert (cited["cff-version"], cited["type"], cited["version"]) == ("1.2.0", "dataset", "1.10")
    assert cited["title"] == 'A study: of "007" & others'
    assert cited["authors"] == [
        {
            "family-names": "Lovelace",
            "given-names": "Ada",
            "affiliation": "University of Nowhere",
            "email": "ada@example.org",
            "orcid": "https://orcid.org/0000-0002-1825-0097",
        },
        {"family-names": "Plato"},
    ]


def test_datacite_and_zenodo_have_what_their_forms_ask(published):
    described = json.loads((published / "osf/datacite.json").read_text())
    assert described["relatedIdentifiers"][0]["relatedIdentifier"] == "10.1000/182"
    assert described["rightsList"][0]["rightsUri"] == "https://spdx.org/licenses/CC-BY-4.0.html"
    metadata = json.loads((published / "zenodo/zenodo.json").read_text())["metadata"]
    assert metadata["creators"][0]["orcid"] == "0000-0002-1825-0097"
    assert (metadata["upload_type"], metadata["license"]) == ("dataset", "cc-by-4.0")


def test_hugging_face_loads_what_was_published(published, tmp_path):
    import datasets

    people = datasets.load_dataset(str(published / "hugging-face"), "people", split="train", cache_dir=str(tmp_path))
    assert people["age"] == [31, None]


@needs("validators")
def test_openneuros_validator_finds_no_error_and_no_warning_to_avoid(published):
    program = str(Path(need("validators")) / "bids-validator-deno")
    command = [program, str(published / "openneuro"), "--max-rows", "-1", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []
    codes = {issue["code"] for issue in issues}
    assert codes <= {"JSON_KEY_RECOMMENDED", "SIDECAR_KEY_RECOMMENDED", "EVENTS_TSV_MISSING"}


@needs("validators")
def test_zenodos_package_and_datacites_metadata_are_valid(published):
    programs = Path(need("validators"))
    for command in (
        [str(programs / "frictionless"), "validate", "datapackage.json"],
        [str(programs / "python"), "-c", DATACITE_CHECK, "datacite.json"],
    ):
        done = subprocess.run(command, cwd=published / "zenodo", capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def test_what_is_not_stated_is_asked_for_and_can_be_stated_later(tmp_path):
    study = recorded(tmp_path, participants=1)
    with pytest.raises(ExportError, match=r"OSF requires title, description, authors, licence, .*about\.toml"):
        publish(study, "osf", tmp_path / "out")
    (study / "about.toml").write_text(
        '[about]\ntitle = "T"\ndescription = "D"\nlicence = "CC0-1.0"\nauthors = [{ name = "A. B." }]\n'
        'participant_columns = [{ name = "age", type = "integer", description = "Age." }]\n'
    )
    (study / "participants.csv").write_text("participant,age\nsub-01,31\n")
    summary = publish(study, "openneuro", tmp_path / "out")
    assert "without an ORCID: A. B." in summary.notes
    assert not any("CC0" in note for note in summary.notes)
    assert (tmp_path / "out/participants.tsv").read_text().splitlines()[1].endswith("\t31")
    assert minihuman.open_study(study).table("people")["age"].tolist() == [31]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[about]\nlicense = "x"\n', r"about\.toml:2: \$\.about\.license is not a field"),
        ('[about]\ndoi = "x"\n', r"about\.toml:2: \$\.about\.doi is 'x'; write it as"),
        ("[study]\n", r"about\.toml:1: \$\.study is not a field"),
        ("[about\n", r"about\.toml: this is not valid TOML"),
    ],
)
def test_a_wrong_about_file_is_named_with_the_line(study, tmp_path, text, message):
    copy = tmp_path / "007"
    shutil.copytree(study, copy)
    (copy / "about.toml").write_text(text)
    with pytest.raises(ProtocolError, match=message):
        publish(copy, "osf", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_unknown_archive_is_refused(study, tmp_path):
    with pytest.raises(ExportError, match="the archive 'dryad' is unknown; use one of osf, zenodo, hugging-face"):
        publish(study, "dryad", tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("Ada Lovelace", ("Lovelace", "Ada")),
        ("van Beethoven, Ludwig", ("van Beethoven", "Ludwig")),
        ("Plato", ("Plato", "")),
        ("Mary Ann Evans", ("Evans", "Mary Ann")),
    ],
)
def test_names_are_split_as_in_print(name, parts):
    assert split_name(name) == parts
