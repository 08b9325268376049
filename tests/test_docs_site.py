"""The docs' site: every page is reached, every link leads somewhere, every picture says how it is made."""

import re
import runpy
from pathlib import Path

import pytest
from PIL import Image

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(DOCS.glob("*.md"))


def test_every_page_is_in_the_sites_menu():
    menu = (DOCS.parent / "mkdocs.yml").read_text()
    assert [page.name for page in PAGES if page.name not in menu] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_of_a_page_leads_to_a_file(page):
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    assert [link for link in links if "://" not in link and not (DOCS / link).exists()] == []


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
