"""The docs' site: every page is reached, every link leads somewhere, every picture says how it is made."""

import re
import runpy
from pathlib import Path

import pytest
from PIL import Image

import minihuman
from minihuman import ext
from minihuman.cli.command_line import SECTIONS
from minihuman.dataset.table_columns import TABLES

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(DOCS.glob("*.md"))


def test_every_page_is_in_the_sites_menu():
    menu = (DOCS.parent / "mkdocs.yml").read_text()
    assert [page.name for page in PAGES if page.name not in menu] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_of_a_page_leads_to_a_file(page):
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    assert [link for link in links if "://" not in link and not (DOCS / link).exists()] == []


def test_the_reference_has_every_command_every_table_and_every_exported_name():
    pytest.importorskip("mkdocs")
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
    said = (DOCS / "pictures.md").read_text()
    assert [path.name for path in (DOCS / "images").glob("*.png") if path.name not in said] == []


@pytest.mark.program
def test_the_windows_pictures_are_made_again(tmp_path):
    made = runpy.run_path(str(DOCS / "pictures.py"))
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    made["windows"](pictures, tmp_path)
    made["teaching"](pictures, tmp_path)
    names = {"window_keyboard_check.png", "window_grid.png", "window_first_person.png"}
    names |= {f"teach_{what}.png" for what in ("agent", "person", "correct", "compare")}
    assert {path.name for path in pictures.iterdir()} == names
    for path in (folder / name for folder in (pictures, DOCS / "images") for name in names):
        with Image.open(path) as picture:
            assert picture.size == (800, 450)
