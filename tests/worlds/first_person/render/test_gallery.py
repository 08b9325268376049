"""The gallery's script draws what the page shows."""

import importlib.util
from pathlib import Path

import pytest

import minihuman  # noqa: F401  registers the worlds

DOCS = Path(__file__).parents[4] / "docs"


@pytest.mark.program
def test_the_gallery_script_writes_its_section_and_a_picture_a_view(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(DOCS)
    committed = (DOCS / "play.md").read_text()
    (tmp_path / "play.md").write_text(committed)
    spec = importlib.util.spec_from_file_location("gallery_first_person", DOCS / "gallery_first_person.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page, *pictures = module.draw_gallery(tmp_path, limit=2)
    assert len(pictures) == 4
    assert all(picture.stat().st_size > 1000 for picture in pictures)
    rows = [line for line in page.read_text().splitlines() if line.startswith("| `minihuman/")]
    assert len(rows) == 2
    assert all(row in committed for row in rows)
