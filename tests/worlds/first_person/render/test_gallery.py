"""The gallery's script draws what the page shows."""

import importlib.util
from pathlib import Path

import pytest

import minihuman  # noqa: F401  registers the worlds

DOCS = Path(__file__).parents[4] / "docs"


@pytest.mark.program
def test_the_gallery_script_writes_the_page_and_a_picture_a_view(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("gallery_first_person", DOCS / "gallery_first_person.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page, *pictures = module.draw_gallery(tmp_path, limit=2)
    assert len(pictures) == 4
    assert all(picture.stat().st_size > 1000 for picture in pictures)
    committed = (DOCS / "gallery-first-person.md").read_text()
    rows = [line for line in page.read_text().splitlines() if line.startswith("| `")]
    assert len(rows) == 2
    assert all(row in committed for row in rows)
