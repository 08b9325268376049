"""The docs' site: every page is reached, every link leads somewhere, every picture says how it is made."""

import re
import runpy
import sys
import tomllib
from pathlib import Path

import pytest
from PIL import Image

import minihuman
from minihuman import ext, testing
from minihuman.cli.command_line import SECTIONS
from minihuman.dataset.table_catalogue import TABLES
from minihuman.experiment.machine.activity import list_built_in_kinds
from minihuman.experiment.protocol.protocol import build_json_schema, list_protocol_tables
from minihuman.log.codec import list_activity_topics
from minihuman.log.topics import RARE_TOPICS, TOPICS
from tests.machine import needs

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


def test_every_page_is_in_the_sites_menu():
    menu = (DOCS.parent / "mkdocs.yml").read_text()
    assert [page.name for page in PAGES if f": {page.relative_to(DOCS)}\n" not in menu] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_of_a_page_leads_to_a_file(page):
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []


def test_the_site_is_published_by_the_commands_of_the_page_about_playing_and_only_the_deployment_may_write():
    yaml = pytest.importorskip("yaml")
    workflow = yaml.safe_load((DOCS.parent / ".github/workflows/site.yml").read_text(encoding="utf-8"))
    build, deployment = workflow["jobs"]["build"], workflow["jobs"]["deploy"]
    commands = [step["run"] for step in build["steps"] if "run" in step]
    shown = re.search(r"```bash\n(.*?)```", (DOCS / "play.md").read_text(encoding="utf-8"), re.DOTALL)
    assert shown is not None
    assert commands[:2] == shown[1].splitlines()[:2]
    assert workflow["permissions"] == {}
    assert set(build["permissions"].values()) == {"read"}
    assert deployment["permissions"] == {"pages": "write", "id-token": "write"}


@needs("mkdocs")
def test_the_reference_has_every_command_every_table_and_every_exported_name():
    hooks = runpy.run_path(str(DOCS / "_hooks.py"))
    commands, tables = hooks["list_commands"](""), hooks["list_tables"]("")
    for name in (name for names in SECTIONS.values() for name in names):
        assert f"### minihuman {name}\n" in commands
    for table, columns in TABLES.items():
        section = tables.partition(f"## {table}\n")[2].partition("\n## ")[0]
        assert [line.split("`")[1] for line in section.splitlines() if line.startswith("| `")] == [
            column.name for column in columns
        ]
    for package, module in (("minihuman", minihuman), ("minihuman.ext", ext)):
        listed = {line.rpartition(".")[2] for line in hooks["list_exports"](package).split("\n\n")}
        assert listed == {*module.__all__} - {"__version__"}


def test_every_picture_has_the_command_that_makes_it():
    commands = (DOCS.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert [path.name for path in (DOCS / "images").glob("*.png") if path.name not in commands] == []


@pytest.mark.nightly
@pytest.mark.program
def test_the_windows_pictures_are_made_again(tmp_path):
    made = runpy.run_path(str(DOCS / "pictures.py"))
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    made["windows"](pictures, tmp_path)
    made["teaching"](pictures, tmp_path)
    names = {"window_keyboard_check.png", "window_grid.png", "window_first_person.png", "window_text.png"}
    names |= {f"teach_{what}.png" for what in ("agent", "person", "correct", "compare")}
    assert {path.name for path in pictures.iterdir()} == names
    for path in (folder / name for folder in (pictures, DOCS / "images") for name in names):
        with Image.open(path) as picture:
            assert picture.size == (800, 450)


def test_the_reference_has_every_field_of_a_protocol_with_type_default_meaning_and_a_valid_example():
    import jsonschema

    reference = runpy.run_path(str(DOCS / "protocol_reference.py"))
    readme = reference["README"].read_text(encoding="utf-8")
    assert readme == reference["write_tables"](readme), "run: python docs/protocol_reference.py"
    schema = build_json_schema()
    for table, (heading, fields) in list_protocol_tables().items():
        names = [field.name for field in fields]
        section = re.split(r"\n#{2,3} ", readme.partition(f" `{heading}`\n")[2])[0]
        assert [line.split("`")[1] for line in section.splitlines() if line.startswith("| `")] == names, table
        assert all(field.type and field.default and field.meaning and field.example for field in fields)
        whole = tomllib.loads("\n".join(f"{field.name} = {field.example}" for field in fields))
        definition = next(one for one in schema["$defs"].values() if list(one.get("properties", ())) == names)
        jsonschema.validate(whole, {**definition, "$defs": schema["$defs"]})
        assert all(definition["properties"][field.name]["description"] == field.meaning for field in fields)


@pytest.mark.parametrize(
    ("suffix", "unit"), [("ms", "millisecond"), ("s", "second"), ("min", "minute"), ("px", "pixel")]
)
def test_the_meaning_of_a_field_with_a_unit_in_its_name_says_the_unit(suffix, unit):
    fields = [field for _, fields in list_protocol_tables().values() for field in fields]
    silent = [f.name for f in fields if f.name.endswith(f"_{suffix}") and not re.search(rf"\b{unit}s?\b", f.meaning)]
    assert silent == []


@needs("mkdocs")
def test_the_reference_has_every_topic_and_every_field_of_its_message():
    written = runpy.run_path(str(DOCS / "_hooks.py"))["list_topics"]("")
    for topic in (*TOPICS, *RARE_TOPICS, *list_activity_topics(list_built_in_kinds())):
        section = written.partition(f"## {topic.name}\n")[2].partition("\n## ")[0]
        fields = [field.name for field in topic.message.DESCRIPTOR.fields]
        if topic.is_preview:
            assert all(f"`{name}`" in section for name in fields)
        else:
            rows = [line.split("|") for line in section.splitlines() if line.startswith("| `")]
            assert [row[1].strip(" `") for row in rows] == fields, topic.name
            assert all(row[3].strip() for row in rows)
    for name in ("EpisodePlan", "KeyMap", "Map", "Participant", "Pose"):
        assert f"### {name}\n" in written


def test_the_reference_of_plug_ins_is_written_without_pytorch(monkeypatch):
    pytest.importorskip("mkdocs")
    for name in [name for name in sys.modules if name.startswith("minihuman.learn")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)  # whatever imports it fails
    written = runpy.run_path(str(DOCS / "_hooks.py"))["list_ports"]("")
    assert "| `learn()` | yes | Learn a policy until learning is complete or the time is up. |" in written


def test_the_reference_has_every_kind_of_plug_in():
    hooks = runpy.run_path(str(DOCS / "_hooks.py"))
    written = hooks["list_ports"]("")
    groups = tomllib.loads((DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    assert {name.removeprefix("minihuman.") for name in groups} == hooks["PORTS"].keys() - {"worlds"}
    for group, plugins in groups.items():
        section = written.partition(f"## {group.removeprefix('minihuman.')}\n")[2].partition("\n## ")[0]
        assert all(f"`{name}`" in section for name in plugins), group
    assert {check for _, _, check in hooks["PORTS"].values()} == {one for one in testing.__all__ if "check" in one}
    assert {name for _, name, _ in hooks["PORTS"].values()} <= set(ext.__all__)


def test_the_glossary_is_in_order_and_each_word_has_a_sentence_and_a_link():
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", (DOCS / "glossary.md").read_text(encoding="utf-8"), re.MULTILINE)[1:]
    rows = [(word, said) for word, said in rows if not word.startswith("-")]
    words = [word for word, _ in rows]
    assert words == sorted(words, key=str.casefold)
    assert len(words) == len(set(words)) > 40
    for word, said in rows:
        assert re.fullmatch(r"[A-Z][^|]+\(\[[^\]]+\]\([^)]+\.md[^)]*\)(, \[[^\]]+\]\([^)]+\.md\))*\)\.", said), word
