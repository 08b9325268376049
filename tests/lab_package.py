"""A lab's package: installed for the length of a test, so that its entry points are found."""

import os
import re
import sys
from pathlib import Path

import pytest

EXTENDING = (Path(__file__).parents[1] / "docs" / "extending.md").read_text(encoding="utf-8")
PARTS = {"questions": ["affect_grid = a_lab:AFFECT_GRID"], "activities": ["tapping = a_lab:TAPPING"]}
STUDY = """
[study]
name = "lab"
version = "1"
seed = 3
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "all"
parts = ["warm-up", "mood"]
[[activities]]
name = "warm-up"
kind = "tapping"
settings = { taps = 3 }
[[questions]]
name = "mood"
[[questions.items]]
name = "feeling"
kind = "affect_grid"
ask = "How do you feel now?"
settings = { size = 5 }
"""


def example(name: str) -> str:
    """The code of an example of docs/extending.md."""
    file = {"question": "affect_grid", "activity": "tapping"}[name]
    (code,) = re.findall(rf'```python title="{file}.py"\n(.*?)```', EXTENDING, re.S)
    return code


@pytest.fixture
def install_lab(tmp_path: Path, monkeypatch):
    """Installs a package of one module ``a_lab`` with these entry points: ``players=["sleeper = a_lab:Sleeper"]``."""

    def install(name: str, code: str = "", **groups: list[str]) -> None:
        place = tmp_path / "installed" / name
        info = place / f"{name}-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = [line for group, entries in groups.items() for line in (f"[minihuman.{group}]", *entries)]
        (info / "entry_points.txt").write_text("\n".join(lines))
        (place / "a_lab.py").write_text(code)
        monkeypatch.syspath_prepend(place)
        monkeypatch.setenv("PYTHONPATH", str(place), prepend=os.pathsep)  # of programs that a test starts

    yield install
    sys.modules.pop("a_lab", None)
