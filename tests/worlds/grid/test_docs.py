"""The tutorial's code runs as printed, and the gallery is what its script draws."""

import re
import runpy
from pathlib import Path

import gymnasium
import pytest
from PIL import Image

DOCS = Path(__file__).parents[3] / "docs"


def test_the_tutorials_code_runs(capsys):
    page, _, _ = (DOCS / "grid-worlds.md").read_text(encoding="utf-8").partition("\n## BabyAI levels\n")
    blocks = re.findall(r"```python\n(.*?)```", page, re.S)
    assert len(blocks) >= 9
    gymnasium.registry.pop("lab/Corridor-v0", None)  # an own world of another test's
    try:
        exec(compile("\n".join(blocks), "grid-worlds.md", "exec"), {"__name__": "tutorial"})
    finally:
        gymnasium.registry.pop("lab/Corridor-v0", None)
    assert "WW>>LrGgWW" in capsys.readouterr().out


def test_the_code_about_team_worlds_runs():
    _, _, section = (DOCS / "teams.md").read_text(encoding="utf-8").partition("\n## Worlds with several bodies\n")
    blocks = re.findall(r"```python\n(.*?)```", section, re.S)
    assert len(blocks) == 3
    try:
        exec(compile("\n".join(blocks), "teams.md", "exec"), {"__name__": "tutorial"})
    finally:
        gymnasium.registry.pop("lab/KeyEach-v0", None)


def test_the_code_for_those_who_come_from_minigrid_runs():
    (block,) = re.findall(r"```python\n(.*?)```", (DOCS / "environments.md").read_text(encoding="utf-8"), re.S)
    names = {}
    exec(compile(block, "environments.md", "exec"), names)
    assert names["pixels"]["image"].shape == (56, 56, 3)
    assert names["cells"]["image"].shape == (8, 8, 3)
    assert names["seen"].any()


@pytest.mark.program
@pytest.mark.filterwarnings("ignore:.*out of date")
def test_the_gallery_is_what_its_script_draws(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = (DOCS / "play.md").read_text("utf-8")
    emptied = re.sub(r"(<!-- (gallery-grid|gallery-levels) -->\n).*?(<!-- end)", r"\1\3", page, flags=re.S)
    assert "MiniGrid-DoorKey-8x8-v0" not in emptied
    (tmp_path / "play.md").write_text(emptied, "utf-8")
    runpy.run_path(str(DOCS / "gallery_grid.py"))["write"](tmp_path)
    assert (tmp_path / "play.md").read_text("utf-8") == page
    drawn = sorted((tmp_path / "gallery-grid").iterdir())
    assert [path.name for path in drawn] == sorted(path.name for path in (DOCS / "gallery-grid").iterdir())
    for path in drawn:
        with Image.open(path) as new, Image.open(DOCS / "gallery-grid" / path.name) as old:
            assert new.convert("RGB").tobytes() == old.convert("RGB").tobytes(), path.name
