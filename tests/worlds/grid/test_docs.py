"""The tutorial's code runs as printed, and the gallery is what its script draws."""

import re
import runpy
from pathlib import Path

import gymnasium
import pytest
from PIL import Image

DOCS = Path(__file__).parents[3] / "docs"


def test_the_tutorials_code_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "grid-worlds.md").read_text(encoding="utf-8"), re.S)
    assert len(blocks) >= 9
    gymnasium.registry.pop("lab/Corridor-v0", None)  # an own world of another test's
    try:
        exec(compile("\n".join(blocks), "grid-worlds.md", "exec"), {"__name__": "tutorial"})
    finally:
        gymnasium.registry.pop("lab/Corridor-v0", None)
    assert "WW>>LrGgWW" in capsys.readouterr().out


def test_the_code_about_team_worlds_runs():
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "team-worlds.md").read_text(encoding="utf-8"), re.S)
    assert len(blocks) == 3
    try:
        exec(compile("\n".join(blocks), "team-worlds.md", "exec"), {"__name__": "tutorial"})
    finally:
        gymnasium.registry.pop("lab/KeyEach-v0", None)


def test_the_code_for_those_who_come_from_minigrid_runs():
    (block,) = re.findall(r"```python\n(.*?)```", (DOCS / "from-minigrid.md").read_text(encoding="utf-8"), re.S)
    names = {}
    exec(compile(block, "from-minigrid.md", "exec"), names)
    assert names["pixels"]["image"].shape == (56, 56, 3)
    assert names["cells"]["image"].shape == (8, 8, 3)
    assert names["seen"].any()


@pytest.mark.program
@pytest.mark.filterwarnings("ignore:.*out of date")
def test_the_gallery_is_what_its_script_draws(tmp_path):
    runpy.run_path(str(DOCS / "gallery_grid.py"))["write"](tmp_path)
    assert (tmp_path / "gallery-levels.md").read_text("utf-8") == (DOCS / "gallery-levels.md").read_text("utf-8")
    assert (tmp_path / "gallery-grid.md").read_text("utf-8") == (DOCS / "gallery-grid.md").read_text("utf-8")
    drawn = sorted((tmp_path / "gallery-grid").iterdir())
    assert [path.name for path in drawn] == sorted(path.name for path in (DOCS / "gallery-grid").iterdir())
    for path in drawn:
        with Image.open(path) as new, Image.open(DOCS / "gallery-grid" / path.name) as old:
            assert new.convert("RGB").tobytes() == old.convert("RGB").tobytes(), path.name
